//! Solids in pictures: opaque surfaces that hide the matter behind them, from meshes or from depth buffers of other
//! renderers.

mod normals;
mod raster;

use std::path::{Path, PathBuf};

use glam::DVec3;

use crate::camera::Camera;
use crate::error::{Error, Result};
use crate::image::{DepthMap, Image};
use crate::lighting::Lighting;
use crate::transfer::color;
use crate::volume::Grid;
pub use voxsplat_volume::meshes::{Mesh, Space, load as load_mesh};

/// A mesh and the colour of its vertices that have none of their own.
#[derive(Debug, Clone, PartialEq)]
pub struct Solid {
    /// The mesh, in the world of the volume.
    pub mesh: Mesh,
    /// Red, green and blue, 0 to 1, sRGB.
    pub color: [f64; 3],
}

impl Solid {
    /// The colour of meshes without colours: ivory.
    pub const COLOR: [f64; 3] = [0.87, 0.84, 0.76];

    /// Returns whether a vertex lies in the box of a volume, half a voxel around its samples.
    #[must_use]
    pub fn reaches(&self, grid: &Grid) -> bool {
        let end = DVec3::from_array(grid.dims().map(f64::from)) - 0.5;
        (0..self.mesh.vertices.len() as u32).any(|vertex| {
            let place = grid.to_lattice().transform_point3(self.mesh.place(vertex));
            place.cmpge(DVec3::splat(-0.5)).all() && place.cmple(end).all()
        })
    }
}

/// The surfaces of a picture: the depth of each pixel and, if it is known, what the picture shows there.
#[derive(Debug, Clone, PartialEq)]
pub struct Solids {
    /// The depth of the surface in each pixel.
    pub depths: DepthMap,
    /// Premultiplied colours and coverage of the surfaces. `None`: another program draws them, and the picture shows
    /// the matter before them alone.
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
    /// are smooth: a pixel is covered by as much of 16 samples as hit a surface.
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

    /// Returns the nearer surface of two in each pixel. A surface that covers a part of a pixel shows the other one
    /// behind it.
    ///
    /// # Errors
    /// [`Error::Image`] if the sizes differ, or one of them has no colours.
    pub fn and(self, other: &Self) -> Result<Self> {
        let (Some(image), Some(behind)) = (&self.image, &other.image) else {
            return Err(Error::Image("surfaces of a depth buffer without colours have no picture".to_owned()));
        };
        let [width, height] = self.depths.size();
        let depths = self.depths.nearest(&other.depths)?;
        let pairs = self.depths.depths().iter().zip(other.depths.depths());
        let pixels = pairs.zip(image.pixels().iter().zip(behind.pixels())).map(|((a, b), (image, behind))| {
            let (near, far) = if a <= b { (image, behind) } else { (behind, image) };
            std::array::from_fn(|channel| near[channel] + (1.0 - near[3]) * far[channel])
        });
        Ok(Self { depths, image: Some(Image::new(width, height, pixels.collect())?) })
    }

    /// Whether a surface covers a part of some pixel, so that matter behind it shows too.
    pub(crate) fn has_edges(&self) -> bool {
        let partial = |image: &Image| image.pixels().iter().any(|pixel| pixel[3] > 0.0 && pixel[3] < 1.0);
        self.image.as_ref().is_some_and(partial)
    }

    /// Returns the picture of matter and surfaces: premultiplied, C + (1 - alpha) S in pixels that a surface covers.
    /// `before` is the matter before the surfaces, `whole` all matter, which shows beside the edge of a surface.
    pub(crate) fn combined(image: &Image, before: &Image, whole: &Image) -> Result<Image> {
        let pixels = image.pixels().iter().zip(before.pixels()).zip(whole.pixels());
        let mixed = pixels.map(|((surface, before), whole)| {
            let covered = surface[3];
            std::array::from_fn(|channel| {
                covered * before[channel] + (1.0 - before[3]) * surface[channel] + (1.0 - covered) * whole[channel]
            })
        });
        Image::new(image.width(), image.height(), mixed.collect())
    }
}

/// A mesh as a user writes it: `FILE` or `FILE:COLOUR`.
#[derive(Debug, Clone, PartialEq)]
pub struct MeshSpec {
    /// The file: PLY, STL, OBJ or VTP.
    pub path: PathBuf,
    /// The colour of all vertices; `None`: their own, or [`Solid::COLOR`].
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
        match color::parse(color) {
            _ if file.is_empty() || path.exists() => Ok(whole()),
            Some(color) => Ok(Self { path: file.into(), color: Some(color) }),
            // A path of Windows, or a file that is not there: to be read as it is.
            None if color.contains(['/', '\\', '.']) => Ok(whole()),
            None => {
                let expected = "expected FILE:COLOUR with #rrggbb, a colour of CSS by name, or r,g,b";
                Err(Error::setting("mesh", format!("{color:?} is no colour, {expected}{}", color::tip(color))))
            }
        }
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
