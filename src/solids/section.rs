//! Planes in pictures, with the sections of a volume on them.

use rayon::prelude::*;

use super::Solids;
use crate::camera::Camera;
use crate::error::Result;
use crate::image::{DepthMap, Ground, Image, SectionPlane, section};
use crate::layers::Layers;
use voxsplat_volume::memory::reserved;

/// The brightness below which a section is translucent.
const BLACK: f32 = 0.06;
/// The largest number of pixels along a side of a section.
const MOST_PIXELS: f64 = 4096.0;

impl Solids {
    /// Draws planes through layers as a camera sees them: each shows its section, unlit, inside the box of the voxels,
    /// and is clear where the section is black. Both sides are visible. `None` without planes.
    ///
    /// # Errors
    /// The errors of [`section`].
    pub fn of_planes(
        planes: &[SectionPlane],
        layers: &Layers,
        ground: Ground,
        camera: &Camera,
    ) -> Result<Option<Self>> {
        camera.validate()?;
        let drawn = planes.iter().map(|plane| of_plane(plane, layers, ground, camera)).collect::<Result<Vec<_>>>()?;
        Self::seen(&[], drawn, camera, None)
    }
}

fn of_plane(plane: &SectionPlane, layers: &Layers, ground: Ground, camera: &Camera) -> Result<Solids> {
    let (grid, forward) = (layers.grid(), plane.forward.normalize_or_zero());
    // A section with the pixels of the picture, of the whole box.
    let reach = grid.corners_from_center(0.5).map(|corner| 2.0 * corner.length()).into_iter().fold(0.0, f64::max);
    let side = (reach / camera.pixel_size().abs()).ceil().clamp(2.0, MOST_PIXELS);
    let pixel = reach / side;
    let seen = plane.camera(grid, pixel, [side as u32; 2])?;
    let mut texture = section(layers, &seen, ground)?;
    // Black is empty space, which does not hide the volume; a ramp hides the grain of nearly empty space.
    texture.pixels_mut().par_iter_mut().for_each(|pixel| {
        let share = (pixel[..3].iter().fold(0.0_f32, |most, channel| most.max(*channel)) / BLACK).min(1.0);
        *pixel = pixel.map(|channel| share * channel);
    });
    let [width, height] = camera.size;
    let count = u64::from(width) * u64::from(height);
    let mut pixels: Vec<([f32; 4], f32)> = reserved(count, || "a plane".to_owned())?;
    let at = |index: usize| {
        let (sx, sy) = camera.image_coordinates([index as u32 % width, index as u32 / width]);
        let (origin, direction) = camera.ray(sx, sy);
        let along = (plane.point - origin).dot(forward) / direction.dot(forward);
        let is_seen = along.is_finite() && (along > 0.0 || camera.eye().is_none());
        let place = origin + direction * along;
        let offset = (place - seen.target) / pixel;
        let color = if is_seen { between(&texture, offset.dot(seen.right), offset.dot(seen.up)) } else { [0.0; 4] };
        let from = camera.eye().unwrap_or(camera.target);
        (color, if color[3] > 0.0 { (place - from).dot(camera.forward) as f32 } else { f32::INFINITY })
    };
    (0..count as usize).into_par_iter().map(at).collect_into_vec(&mut pixels);
    let (pixels, depths) = pixels.into_iter().unzip();
    Ok(Solids { depths: DepthMap::new(width, height, depths)?, image: Some(Image::new(width, height, pixels)?) })
}

/// Returns the colour of a square picture at a place, pixels to the right and up from its middle: linear between the
/// middles of pixels, clear outside.
fn between(image: &Image, right: f64, up: f64) -> [f32; 4] {
    let half = f64::from(image.width()) / 2.0;
    let [x, y] = [half + right - 0.5, half - up - 0.5];
    let last = f64::from(image.width()) - 1.0;
    let pixel = |x: f64, y: f64| {
        let is_inside = (0.0..=last).contains(&x) && (0.0..=last).contains(&y);
        if is_inside { image.at([x as u32, y as u32]) } else { [0.0; 4] }
    };
    let (left, top) = (x.floor(), y.floor());
    let [u, v] = [(x - left) as f32, (y - top) as f32];
    let [a, b, c, d] = [(0.0, 0.0), (1.0, 0.0), (0.0, 1.0), (1.0, 1.0)].map(|(i, j)| pixel(left + i, top + j));
    std::array::from_fn(|n| (1.0 - v) * ((1.0 - u) * a[n] + u * b[n]) + v * ((1.0 - u) * c[n] + u * d[n]))
}
