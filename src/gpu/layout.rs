//! The structs that Rust and WGSL share, in one place; a test compares names, offsets and sizes with the shaders.

use bytemuck::{Pod, Zeroable};
use glam::{DAffine3, DVec4};

use crate::clip::Clip;

/// A classified voxel; shaders/common/splat.wgsl explains the words.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
pub(crate) struct Splat {
    pub place: u32,
    pub density_blue: u32,
    pub color: u32,
    pub normal: u32,
}

/// The words of a classified voxel that light is kept from: those of [`Splat`], and two more.
pub(crate) const SHADED_WORDS: usize = 6;

/// The words of a splat of a scalar that is not lit, and of one that is; shaders/common/splat.wgsl explains them.
pub(crate) const SCALAR_WORDS: usize = 2;
pub(crate) const LIT_SCALAR_WORDS: usize = 4;

/// The words of a gradient, three steps of 18 bits: `splat_gradient` in shaders/common/splat.wgsl.
pub(crate) fn packed_gradient(gradient: [f32; 3]) -> [u32; 2] {
    // The largest component has 16 bits before the point, one more for the sign, and one for its mantissa up to 2.
    const BITS: i32 = 16;
    const LARGEST: f64 = 131_071.0;
    let exponent = gradient.iter().fold(0.0_f32, |largest, c| largest.max(c.abs())).to_bits() >> 23;
    if exponent == 0 {
        return [0; 2];
    }
    let scale = f64::from(BITS - (exponent as i32 - 127)).exp2();
    let step = |c: f32| (f64::from(c) * scale).round().clamp(-LARGEST, LARGEST) as i32 as u32 & 0x3ffff;
    let [x, y, z] = gradient.map(step);
    [x | y << 18, y >> 14 | z << 4 | exponent << 22]
}

/// The bit of a place at which the number of its brick begins: 5 bits of each of x, y and z are below.
pub(crate) const BRICK_SHIFT: u32 = 15;

/// The place of a voxel in a brick, and the brick's number in the store.
pub(crate) fn place([x, y, z]: [u32; 3], brick: u32) -> u32 {
    x | y << 5 | z << 10 | brick << BRICK_SHIFT
}

/// The most bricks that a place can tell apart.
pub(crate) const MAX_BRICKS: usize = 1 << (u32::BITS - BRICK_SHIFT);

/// An affine map as a matrix of 4 columns and 3 rows: x, y, z and what is added. The last number of each is not read.
pub(crate) type Affine = [[f32; 4]; 4];

/// An affine map as shaders have it.
pub(crate) fn affine(map: &DAffine3) -> Affine {
    [map.x_axis, map.y_axis, map.z_axis, map.translation].map(|column| column.as_vec3().extend(0.0).to_array())
}

/// Parameters of `classify`; shaders/classify.wgsl.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
pub(crate) struct Classify {
    pub dims: [u32; 3],
    pub bricks: u32,
    pub gradient_x: [f32; 3],
    pub points: u32,
    pub gradient_y: [f32; 3],
    pub sample_origin: f32,
    pub gradient_z: [f32; 3],
    pub first_brick: u32,
    pub gradient_points: u32,
    pub base: f32,
    pub faintest: f32,
    pub _pad: u32,
    pub inline_points: [ControlPoint; MAX_INLINE_POINTS],
}

/// The most control points that a sample is compared with one after the other; shaders/classify.wgsl.
pub(crate) const MAX_INLINE_POINTS: usize = 32;

/// A control point of the transfer function in the units of the samples; shaders/classify.wgsl.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
pub(crate) struct ControlPoint {
    pub color: [f32; 3],
    pub sample: f32,
    pub opacity: f32,
    pub _pad: [f32; 3],
}

/// Clipping planes, of which pipelines read as many as they are specialised for; shaders/common/clip.wgsl.
pub(crate) type ClipPlanes = [[f32; 4]; Clip::MAX_PLANES];

/// Clipping planes as shaders have them.
pub(crate) fn clip_planes(planes: impl Iterator<Item = DVec4>) -> ClipPlanes {
    let mut slots = ClipPlanes::default();
    slots.iter_mut().zip(planes).for_each(|(slot, plane)| *slot = plane.as_vec4().to_array());
    slots
}

/// What all stages of one frame share; each field is explained in shaders/common/frame.wgsl.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
pub(crate) struct Frame {
    pub lattice_center: [f32; 3],
    pub radius: f32,
    pub view_x: [f32; 3],
    pub offset_x: f32,
    pub view_y: [f32; 3],
    pub offset_y: f32,
    pub view_z: [f32; 3],
    pub eye_depth: f32,
    pub grid_right: [f32; 3],
    pub depth_extent: f32,
    pub grid_up: [f32; 3],
    pub sheet_origin: f32,
    pub grid_forward: [f32; 3],
    pub sheet_step: f32,
    pub pixel_scale: [f32; 2],
    pub pixel_offset: [f32; 2],
    pub clip_scale: [f32; 2],
    pub clip_offset: [f32; 2],
    pub quad_pad: [f32; 2],
    pub section_scale: f32,
    pub inverse_sheet_scale: f32,
    pub region: [u32; 2],
    pub sheets: u32,
    pub inverse_sheet_step: f32,
    pub plane_axis: [f32; 3],
    pub plane_offset: f32,
    pub box_half: [f32; 3],
    pub opaque_depth: f32,
    pub growth: [f32; 2],
    pub home_slope: [f32; 2],
    pub tiles: u32,
    pub tile_size: u32,
    pub level_spread: f32,
    pub _pad: u32,
    pub model: [f32; 4],
    pub clip_planes: ClipPlanes,
}

/// Parameters of `sort`; shaders/sort.wgsl.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
pub(crate) struct Sort {
    pub blocks: u32,
    pub batches: u32,
    pub sheets_per_batch: u32,
}

/// What one batch of sheets adds to the frame; shaders/splat.wgsl.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
pub(crate) struct Batch {
    pub depth: f32,
    pub first_sheet: u32,
}

/// A rectangle of pixels in the buffers of a region, from its first pixel to the one after its last; empty by default;
/// `Area` in shaders/composite.wgsl.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Eq, Pod, Zeroable)]
pub(crate) struct Area {
    pub low: [u32; 2],
    pub high: [u32; 2],
}

impl Default for Area {
    fn default() -> Self {
        Self { low: [u32::MAX; 2], high: [0; 2] }
    }
}

impl Area {
    /// The smallest area that holds both.
    pub(crate) fn joined(self, other: Self) -> Self {
        Self {
            low: std::array::from_fn(|a| self.low[a].min(other.low[a])),
            high: std::array::from_fn(|a| self.high[a].max(other.high[a])),
        }
    }

    pub(crate) fn size(self) -> [u32; 2] {
        std::array::from_fn(|a| self.high[a].saturating_sub(self.low[a]))
    }
}

/// Material and lights in view coordinates; shaders/common/lighting.wgsl.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Default, Pod, Zeroable)]
pub(crate) struct Lighting {
    pub right: [f32; 3],
    pub ambient: f32,
    pub up: [f32; 3],
    pub diffuse: f32,
    pub forward: [f32; 3],
    pub specular: f32,
    pub lights: [[f32; 4]; 4],
    pub colors: [[f32; 4]; 4],
    pub from_lattice: Affine,
    pub shininess: f32,
    pub faintest: f32,
    pub _pad: [u32; 2],
}

/// The entries of a batch; shaders/terminate.wgsl.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
pub(crate) struct Terminate {
    pub first: u32,
    pub count: u32,
}

/// Where a region goes in the caller's texture; shaders/present.wgsl.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
pub(crate) struct Present {
    pub corner: [u32; 2],
    pub row: u32,
    pub _pad: u32,
}

/// How a batch of sheets of scalars is shaded; shaders/shade.wgsl.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
pub(crate) struct Shade {
    pub depth: f32,
    pub previous: f32,
    pub current: f32,
    pub gradient_lookup: f32,
    pub invisible: [f32; 2],
    pub lookup: [f32; 2],
    pub low: [u32; 2],
    pub high: [u32; 2],
    pub to_light: Affine,
}

/// The parts of a kernel in four slabs, by m0, m1 and m2; shaders/common/rays.wgsl.
pub(crate) type Section = [[f32; 4]; 3];
/// Entries of a table of sections, and tables; SECTIONS and SECTION_POWERS in shaders/common/rays.wgsl.
pub(crate) const SECTIONS: usize = 9;
pub(crate) const SECTION_POWERS: usize = 3;

/// Side in voxels of a macrocell, which rays skip as a whole; MACROCELL in shaders/common/packing.wgsl.
pub(crate) const MACROCELL: u32 = 4;
/// Texels of zeros before each row of packed voxels; MARGIN in shaders/common/packing.wgsl.
pub(crate) const MARGIN: u32 = 7;
/// Side of a tile, in rays; a workgroup of `single` is 8 x 8 rays, one of `eight` 8 blocks of 8.
pub(crate) const TILE: u32 = 8;

/// The rays of the painter `tiles` and the volume that they cross; each field is explained in shaders/common/rays.wgsl.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
pub(crate) struct Rays {
    pub origin: [f32; 2],
    pub step_x: [f32; 2],
    pub step_y: [f32; 2],
    pub shear: [f32; 2],
    pub direction: [f32; 3],
    pub stretch: f32,
    pub heading: [f32; 3],
    pub density_scale: f32,
    pub heading_x: [f32; 3],
    pub opaque_depth: f32,
    pub heading_y: [f32; 3],
    pub radius2: f32,
    pub middle: [f32; 3],
    pub row_half: f32,
    pub box_low: [f32; 3],
    pub row_slope: f32,
    pub box_high: [f32; 3],
    pub samples: u32,
    pub gradient_x: [f32; 3],
    pub unskipped: i32,
    pub gradient_y: [f32; 3],
    pub run_slots: u32,
    pub gradient_z: [f32; 3],
    pub flipped: i32,
    pub voxels: [i32; 3],
    pub columns: i32,
    pub footprint_half: [f32; 2],
    pub phases: [u32; 2],
    pub footprint: [f32; 4],
    pub footprint_high: [f32; 4],
    pub slope_origin: [f32; 2],
    pub slope_step: [f32; 2],
    pub invisible: [f32; 2],
    pub lookup: [f32; 2],
    pub size: [u32; 2],
    pub tiles: [u32; 2],
    pub clip_low: [u32; 2],
    pub clip_high: [u32; 2],
    pub pixel_origin: [f32; 2],
    pub pixel_x: [f32; 2],
    pub pixel_y: [f32; 2],
    pub picture: [u32; 2],
    pub brightest: [f32; 3],
    pub row_texels: i32,
    pub share: f32,
    pub least_refined: f32,
    pub fineness: f32,
    pub eye_plane: f32,
    pub growth_slope: [f32; 3],
    pub growth_middle: f32,
    pub growth_most: f32,
    pub growth_around: f32,
    pub fade_in: [f32; 2],
    pub fade_out: [f32; 2],
    pub gradient_lookup: f32,
    pub attenuation: f32,
    pub to_light: Affine,
    pub to_lattice: Affine,
    pub model: [f32; 4],
    /// Those of near slabs, then those of far ones.
    pub sections: [[[Section; SECTIONS]; SECTION_POWERS]; 2],
    pub clip_planes: ClipPlanes,
}

/// How splats are packed for the painter `tiles`; each field is explained in shaders/common/packing.wgsl.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
pub(crate) struct Pack {
    pub low: [u32; 3],
    pub first_splat: u32,
    pub axes: [u32; 3],
    pub rows: u32,
    pub columns: u32,
    pub row_texels: u32,
    pub width: u32,
    pub first_row: u32,
    pub row_count: u32,
    pub scale: f32,
    pub end_splat: u32,
    pub planes: u32,
    pub eye: [f32; 3],
    pub across: u32,
    pub view_x: [f32; 3],
    pub _pad_x: u32,
    pub view_y: [f32; 3],
    pub _pad_y: u32,
    pub view_z: [f32; 3],
    pub _pad_z: u32,
}

#[cfg(test)]
mod tests {
    use super::*;

    /// What `splat_gradient` makes of the words.
    fn unpacked([low, high]: [u32; 2]) -> [f64; 3] {
        let signed = |bits: u32| f64::from((bits << 14) as i32 >> 14);
        let steps = [low, low >> 18 | (high & 15) << 14, high >> 4].map(|bits| signed(bits & 0x3ffff));
        steps.map(|c| c * f64::from(f32::from_bits(high >> 22 << 23)) / 65536.0)
    }

    #[test]
    fn gradients_keep_their_directions_at_any_size() {
        for size in [1e-37_f32, 1e-20, 1e-3, 1.0, 1.999_999_9, 777.0, 1e38] {
            for direction in
                [[1.0, -1.0, 1.0], [-1.0, 1e-4, 0.0], [0.3, -0.7, 0.999], [0.0, 0.0, -1.0], [2e-6, 1.0, -0.5]]
            {
                let gradient = direction.map(|c| c * size);
                for (got, expected) in unpacked(packed_gradient(gradient)).into_iter().zip(gradient) {
                    assert!((got - f64::from(expected)).abs() <= 8e-6 * f64::from(size), "{gradient:?}: {got}");
                }
            }
        }
        assert_eq!(packed_gradient([0.0, -0.0, 0.0]), [0; 2]);
    }
}
