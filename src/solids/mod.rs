//! Solids in pictures: opaque surfaces that hide the matter behind them, from meshes or from depth buffers of other
//! renderers.

mod normals;
mod raster;
mod section;

use std::path::{Path, PathBuf};

use glam::DVec3;

use crate::camera::Camera;
use crate::error::{Error, Result};
use crate::image::{DepthMap, Image, Region};
use crate::lighting::Lighting;
use crate::stats::Rendered;
use crate::transfer::color;
use crate::volume::Grid;
pub use voxsplat_volume::meshes::{Mesh, Space, load as load_mesh};

/// A mesh, and the colour of its vertices that have no colour of their own.
#[derive(Debug, Clone, PartialEq)]
pub struct Solid {
    /// The mesh, in the world of the volume.
    pub mesh: Mesh,
    /// Red, green and blue of vertices without a colour, 0 to 1, sRGB.
    pub color: [f64; 3],
}

impl Solid {
    /// The colour of meshes without colours: ivory.
    pub const COLOR: [f64; 3] = [0.87, 0.84, 0.76];

    /// Returns whether the box around the mesh meets the box of a volume, half a voxel around its samples.
    #[must_use]
    pub fn reaches(&self, grid: &Grid) -> bool {
        let places = (0..self.mesh.vertices.len() as u32).map(|vertex| {
            let place = grid.to_lattice().transform_point3(self.mesh.place(vertex));
            [place, place]
        });
        let Some([low, high]) = places.reduce(|[low, high], [a, b]| [low.min(a), high.max(b)]) else { return false };
        let end = DVec3::from_array(grid.dims().map(f64::from)) - 0.5;
        high.cmpge(DVec3::splat(-0.5)).all() && low.cmple(end).all()
    }
}

/// The surfaces of a picture: the depth of each pixel and, if they are known, the colours of the surfaces.
#[derive(Debug, Clone, PartialEq)]
pub struct Solids {
    /// The depth of the surface in each pixel.
    pub depths: DepthMap,
    /// The premultiplied colours and the coverage of the surfaces. `None`: another program draws them, and the picture
    /// shows the matter before them alone.
    pub image: Option<Image>,
}

impl Solids {
    /// Loads the depths of an OpenEXR, and its colours if it has them: see [`DepthMap::load`].
    ///
    /// # Errors
    /// The errors of [`DepthMap::load`].
    pub fn load(path: impl AsRef<Path>) -> Result<Self> {
        let (depths, image) = DepthMap::load(path)?;
        Ok(Self { depths, image })
    }

    /// Draws meshes as a camera sees them, on the host in f64. A mesh has both sides, smooth normals except at edges of
    /// over 40 degrees, and the light and material of the picture, without shadows; `None` is the default light. Edges
    /// are smooth: a pixel is covered by as much of 16 samples as hit a surface. Lights whose sum is over 1 are dimmed,
    /// so that colours keep their hue.
    ///
    /// A pixel has one depth: the median of its samples, on the plane of that sample's triangle. Surfaces behind it in
    /// the same pixel have the depth of the median too.
    ///
    /// # Errors
    /// [`Error::Camera`] if the camera is not finite, [`Error::Memory`].
    pub fn of_meshes(solids: &[Solid], camera: &Camera, lighting: Option<&Lighting>) -> Result<Self> {
        camera.validate()?;
        let headlight = Lighting::default();
        raster::draw(solids, camera, lighting.unwrap_or(&headlight))
    }

    /// Returns the surfaces of a picture: meshes as a camera sees them ([`Self::of_meshes`]), and other surfaces, such
    /// as [`Self::of_planes`] or the ones of another renderer. `None` without any.
    ///
    /// # Errors
    /// The errors of [`Self::of_meshes`], and [`Error::Setting`] if the sizes differ.
    pub fn seen(
        meshes: &[Solid],
        others: impl IntoIterator<Item = Self>,
        camera: &Camera,
        lighting: Option<&Lighting>,
    ) -> Result<Option<Self>> {
        let drawn = (!meshes.is_empty()).then(|| Self::of_meshes(meshes, camera, lighting)).transpose()?;
        others.into_iter().try_fold(drawn, |all, other| {
            other.check(camera)?;
            Ok(Some(match all {
                Some(all) => all.and(other)?,
                None => other,
            }))
        })
    }

    /// Returns the nearer surface of two in each pixel. A surface that covers a part of a pixel shows the other one
    /// behind it. Surfaces without colours hide others and show nothing, because another program draws them.
    ///
    /// # Errors
    /// [`Error::Image`] if the sizes differ.
    pub fn and(self, other: Self) -> Result<Self> {
        let depths = self.depths.nearest(&other.depths)?;
        let [width, height] = depths.size();
        let image = match (&self.image, &other.image) {
            (None, None) => None,
            (one, two) => {
                let pixel = |of: &Option<Image>, at| of.as_ref().map_or([0.0; 4], |image| image.at(at));
                let mut image = Image::transparent(width, height)?;
                for at in (Region { x: 0, y: 0, width, height }).pixels() {
                    let is_first = self.depths.at(at) <= other.depths.at(at);
                    let (near, far) = if is_first { (one, two) } else { (two, one) };
                    let shown = pixel(near, at);
                    let passed = if near.is_some() { 1.0 - shown[3] } else { 0.0 };
                    let behind = pixel(far, at);
                    *image.at_mut(at) = std::array::from_fn(|channel| shown[channel] + passed * behind[channel]);
                }
                Some(image)
            }
        };
        Ok(Self { depths, image })
    }

    /// Refuses surfaces of another size than the pictures of a camera.
    pub(crate) fn check(&self, camera: &Camera) -> Result<()> {
        self.depths.check(camera)?;
        match &self.image {
            Some(image) if [image.width(), image.height()] != self.depths.size() => {
                Err(Error::Image("the surfaces have depths of another size than their picture".to_owned()))
            }
            _ => Ok(()),
        }
    }

    /// Returns the share of a pixel that its surface covers: 1 if the surface only hides matter.
    fn coverage(&self, [x, y]: [u32; 2]) -> f32 {
        if self.depths.at([x, y]).is_infinite() {
            return 0.0;
        }
        self.image.as_ref().map_or(1.0, |image| match image.at([x, y])[3] {
            // Hidden by a surface without colours.
            0.0 => 1.0,
            covered => covered,
        })
    }

    /// Returns whether surfaces cover each pixel of a region whole.
    fn covers(&self, region: Region) -> bool {
        region.pixels().all(|pixel| self.coverage(pixel) >= 1.0)
    }

    /// Makes a part of a picture with these surfaces in it, of the matter `before` them in a region and of `all`
    /// matter: matter behind the edge of a surface is visible too.
    pub(crate) fn in_picture(
        &self,
        region: Region,
        before: impl Fn(Region) -> Result<Rendered>,
        all: impl Fn() -> Result<Rendered>,
    ) -> Result<Rendered> {
        let Some(reached) = self.depths.reached(region) else { return all() };
        let before = before(reached)?;
        if reached == region && self.covers(region) {
            let image = match &self.image {
                Some(surfaces) => before.image.over(&surfaces.part(region)?)?,
                None => before.image,
            };
            return Ok(Rendered { image, ..before });
        }
        let Rendered { mut image, mut stats } = all()?;
        self.lay_over(&mut image, region, &before.image, reached);
        stats.add(&before.stats);
        Ok(Rendered { image, stats })
    }

    /// Lays the surfaces, with the matter before them, over a picture of all matter: premultiplied, C + (1 - alpha) S
    /// in the part of a pixel that a surface covers. `before` is the picture of a region `reached` inside the `region`
    /// of `image`.
    fn lay_over(&self, image: &mut Image, region: Region, before: &Image, reached: Region) {
        for pixel @ [x, y] in reached.pixels() {
            let covered = self.coverage(pixel);
            if covered <= 0.0 {
                continue;
            }
            let matter = before.at([x - reached.x, y - reached.y]);
            let surface = self.image.as_ref().map_or([0.0; 4], |image| image.at(pixel));
            let shown = image.at_mut([x - region.x, y - region.y]);
            for channel in 0..4 {
                let with_surface = covered * matter[channel] + (1.0 - matter[3]) * surface[channel];
                shown[channel] = with_surface + (1.0 - covered) * shown[channel];
            }
        }
    }
}

/// A mesh in the spelling of users: `FILE` or `FILE:COLOUR`.
#[derive(Debug, Clone, PartialEq)]
#[doc(hidden)]
pub struct MeshSpec {
    /// The path of the file: PLY, STL, OBJ or VTP.
    pub path: PathBuf,
    /// The colour of all vertices; `None`: the vertices' own colours, or [`Solid::COLOR`].
    pub color: Option<[f64; 3]>,
}

impl MeshSpec {
    /// Reads the text of an option: the part behind the last colon is a colour, if it can be one.
    ///
    /// # Errors
    /// [`Error::Setting`] if a text behind the last colon is neither a colour nor part of the name of a file.
    pub fn new(path: &Path) -> Result<Self> {
        let whole = || Self { path: path.to_owned(), color: None };
        let Some((file, color)) = path.to_str().and_then(|text| text.rsplit_once(':')) else { return Ok(whole()) };
        match Self::color(color) {
            _ if file.is_empty() || path.exists() => Ok(whole()),
            // A path of Windows, or a file that is not there: to be read as it is.
            Err(_) if color.contains(['/', '\\', '.']) => Ok(whole()),
            color => Ok(Self { path: file.into(), color: Some(color?) }),
        }
    }

    /// Reads a colour of a mesh: red, green and blue, 0 to 1.
    ///
    /// # Errors
    /// [`Error::Setting`] if the text is no colour.
    pub fn color(text: &str) -> Result<[f64; 3]> {
        color::parse(text).ok_or_else(|| {
            let expected = "expected #rrggbb, a colour of CSS by name, or r,g,b from 0 to 1";
            Error::setting("mesh", format!("{text:?} is no colour, {expected}{}", color::tip(text)))
        })
    }

    /// Loads the mesh. A mesh that states the space RAS is turned into the space of patients, LPS.
    ///
    /// # Errors
    /// The errors of [`load_mesh`].
    pub fn load(&self) -> Result<Solid> {
        let mut mesh = load_mesh(&self.path)?.into_lps();
        if self.color.is_some() {
            mesh.colors.clear();
        }
        Ok(Solid { mesh, color: self.color.unwrap_or(Solid::COLOR) })
    }
}

#[cfg(test)]
mod tests {
    use glam::DVec3;

    use super::*;
    use crate::camera::{ProjectionKind, View};

    /// Makes a square of two triangles across y, around the origin, as wide as 2 `half`, at `y`.
    fn square(half: f32, y: f32) -> Mesh {
        let place = |x: f32, z: f32| [half * x, y, half * z];
        Mesh {
            vertices: vec![place(-1.0, -1.0), place(1.0, -1.0), place(1.0, 1.0), place(-1.0, 1.0)],
            triangles: vec![[0, 1, 2], [0, 2, 3]],
            ..Mesh::default()
        }
    }

    fn camera(projection: ProjectionKind, size: u32) -> Camera {
        let grid = Grid::axis_parallel([9; 3], [1.0; 3]).unwrap();
        let view = View { target: Some(DVec3::ZERO), projection, ..View::default() };
        // Pictures of parallel rays span a height of 8, of one eye as much at a distance of 20.
        let view = match projection {
            ProjectionKind::Orthographic => View { view_height: Some(8.0), ..view },
            ProjectionKind::Perspective { .. } => View { distance: Some(20.0), ..view },
        };
        Camera::new(&view, &grid, [size; 2]).unwrap()
    }

    fn whole(size: u32) -> Region {
        Region { x: 0, y: 0, width: size, height: size }
    }

    fn solid(mesh: Mesh) -> Solid {
        Solid { mesh, color: [0.5, 0.25, 1.0] }
    }

    const FOV: f64 = 22.619_864_948_040_43;

    #[test]
    fn a_square_covers_its_pixels_and_parts_of_others() {
        // 64 pixels span 8 units in the plane of the target: the square spans 38.4 of them.
        let drawn =
            |projection, y: f32| Solids::of_meshes(&[solid(square(2.4, y))], &camera(projection, 64), None).unwrap();
        for (projection, y, depth) in [
            (ProjectionKind::Orthographic, 0.0, 0.0),
            (ProjectionKind::Orthographic, -1.5, -1.5),
            (ProjectionKind::Perspective { fov: FOV }, 0.0, 20.0),
        ] {
            let Solids { depths, image } = drawn(projection, y);
            let image = image.unwrap();
            let covered: f32 = image.pixels().iter().map(|pixel| pixel[3]).sum();
            assert!((covered - 38.4 * 38.4).abs() < 39.0, "{covered}");
            let middle = 32 * 64 + 32;
            assert!((f64::from(depths.depths()[middle]) - depth).abs() < 1e-5, "{}", depths.depths()[middle]);
            assert_eq!(image.pixels()[middle][3], 1.0);
            // A headlight straight on: ambient, diffuse and highlight.
            let expected = [0.5 + 0.2, 0.25 + 0.2, 1.0];
            let near = image.pixels()[middle][..3].iter().zip(expected).all(|(a, b)| (a - b).abs() < 2e-3);
            assert!(near, "{:?}", image.pixels()[middle]);
            assert!(depths.depths()[0].is_infinite() && image.pixels()[0] == [0.0; 4]);
            let solids = Solids { depths, image: Some(image) };
            assert_eq!(solids.depths.reached(whole(64)).map(|region| region.width), Some(40));
            assert!(!solids.covers(whole(64)) && solids.covers(Region { x: 20, y: 20, width: 24, height: 24 }));
        }
    }

    #[test]
    fn a_sphere_has_the_depths_and_normals_of_its_form() {
        let mut mesh = Mesh::default();
        let (rings, sectors) = (64, 128);
        for ring in 0..=rings {
            for sector in 0..sectors {
                let (up, turn) = (
                    std::f64::consts::PI * f64::from(ring) / f64::from(rings),
                    std::f64::consts::TAU * f64::from(sector) / f64::from(sectors),
                );
                let place = DVec3::new(up.sin() * turn.cos(), up.sin() * turn.sin(), up.cos()) * 3.0;
                mesh.vertices.push(place.as_vec3().to_array());
            }
        }
        for ring in 0..rings {
            for sector in 0..sectors {
                let at = |ring: u32, sector: u32| ring * sectors + sector % sectors;
                let [a, b] = [at(ring, sector), at(ring, sector + 1)];
                let [c, d] = [at(ring + 1, sector), at(ring + 1, sector + 1)];
                mesh.triangles.extend([[a, b, c], [b, d, c]]);
            }
        }
        let camera = camera(ProjectionKind::Perspective { fov: FOV }, 64);
        let lighting = Lighting { ambient: 0.0, diffuse: 1.0, specular: 0.0, ..Lighting::default() };
        let white = Solid { mesh, color: [1.0; 3] };
        let Solids { depths, image } = Solids::of_meshes(&[white], &camera, Some(&lighting)).unwrap();
        let image = image.unwrap();
        let mut count = 0;
        for (index, (depth, pixel)) in (0_u32..).zip(depths.depths().iter().zip(image.pixels())) {
            let (sx, sy) = camera.image_coordinates([index % 64, index / 64]);
            let (origin, direction) = camera.ray(sx, sy);
            let along = -origin.dot(direction);
            let left = 9.0 - (origin + direction * along).length_squared();
            if pixel[3] < 1.0 || left < 1.0 {
                continue;
            }
            let place = origin + direction * (along - left.sqrt());
            let expected = (place - origin).dot(camera.forward);
            assert!((f64::from(*depth) - expected).abs() < 0.01, "{depth}, {expected}");
            let cosine = -direction.dot(place) / 3.0;
            assert!((f64::from(pixel[0]) - cosine).abs() < 0.02, "{}, {cosine}", pixel[0]);
            count += 1;
        }
        assert!(count > 1000, "{count}");
    }

    #[test]
    fn triangles_behind_the_eye_are_cut_and_nearer_ones_hide_others() {
        let camera = camera(ProjectionKind::Perspective { fov: FOV }, 16);
        // A floor from far behind the eye to far before it, below the eye.
        let floor = Mesh {
            vertices: vec![[-900.0, -900.0, -1.0], [900.0, -900.0, -1.0], [0.0, 900.0, -1.0]],
            triangles: vec![[0, 1, 2]],
            ..Mesh::default()
        };
        let solids = Solids::of_meshes(&[solid(floor)], &camera, None).unwrap();
        let depths = solids.depths.depths();
        assert!(depths[..7 * 16].iter().all(|depth| depth.is_infinite()));
        // The lowest row looks down by a slope of 15/16 of 0.2.
        let lowest = f64::from(depths[15 * 16 + 8]);
        assert!((lowest - 1.0 / (0.2 * 15.0 / 16.0)).abs() < 0.01, "{lowest}");
        let pair = [solid(square(2.0, 1.0)), Solid { mesh: square(1.0, -1.0), color: [1.0, 0.0, 0.0] }];
        let both = Solids::of_meshes(&pair, &camera, None).unwrap();
        assert!((both.depths.depths()[8 * 16 + 8] - 19.0).abs() < 1e-4);
        let apart = pair.map(|solid| Solids::of_meshes(&[solid], &camera, None).unwrap());
        let [far, near] = apart;
        let hidden = far.clone().and(Solids { image: None, ..near.clone() }).unwrap();
        assert_eq!(hidden.image.unwrap().at([8, 8]), [0.0; 4]);
        let joined = far.and(near).unwrap();
        assert_eq!(joined.depths.depths()[8 * 16 + 8], both.depths.depths()[8 * 16 + 8]);
        assert_eq!(joined.image.unwrap().pixels()[8 * 16 + 8], both.image.unwrap().pixels()[8 * 16 + 8]);
    }

    #[test]
    fn a_mesh_has_a_color_behind_its_file() {
        let of = |text: &str| MeshSpec::new(Path::new(text)).map(|MeshSpec { path, color }| (path, color));
        assert_eq!(of("a.ply").unwrap(), ("a.ply".into(), None));
        assert_eq!(of("a.ply:red").unwrap(), ("a.ply".into(), Some([1.0, 0.0, 0.0])));
        assert_eq!(of("C:\\a.ply").unwrap(), ("C:\\a.ply".into(), None));
        assert_eq!(of("C:\\a.ply:#00f").unwrap(), ("C:\\a.ply".into(), Some([0.0, 0.0, 1.0])));
        let error = of("a.ply:rde").unwrap_err().to_string();
        assert!(error.contains("\"rde\" is no colour"), "{error}");
    }
}
