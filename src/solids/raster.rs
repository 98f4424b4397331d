//! Draws meshes into pixels with depths, on the host: a depth buffer of 4 x 4 samples for each pixel (Catmull 1974, "A
//! subdivision algorithm for computer display of curved surfaces").

use glam::{DVec2, DVec3};
use rayon::prelude::*;

use super::normals::corner_normals;
use super::{Solid, Solids};
use crate::camera::{Camera, Projection};
use crate::error::Result;
use crate::image::{DepthMap, Image};
use crate::lighting::{Lighting, Visibility};
use voxsplat_volume::memory::reserved;

/// The number of samples of a pixel along each axis.
const SAMPLES: usize = 4;
const ALL: usize = SAMPLES * SAMPLES;
/// The number of rows of pixels that are drawn together.
const BAND: usize = 16;
/// The least distance of drawn surfaces from the eye, as a fraction of the distance of the target.
const NEAR: f64 = 1e-4;

/// A corner of a triangle in the picture.
#[derive(Clone, Copy)]
struct Corner {
    /// The place of the corner in pixels from the top left of the picture.
    pixel: DVec2,
    /// The depth of the corner, as in [`DepthMap`].
    depth: f64,
    /// The shares of the three corners of the whole triangle in this corner.
    shares: DVec3,
}

/// A triangle in the picture, or the part of it before the eye.
struct Projected {
    corners: [Corner; 3],
    /// The number of the mesh, and the number of the triangle in it.
    of: [u32; 2],
}

/// A place at which a sample hits a triangle.
struct Hit {
    depth: f64,
    /// The shares of the corners of the whole triangle at the place.
    shares: DVec3,
}

/// The camera, and the meshes and lights in front of it.
struct Scene<'a> {
    solids: &'a [Solid],
    normals: Vec<Vec<[DVec3; 3]>>,
    camera: &'a Camera,
    lighting: &'a Lighting,
    /// The factor of the colours of meshes: the brightest light shows a colour as it is, not brighter.
    exposure: f64,
}

pub(super) fn draw(solids: &[Solid], camera: &Camera, lighting: &Lighting) -> Result<Solids> {
    let normals = solids.par_iter().map(|solid| corner_normals(&solid.mesh)).collect();
    let exposure = 1.0 / lighting.brightest_factor(camera.target, camera.forward).max(1.0);
    let scene = Scene { solids, normals, camera, lighting, exposure };
    let [width, height] = camera.size;
    let bands = (height as usize).div_ceil(BAND);
    let triangles: Vec<Projected> = (0_u32..)
        .zip(solids)
        .flat_map(|(mesh, solid)| (0..solid.mesh.triangles.len() as u32).map(move |triangle| [mesh, triangle]))
        .collect::<Vec<[u32; 2]>>()
        .into_par_iter()
        .flat_map_iter(|of| scene.projected(of))
        .collect();
    // The triangles of each band, in the order of the file.
    let mut of_bands: Vec<Vec<u32>> = vec![Vec::new(); bands];
    for (number, triangle) in (0_u32..).zip(&triangles) {
        let rows = triangle.corners.map(|corner| corner.pixel.y);
        let [low, high] = ends(rows, height);
        (low / BAND..high.div_ceil(BAND)).for_each(|band| of_bands[band].push(number));
    }
    let area = u64::from(width) * u64::from(height);
    let mut depths: Vec<f32> = reserved(area, || "depths of meshes".to_owned())?;
    depths.resize(area as usize, f32::INFINITY);
    let mut image = Image::transparent(width, height)?;
    let rows = BAND * width as usize;
    depths.par_chunks_mut(rows).zip(image.pixels_mut().par_chunks_mut(rows)).zip(&of_bands).enumerate().for_each(
        |(band, ((depths, pixels), triangles_of))| {
            if !triangles_of.is_empty() {
                scene.draw_band(band * BAND, (depths, pixels), &triangles, triangles_of);
            }
        },
    );
    Ok(Solids { depths: DepthMap::new(width, height, depths)?, image: Some(image) })
}

/// Returns the first whole pixel that three places reach along an axis, and the pixel after the last.
fn ends(places: [f64; 3], size: u32) -> [usize; 2] {
    let low = places.into_iter().fold(f64::INFINITY, f64::min);
    let high = places.into_iter().fold(f64::NEG_INFINITY, f64::max);
    // Casts saturate.
    [(low.floor().max(0.0) as usize).min(size as usize), (high.ceil().max(0.0) as usize).min(size as usize)]
}

impl Scene<'_> {
    /// Returns the parts of a triangle before the eye: none, one or two triangles.
    fn projected(&self, of: [u32; 2]) -> Vec<Projected> {
        let mesh = &self.solids[of[0] as usize].mesh;
        let places = mesh.triangles[of[1] as usize].map(|vertex| self.camera.seen(mesh.place(vertex)));
        let near = match self.camera.projection {
            Projection::Orthographic { .. } => f64::NEG_INFINITY,
            Projection::Perspective { distance, .. } => NEAR * distance.abs(),
        };
        // The polygon before the near plane (Sutherland and Hodgman 1974, "Reentrant polygon clipping").
        let mut polygon: Vec<(DVec3, DVec3)> = Vec::new();
        for number in 0..3 {
            let (from, to) = (places[number], places[(number + 1) % 3]);
            let (own, next) = (DVec3::AXES[number], DVec3::AXES[(number + 1) % 3]);
            if from.z > near {
                polygon.push((from, own));
            }
            if (from.z > near) != (to.z > near) {
                let share = (near - from.z) / (to.z - from.z);
                polygon.push((from.lerp(to, share), own.lerp(next, share)));
            }
        }
        let corners: Vec<Corner> = polygon.into_iter().map(|(place, shares)| self.corner(place, shares)).collect();
        let triangle = |number: usize| Projected { corners: [corners[0], corners[number], corners[number + 1]], of };
        (1..corners.len().saturating_sub(1)).map(triangle).collect()
    }

    fn corner(&self, seen: DVec3, shares: DVec3) -> Corner {
        Corner { pixel: self.camera.pixel_of(seen), depth: seen.z, shares }
    }

    fn is_perspective(&self) -> bool {
        matches!(self.camera.projection, Projection::Perspective { .. })
    }

    /// Draws the triangles of a band of rows from row `first` on.
    fn draw_band(
        &self,
        first: usize,
        (depths, pixels): (&mut [f32], &mut [[f32; 4]]),
        triangles: &[Projected],
        numbers: &[u32],
    ) {
        let width = self.camera.size[0] as usize;
        let rows = pixels.len() / width;
        // The nearest depth of each sample, and its triangle.
        let mut nearest = vec![(f64::INFINITY, u32::MAX); width * rows * ALL];
        for &number in numbers {
            let triangle = &triangles[number as usize];
            let Some(plane) = Plane::new(triangle, self.is_perspective()) else { continue };
            let [left, right] = ends(triangle.corners.map(|corner| corner.pixel.x), width as u32);
            let [top, bottom] = ends(triangle.corners.map(|corner| corner.pixel.y), (first + rows) as u32);
            for row in top.max(first)..bottom {
                for column in left..right {
                    let samples = &mut nearest[((row - first) * width + column) * ALL..][..ALL];
                    for (at, sample) in samples.iter_mut().enumerate() {
                        let hit = plane.hit(place(column, row, at)).filter(|hit| hit.depth < sample.0);
                        if let Some(hit) = hit {
                            *sample = (hit.depth, number);
                        }
                    }
                }
            }
        }
        for (at, samples) in nearest.chunks_exact(ALL).enumerate() {
            let (column, row) = (at % width, first + at / width);
            let mut hits: Vec<(f64, u32, usize)> = samples
                .iter()
                .enumerate()
                .filter(|(_, (_, number))| *number != u32::MAX)
                .map(|(sample, &(depth, number))| (depth, number, sample))
                .collect();
            if hits.is_empty() {
                continue;
            }
            hits.sort_by(|a, b| a.0.total_cmp(&b.0));
            depths[at] = self.depth(&hits, triangles, [column, row]) as f32;
            pixels[at] = self.color(&mut hits, triangles, [column, row]);
        }
    }

    /// Returns the depth of a pixel: of the triangle of the median of its samples, in the middle of the pixel, or as
    /// near to it as samples are.
    fn depth(&self, hits: &[(f64, u32, usize)], triangles: &[Projected], [column, row]: [usize; 2]) -> f64 {
        let (median, number, _) = hits[hits.len() / 2];
        let middle = DVec2::new(column as f64 + 0.5, row as f64 + 0.5);
        let plane = Plane::new(&triangles[number as usize], self.is_perspective());
        let depth = plane.map_or(median, |plane| plane.at(middle).depth);
        depth.clamp(hits[0].0, hits[hits.len() - 1].0)
    }

    /// Returns the premultiplied colour of a pixel: each triangle is lit once, in the middle of its samples.
    fn color(&self, hits: &mut [(f64, u32, usize)], triangles: &[Projected], [column, row]: [usize; 2]) -> [f32; 4] {
        hits.sort_by_key(|(_, number, sample)| (*number, *sample));
        let mut color = [0.0; 3];
        for group in hits.chunk_by(|a, b| a.1 == b.1) {
            let triangle = &triangles[group[0].1 as usize];
            let middle = group.iter().map(|(.., sample)| place(column, row, *sample)).sum::<DVec2>();
            let Some(plane) = Plane::new(triangle, self.is_perspective()) else { continue };
            let lit = self.lit(triangle, &plane.at(middle / group.len() as f64));
            color.iter_mut().zip(lit).for_each(|(sum, channel)| *sum += channel * group.len() as f64 / ALL as f64);
        }
        let [r, g, b] = color.map(|channel| channel as f32);
        [r, g, b, hits.len() as f32 / ALL as f32]
    }

    /// Returns the lit colour of a place of a triangle.
    fn lit(&self, triangle: &Projected, hit: &Hit) -> [f64; 3] {
        let [mesh, number] = triangle.of.map(|number| number as usize);
        let solid = &self.solids[mesh];
        let vertices = solid.mesh.triangles[number];
        let shares = hit.shares.to_array();
        let mixed = |of: &dyn Fn(usize) -> DVec3| (0..3).map(|corner| of(corner) * shares[corner]).sum::<DVec3>();
        let color = if solid.mesh.colors.is_empty() {
            solid.color
        } else {
            let own =
                |corner: usize| solid.mesh.colors[vertices[corner] as usize].map(|channel| f64::from(channel) / 255.0);
            mixed(&|corner| DVec3::from_array(own(corner))).to_array()
        };
        let normal = mixed(&|corner| self.normals[mesh][number][corner]);
        let place = mixed(&|corner| solid.mesh.place(vertices[corner]));
        let to_eye =
            self.camera.eye().map_or(-self.camera.forward, |eye| (eye - place).normalize_or(-self.camera.forward));
        self.lighting.shade(color.map(|channel| self.exposure * channel), normal, place, to_eye, &Visibility::FULL)
    }
}

/// Returns the place of sample number `at` of a pixel.
fn place(column: usize, row: usize, at: usize) -> DVec2 {
    let offset = |n: usize| (n as f64 + 0.5) / SAMPLES as f64;
    DVec2::new(column as f64 + offset(at % SAMPLES), row as f64 + offset(at / SAMPLES))
}

/// A projected triangle as linear functions of the place in the picture.
struct Plane<'a> {
    corners: &'a [Corner; 3],
    /// Twice the area of the triangle, signed.
    area: f64,
    perspective: bool,
}

impl<'a> Plane<'a> {
    /// Makes the linear functions of a triangle; `None` if it is seen from its edge.
    fn new(triangle: &'a Projected, perspective: bool) -> Option<Self> {
        let corners = &triangle.corners;
        let area = (corners[1].pixel - corners[0].pixel).perp_dot(corners[2].pixel - corners[0].pixel);
        (area != 0.0 && area.is_finite()).then_some(Self { corners, area, perspective })
    }

    /// Returns the weights of the corners at a place in the picture; all are at least 0 inside.
    fn weights(&self, place: DVec2) -> DVec3 {
        let [a, b, c] = self.corners.map(|corner| corner.pixel - place);
        DVec3::new(b.perp_dot(c), c.perp_dot(a), a.perp_dot(b)) / self.area
    }

    fn hit(&self, place: DVec2) -> Option<Hit> {
        let weights = self.weights(place);
        (weights.min_element() >= 0.0).then(|| self.at_weights(weights))
    }

    /// Returns the hit of the triangle's plane, inside the triangle or not.
    fn at(&self, place: DVec2) -> Hit {
        self.at_weights(self.weights(place))
    }

    /// Returns the hit at the given weights of the corners. In perspective 1 / depth and shares / depth are linear in
    /// the picture (Heckbert and Moreton 1991, "Interpolation for polygon texture mapping and shading").
    fn at_weights(&self, weights: DVec3) -> Hit {
        let weights = if self.perspective {
            weights / DVec3::from_array(self.corners.map(|corner| corner.depth))
        } else {
            weights
        };
        let weights = weights / weights.element_sum();
        let depth = weights.dot(DVec3::from_array(self.corners.map(|corner| corner.depth)));
        let shares = (0..3).map(|corner| self.corners[corner].shares * weights[corner]).sum();
        Hit { depth, shares }
    }
}
