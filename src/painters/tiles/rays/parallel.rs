//! Parallel rays: their intermediate image lies in plane 0 of the volume, with whole numbers of rays per voxel along a
//! and b, so that rays meet every plane alike and can share footprints.

use glam::{DMat2, DVec2, DVec3};

use super::{
    FIRST_PIXEL, RaySetup, Rays, SPLINE_MARGIN, ends, f2, f3, first_pixel, level_for_depth, level_for_kernel,
    max_depth, smoothstep,
};
use crate::gpu::layout;
use crate::image::Region;
use crate::painters::tiles::Block;
use crate::stats::RaySpacing;

/// Voxels of a row, and rows at least and at most, that `eight` in shaders/gather.wgsl reads of a plane.
const BLOCK_COLUMNS: f64 = 5.0;
const BLOCK_ROWS: [f64; 2] = [5.0, 7.0];

/// Rays per voxel along an axis, as a power of 2, if rays move by `shear` voxels along it from plane to plane. If that
/// is close to a whole number, the ripple and the rims of kernels in plane after plane fall on one another, and one ray
/// per voxel misses the matter between.
///
/// Measured; docs/measurements/2026-11-22-rays.md has the table, 2026-11-22-near-straight.md what was changed.
fn level_for_shear(shear: f64) -> f64 {
    let whole = shear.round();
    let off = (shear - whole).abs();
    if whole == 0.0 { ramp(0.09, 0.05, off) + ramp(0.22, 0.15, off) } else { ramp(0.07, 0.03, off) }
}

/// 0 at `zero` and beyond, 1 at `one` and beyond, straight between.
fn ramp(zero: f64, one: f64, value: f64) -> f64 {
    ((value - zero) / (one - zero)).clamp(0.0, 1.0)
}

/// Rays per voxel along a and b, as powers of 2.
fn levels(setup: &RaySetup<'_>) -> DVec2 {
    let least = level_for_depth(max_depth(setup.job)).max(level_for_kernel(&setup.kernel));
    setup.axis.shear().map(|shear| level_for_shear(shear).max(least))
}

/// The least share of its own ray in each pixel: all of it if rays run along the axis, if kernels ask for more than
/// four rays a voxel, if voxels are as small as pixels, or if there would be more rays than pixels.
pub(super) fn pixel_share(setup: &RaySetup<'_>) -> f64 {
    // Wherever a share is between 0 and 1, the rays of pixels and of images are marched: in few views.
    let straight = setup.axis.shear().map(|shear| smoothstep(0.035, 0.03, shear.abs()));
    let levels = levels(setup);
    let magnification = setup.job.view.grid.min_spacing() / setup.pixel();
    let rays_per_pixel = levels.map(marched).element_product() / (magnification * magnification);
    let shares = [
        straight.element_product(),
        smoothstep(2.0, 2.5, levels.max_element()),
        smoothstep(1.3, 1.0, magnification),
        smoothstep(1.0, 1.1, rays_per_pixel),
    ];
    shares.into_iter().fold(0.0, f64::max)
}

/// The powers of 2 around the rays per voxel along an axis, with their shares.
fn powers(level: f64) -> [(u32, f64); 2] {
    let level = level.min(2.0);
    // The nearest alone, close to it: a share that does not show is not worth a march.
    let more = smoothstep(0.1, 0.9, level.fract());
    [(level.floor(), 1.0 - more), (level.floor() + 1.0, more)].map(|(level, share)| (level.exp2() as u32, share))
}

/// Rays per voxel along an axis that are marched, of both powers of 2. From a share of an eighth on they count whole,
/// so that nothing jumps.
fn marched(level: f64) -> f64 {
    powers(level).map(|(rays, share)| f64::from(rays) * (8.0 * share).min(1.0)).into_iter().sum()
}

/// The eight pixels of a region that best share the voxels that their rays along the axis meet.
pub(in crate::painters::tiles) fn block(setup: &RaySetup<'_>, region: Region) -> Option<Block> {
    let [_, step_x, step_y] = pixels_at(setup, first_pixel(region));
    block_of(step_x, step_y, setup.kernel.radius())
}

/// The block that meets the fewest rows. `None` if pixels are too large for blocks, or too oblique to the rows.
fn block_of(step_x: DVec2, step_y: DVec2, radius: f64) -> Option<Block> {
    let blocks = [2, 4].into_iter().filter_map(|across: u32| {
        let extent = step_x.abs() * f64::from(across - 1) + step_y.abs() * f64::from(8 / across - 1);
        // A kernel whose rim touches a ray adds nothing to it; the rest is for rounding.
        let voxels = (extent + 2.0 * radius - 1e-6).ceil();
        (voxels.x <= BLOCK_COLUMNS && voxels.y <= BLOCK_ROWS[1])
            .then(|| Block { across, rows: voxels.y.max(BLOCK_ROWS[0]) as u32 })
    });
    blocks.min_by_key(|block| block.rows)
}

/// The rays of pixels, numbered from the first pixel of the picture.
pub(super) fn pixel_rays(setup: &RaySetup<'_>, common: layout::Rays) -> Rays {
    let [first, step_x, step_y] = pixels_at(setup, FIRST_PIXEL);
    let uniforms = layout::Rays {
        origin: f2(first),
        step_x: f2(step_x),
        step_y: f2(step_y),
        pixel_x: [1.0, 0.0],
        pixel_y: [0.0, 1.0],
        // The images that these rays refine have shares.
        ..along(setup, common)
    };
    Rays { uniforms, spacing: RaySpacing::Pixels(1.0) }
}

/// The rays of intermediate images: with the powers of 2 around the rays per voxel of [`levels`].
pub(super) fn image_rays(setup: &RaySetup<'_>, region: Region, common: layout::Rays) -> Vec<Rays> {
    let [a, b] = levels(setup).to_array().map(powers);
    let common = along(setup, common);
    let mut images = Vec::new();
    for ((a, share_a), (b, share_b)) in b.into_iter().flat_map(|b| a.map(|a| (a, b))) {
        let share = share_a * share_b;
        let Some(points) = through_points(setup, region, [a, b], common).filter(|_| share > 0.0) else { continue };
        let uniforms = layout::Rays { share: (setup.axis.share * share) as f32, ..points };
        images.push(Rays { uniforms, spacing: RaySpacing::PerVoxel([a, b]) });
    }
    images
}

/// The uniforms of rays along an axis.
fn along(setup: &RaySetup<'_>, common: layout::Rays) -> layout::Rays {
    let radius = setup.kernel.radius();
    let (direction, shear) = (setup.axis.direction, setup.axis.shear());
    // A kernel is a ball of the lattice: at distance v along b it reaches a ray from within row_half of row_slope v.
    let square = 1.0 - direction.x * direction.x;
    layout::Rays {
        shear: f2(shear),
        direction: f3(direction),
        stretch: setup.axis.stretch as f32,
        row_half: (radius / square.sqrt()) as f32,
        row_slope: (direction.x * direction.y / square) as f32,
        footprint_half: f2(footprint_half(radius, shear)),
        ..common
    }
}

/// Where the ray of a pixel meets plane 0, and the steps to its neighbours' in x and y.
fn pixels_at(setup: &RaySetup<'_>, pixel: DVec2) -> [DVec2; 3] {
    let shear = setup.axis.shear();
    let base = |p: DVec2| {
        let (camera, plane) = (&setup.job.view.camera, setup.plane(p));
        let p = setup.placed(camera.target + (camera.right * plane.x + camera.up * plane.y));
        p.truncate() - shear * p.z
    };
    let first = base(pixel);
    [first, base(pixel + DVec2::X) - first, base(pixel + DVec2::Y) - first]
}

/// The distance along a and b, from where a ray meets a plane, within which the kernels that reach it are centred.
fn footprint_half(radius: f64, shear: DVec2) -> DVec2 {
    radius * (DVec2::ONE + shear * shear).map(f64::sqrt)
}

/// The rays through the points of an intermediate image, `per_voxel` along a and b; `None` if no ray of the region
/// reaches the volume.
fn through_points(
    setup: &RaySetup<'_>,
    region: Region,
    per_voxel: [u32; 2],
    common: layout::Rays,
) -> Option<layout::Rays> {
    let shear = setup.axis.shear();
    let [first, pixel_x, pixel_y] = pixels_at(setup, first_pixel(region));
    let steps = DVec2::from_array(per_voxel.map(f64::from)).recip();
    // The part of the volume that the region sees, in base coordinates.
    let volume_ends = base_ends(setup, shear);
    let extent = DVec2::new(f64::from(region.width), f64::from(region.height)) - 1.0;
    let [low, high] = ends(first, pixel_x, pixel_y, [DVec2::ZERO, extent]);
    let (low, high) = (low.max(volume_ends[0]), high.min(volume_ends[1]));
    if low.cmpgt(high).any() {
        return None;
    }
    // Whole steps from the ray through the first voxel of the volume: the same rays whatever part of it is packed, and
    // whatever the region.
    let anchor = setup.placed(setup.job.view.grid.to_world().translation);
    let anchor = anchor.truncate() - shear * anchor.z;
    let origin = anchor + steps * (((low - anchor) / steps).floor() - SPLINE_MARGIN);
    let count = ((high - origin) / steps + SPLINE_MARGIN).ceil() + 1.0;
    let to_points = DMat2::from_diagonal(steps.recip());
    Some(layout::Rays {
        origin: f2(origin),
        step_x: [steps.x as f32, 0.0],
        step_y: [0.0, steps.y as f32],
        phases: per_voxel,
        size: [count.x as u32, count.y as u32],
        pixel_origin: f2(to_points * (first - origin)),
        pixel_x: f2(to_points * pixel_x),
        pixel_y: f2(to_points * pixel_y),
        ..common
    })
}

/// The least and the largest base coordinates of rays that reach a kernel of the packed box.
fn base_ends(setup: &RaySetup<'_>, shear: DVec2) -> [DVec2; 2] {
    let first = setup.first();
    let last = first + DVec3::from_array(setup.packing.dims.map(f64::from)) - 1.0;
    let half = footprint_half(setup.kernel.radius(), shear);
    // How far rays move from plane 0 to the first plane of the box, and to the last.
    let [near, far] = [first, last].map(|end| shear * end.z);
    [first.truncate() - half - near.max(far), last.truncate() + half - near.min(far)]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rays_that_move_in_step_with_the_lattice_are_closer() {
        // Along an axis, near it, away from it; near a whole shear, away from it.
        let expected = [(0.0, 2.0), (0.05, 2.0), (0.1, 1.0), (0.15, 1.0), (0.22, 0.0), (0.5, 0.0), (0.93, 0.0)];
        for (shear, level) in expected.into_iter().chain([(0.97, 1.0), (1.0, 1.0), (-1.0, 1.0)]) {
            assert!((level_for_shear(shear) - level).abs() < 1e-12, "{shear}: {level}");
        }
    }

    #[test]
    fn blocks_of_pixels_meet_few_rows() {
        let along = |step: f64, degrees: f64| {
            let step_x = DVec2::from_angle(degrees.to_radians()) * step;
            block_of(step_x, step_x.perp(), 2.0)
        };
        let block = |across, rows| Some(Block { across, rows });
        // From many pixels a voxel to one, upright and turned by a right angle.
        for degrees in [0.0, 180.0] {
            assert_eq!(along(0.1, degrees), block(2, 5));
            assert_eq!(along(0.5, degrees), block(2, 6));
            assert_eq!(along(1.0, degrees), block(2, 7));
        }
        assert_eq!(along(0.5, 90.0), block(4, 6));
        // Turned otherwise.
        assert_eq!(along(0.3, 45.0), block(2, 5));
        assert_eq!(along(0.5, 45.0), None);
        // Narrower kernels, larger pixels.
        assert_eq!(block_of(DVec2::X * 4.0, DVec2::Y, 1.0), None);
        assert_eq!(block_of(DVec2::X * 3.0, DVec2::Y * 1.5, 1.0), block(2, 7));
    }

    #[test]
    fn footprints_widen_with_the_shear() {
        assert_eq!(footprint_half(2.0, DVec2::new(0.0, 1.0)), DVec2::new(2.0, 2.0 * 2.0_f64.sqrt()));
    }
}
