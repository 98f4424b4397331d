//! The structs that Rust and WGSL share, in one place; a test compares names, offsets and sizes with the shaders.

use bytemuck::{Pod, Zeroable};
use glam::{DAffine3, DVec4};

use crate::camera::clip::Clip;

/// A classified voxel; shaders/common/splat.wgsl explains the words.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
pub(crate) struct Splat {
    pub place: u32,
    pub density_blue: u32,
    pub color: u32,
    pub normal: u32,
}

/// The words of a [`Splat`].
pub(crate) const LIT_WORDS: usize = size_of::<Splat>() / 4;
/// The words of a classified voxel with shadows: the words of [`Splat`], and two of the light that arrives.
pub(crate) const SHADED_WORDS: usize = LIT_WORDS + 2;

/// The words of an unlit and of a lit splat of a scalar; shaders/common/splat.wgsl explains them.
pub(crate) const SCALAR_WORDS: usize = 2;
pub(crate) const LIT_SCALAR_WORDS: usize = 4;

/// Packs a gradient into words, three steps of 18 bits: `splat_gradient` in shaders/common/splat.wgsl.
pub(crate) fn packed_gradient(gradient: [f32; 3]) -> [u32; 2] {
    // The largest component has 16 bits before the point, one more for the sign, and one for its mantissa up to 2.
    const BITS: i32 = 16;
    const LARGEST: f64 = 131_071.0;
    let exponent = gradient.iter().fold(0.0_f32, |largest, c| largest.max(c.abs())).to_bits() >> 23;
    if exponent == 0 {
        return [0; 2];
    }
    let scale = libm::exp2(f64::from(BITS - (exponent as i32 - 127)));
    let step = |c: f32| (f64::from(c) * scale).round().clamp(-LARGEST, LARGEST) as i32 as u32 & 0x3ffff;
    let [x, y, z] = gradient.map(step);
    [x | y << 18, y >> 14 | z << 4 | exponent << 22]
}

/// Unpacks a gradient from its two words: `splat_gradient` in shaders/common/splat.wgsl.
pub(crate) fn unpacked_gradient([low, high]: [u32; 2]) -> [f32; 3] {
    let signed = |bits: u32| (bits << 14) as i32 >> 14;
    let steps = [low, low >> 18 | (high & 15) << 14, high >> 4].map(|bits| signed(bits & 0x3_ffff));
    let step = f32::from_bits(high >> 22 << 23) / 65_536.0;
    steps.map(|c| c as f32 * step)
}

/// The bit of a place at which the number of its brick begins; below are 5 bits each of x, y and z.
pub(crate) const BRICK_SHIFT: u32 = 15;

/// Packs the place of a voxel in a brick, and the brick's number in the store.
pub(crate) fn place([x, y, z]: [u32; 3], brick: u32) -> u32 {
    x | y << 5 | z << 10 | brick << BRICK_SHIFT
}

/// The largest number of bricks that a place can distinguish.
pub(crate) const MAX_BRICKS: usize = 1 << (u32::BITS - BRICK_SHIFT);

/// An affine map as a matrix of 4 columns and 3 rows: x, y, z and the translation. The last number of each column is
/// not read.
pub(crate) type Affine = [[f32; 4]; 4];

/// Converts an affine map to the form that shaders read.
pub(crate) fn affine(map: &DAffine3) -> Affine {
    [map.x_axis, map.y_axis, map.z_axis, map.translation].map(|column| column.as_vec3().extend(0.0).to_array())
}

/// Clipping planes, of which pipelines read as many as they are specialised for; shaders/common/clip.wgsl.
pub(crate) type ClipPlanes = [[f32; 4]; Clip::MAX_PLANES];

/// Converts clipping planes to the form that shaders read.
pub(crate) fn clip_planes(planes: impl Iterator<Item = DVec4>) -> ClipPlanes {
    let mut slots = ClipPlanes::default();
    slots.iter_mut().zip(planes).for_each(|(slot, plane)| *slot = plane.as_vec4().to_array());
    slots
}

/// Defines structs that shaders have too; a test compares the names and offsets of their fields.
macro_rules! shared {
    ($($(#[$attribute:meta])* struct $name:ident { $($(#[$doc:meta])* $field:ident: $type:ty,)* })*) => {$(
        $(#[$attribute])*
        #[repr(C)]
        #[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
        pub(crate) struct $name {
            $($(#[$doc])* pub $field: $type,)*
        }

        #[cfg(test)]
        impl $name {
            /// The fields with their offsets in bytes.
            pub(crate) const FIELDS: &[(&str, usize)] =
                &[$((stringify!($field), std::mem::offset_of!($name, $field))),*];
        }
    )*};
}

shared! {
    /// Parameters of `classify`; shaders/common/classified.wgsl.
    struct Classify {
        dims: [u32; 3],
        bricks: u32,
        gradient_x: [f32; 3],
        points: u32,
        gradient_y: [f32; 3],
        sample_origin: f32,
        gradient_z: [f32; 3],
        first_brick: u32,
        gradient_points: u32,
        base: f32,
        faintest: f32,
        _pad: u32,
    }

    /// A list of visible voxels; shaders/list.wgsl.
    struct List {
        first_brick: u32,
        first_splat: u32,
    }

    /// Parameters of the conversion of samples to scalars; shaders/common/scalars.wgsl.
    struct Scalars {
        dims: [u32; 3],
        padding: u32,
        origin: f32,
        rest: f32,
        factor: f32,
        first_brick: u32,
        end_brick: u32,
        first_plane: u32,
        planes: u32,
        most: f32,
    }

    /// Weighted sums of scalars along an axis; shaders/common/scalar_sums.wgsl.
    struct ScalarSums {
        dims: [u32; 3],
        count: u32,
        steps: [u32; 3],
        over: u32,
        axis: [u32; 3],
        under: u32,
        low: i32,
        first_in_block: i32,
        end_of_block: i32,
        first_y: u32,
        first_z: u32,
        _pad: [u32; 3],
    }

    /// Cells that become texels; shaders/common/cell_texels.wgsl.
    struct CellTexels {
        dims: [u32; 3],
        first_plane: u32,
        first: [u32; 3],
        planes: u32,
        differences: [f32; 3],
        first_row: u32,
        rows: u32,
        across: u32,
        beside: f32,
        own: f32,
    }

    /// Parameters of the conversion of scalars to extinctions; shaders/field_of_cells.wgsl.
    struct Occluders {
        gradient_x: [f32; 3],
        gradient_lookup: f32,
        gradient_y: [f32; 3],
        _pad_y: u32,
        gradient_z: [f32; 3],
        _pad_z: u32,
        low: [u32; 3],
        _pad_low: u32,
        lookup: [f32; 2],
        per_unit: f32,
        _pad: u32,
    }

    /// A box of voxels; shaders/common/voxel_box.wgsl.
    struct VoxelBox {
        low: [u32; 3],
        first: u32,
        dims: [u32; 3],
        end: u32,
        eye: [f32; 3],
        cells: u32,
        view_x: [f32; 3],
        first_x: i32,
        view_y: [f32; 3],
        over: u32,
        view_z: [f32; 3],
        under: u32,
        rows: u32,
        first_y: i32,
        first_plane: u32,
        _pad: u32,
    }

    /// A box of cells; shaders/cells.wgsl.
    struct CellBox {
        dims: [u32; 3],
        least: f32,
        bricks: [u32; 3],
        low: i32,
        over: u32,
        under: u32,
        planes: u32,
        _pad: u32,
    }

    /// The box of voxels on which light falls; shaders/common/light_box.wgsl.
    struct LightBox {
        low: [i32; 3],
        word: u32,
        dims: [u32; 3],
        shift: u32,
        middle: [f32; 3],
        strength: f32,
        clip_planes: ClipPlanes,
    }

    /// A part of a sweep of light; shaders/common/sweep.wgsl.
    struct Sweep {
        steps: [u32; 3],
        count: u32,
        dims: [u32; 3],
        first: u32,
        before: u32,
        filtered: u32,
        directions: u32,
        ahead: u32,
        adds: u32,
        lanes: u32,
        rays: [u32; 2],
    }

    /// The light from a place; shaders/converging.wgsl.
    struct Converging {
        place: [f32; 3],
        bias: f32,
        to_world_plane: [f32; 3],
        radius: f32,
        to_world_row: [f32; 3],
        direct: f32,
        to_world_column: [f32; 3],
        integral: f32,
        origin: [f32; 2],
        inverse_divisor: f32,
        steps: f32,
        strict: [u32; 2],
        _pad: [u32; 2],
    }

    /// A control point of the transfer function in the units of the samples; shaders/common/classified.wgsl.
    struct ControlPoint {
        color: [f32; 3],
        sample: f32,
        opacity: f32,
        _pad: [f32; 3],
    }

    /// The uniforms of all stages of a frame; each field is explained in shaders/common/frame.wgsl.
    struct Frame {
        lattice_center: [f32; 3],
        radius: f32,
        view_x: [f32; 3],
        offset_x: f32,
        view_y: [f32; 3],
        offset_y: f32,
        view_z: [f32; 3],
        eye_depth: f32,
        grid_right: [f32; 3],
        depth_extent: f32,
        grid_up: [f32; 3],
        sheet_origin: f32,
        grid_forward: [f32; 3],
        sheet_step: f32,
        pixel_scale: [f32; 2],
        pixel_offset: [f32; 2],
        clip_scale: [f32; 2],
        clip_offset: [f32; 2],
        quad_pad: [f32; 2],
        section_scale: f32,
        inverse_sheet_scale: f32,
        region: [u32; 2],
        sheets: u32,
        inverse_sheet_step: f32,
        plane_axis: [f32; 3],
        plane_offset: f32,
        box_half: [f32; 3],
        opaque_depth: f32,
        growth: [f32; 2],
        home_slope: [f32; 2],
        tiles: u32,
        tile_size: u32,
        solid_depth: [f32; 2],
        model: [f32; 4],
        owned_low: [f32; 3],
        _pad_low: u32,
        owned_high: [f32; 3],
        _pad_high: u32,
        picture_offset: [f32; 2],
        picture_corner: [u32; 2],
        clip_planes: ClipPlanes,
    }

    /// Parameters of `sort`; shaders/sort.wgsl.
    struct Sort {
        blocks: u32,
        batches: u32,
        sheets_per_batch: u32,
    }

    /// A batch of sheets of the frame; shaders/splat.wgsl.
    struct Batch {
        depth: f32,
        first_sheet: u32,
    }

    /// The pixels that a batch reaches, and its first sheet; `Reached` in shaders/composite.wgsl.
    struct Reached {
        low: [u32; 2],
        high: [u32; 2],
        depth: f32,
        _pad: u32,
    }

    /// Material and lights in view coordinates; shaders/common/lighting.wgsl.
    #[derive(Default)]
    struct Lighting {
        right: [f32; 3],
        ambient: f32,
        up: [f32; 3],
        diffuse: f32,
        forward: [f32; 3],
        specular: f32,
        lights: [[f32; 4]; 4],
        colors: [[f32; 4]; 4],
        from_lattice: Affine,
        shininess: f32,
        faintest: f32,
        _pad: [u32; 2],
    }

    /// The entries of a batch; shaders/terminate.wgsl.
    struct Terminate {
        first: u32,
        count: u32,
    }

    /// The place of a region in the caller's texture; shaders/present.wgsl.
    struct Present {
        corner: [u32; 2],
        row: u32,
        _pad: u32,
    }

    /// Parameters of the shading of a batch of sheets of scalars; shaders/shade.wgsl.
    struct Shade {
        depth: f32,
        previous: f32,
        current: f32,
        gradient_lookup: f32,
        invisible: [f32; 2],
        lookup: [f32; 2],
        low: [u32; 2],
        high: [u32; 2],
        per_unit: f32,
        _pad: [u32; 3],
        to_light: Affine,
    }

    /// The rays of the painter `tiles` and the volume that they cross; each field is explained in
    /// shaders/common/rays.wgsl.
    struct Rays {
        origin: [f32; 2],
        step_x: [f32; 2],
        step_y: [f32; 2],
        shear: [f32; 2],
        direction: [f32; 3],
        stretch: f32,
        heading: [f32; 3],
        density_scale: f32,
        heading_x: [f32; 3],
        opaque_depth: f32,
        heading_y: [f32; 3],
        radius2: f32,
        middle: [f32; 2],
        corner: [u32; 2],
        first: [i32; 3],
        row_half: f32,
        box_low: [f32; 3],
        row_slope: f32,
        box_high: [f32; 3],
        samples: u32,
        gradient_x: [f32; 3],
        unskipped: i32,
        gradient_y: [f32; 3],
        run_slots: u32,
        gradient_z: [f32; 3],
        flipped: i32,
        along_a: [i32; 3],
        lead: i32,
        along_b: [i32; 3],
        per_unit: f32,
        macrocells: [i32; 3],
        _pad_cells: u32,
        along_m: [i32; 3],
        _pad_m: u32,
        page_steps: [u32; 3],
        _pad_pages: u32,
        mark_steps: [i32; 3],
        _pad_steps: u32,
        mark_shift: [i32; 3],
        _pad_shift: u32,
        mark_bits: [u32; 3],
        _pad_bits: u32,
        voxels: [i32; 3],
        share: f32,
        footprint_half: [f32; 2],
        picture: [u32; 2],
        footprint: [f32; 4],
        footprint_high: [f32; 4],
        slope_origin: [f32; 2],
        slope_step: [f32; 2],
        invisible: [f32; 2],
        lookup: [f32; 2],
        tiles: [u32; 2],
        clip_low: [u32; 2],
        clip_high: [u32; 2],
        _pad_tiles: [u32; 2],
        brightest: [f32; 3],
        eye_plane: f32,
        growth_slope: [f32; 3],
        growth_middle: f32,
        growth_most: f32,
        growth_around: f32,
        fade_in: [f32; 2],
        fade_out: [f32; 2],
        gradient_lookup: f32,
        attenuation: f32,
        to_light: Affine,
        to_lattice: Affine,
        model: [f32; 4],
        view_depth: [f32; 4],
        owned_low: [f32; 3],
        _pad_low: u32,
        owned_high: [f32; 3],
        _pad_high: u32,
        clip_planes: ClipPlanes,
    }

    /// The parts of kernels in slabs, which all regions of a picture share; shaders/common/ray_geometry.wgsl.
    struct Tables {
        /// The sections of near slabs, then of far ones.
        sections: [[[Section; SECTIONS]; SECTION_POWERS]; 2],
    }

    /// The extent of the visible voxels of a brick, which the host reads; shaders/extents.wgsl.
    struct Extent {
        places: [u32; 4],
        pages: [u32; 16],
    }

    /// The table of the pages of a box; each field is explained in shaders/page_table.wgsl.
    struct PageTable {
        dims: [u32; 3],
        across: u32,
        steps: [u32; 3],
        down: u32,
    }

    /// The pages of a brick; shaders/page_table.wgsl.
    struct PagedBrick {
        low: [u32; 3],
        first: u32,
        pages: [u32; 16],
    }

    /// Parameters of packing splats for the painter `tiles`; each field is explained in shaders/common/packing.wgsl.
    struct Pack {
        low: [u32; 3],
        first_run: u32,
        eye: [f32; 3],
        across: u32,
        rows: u32,
        scale: f32,
        run_count: u32,
        planes: u32,
        view_x: [f32; 3],
        mark_reach: u32,
        view_y: [f32; 3],
        least_invisible: f32,
        view_z: [f32; 3],
        largest_invisible: f32,
        mark_shift: [u32; 3],
        _pad_shift: u32,
        mark_steps: [u32; 3],
        _pad_steps: u32,
        page_steps: [u32; 3],
        clears: u32,
    }
}

/// A rectangle of pixels in the buffers of a region, from its first pixel to the one after its last; empty by default.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Area {
    pub(crate) low: [u32; 2],
    pub(crate) high: [u32; 2],
}

impl Default for Area {
    fn default() -> Self {
        Self { low: [u32::MAX; 2], high: [0; 2] }
    }
}

impl Area {
    /// Returns the smallest area that holds both.
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

/// The parts of a kernel in four slabs, by m0, m1 and m2; shaders/common/rays.wgsl.
pub(crate) type Section = [[f32; 4]; 3];
/// Entries of a table of sections, and tables; SECTIONS and SECTION_POWERS in shaders/common/rays.wgsl.
pub(crate) const SECTIONS: usize = 9;
pub(crate) const SECTION_POWERS: usize = 3;

/// Side in voxels of a macrocell, which rays skip as a whole; MACROCELL in shaders/common/packing.wgsl.
pub(crate) const MACROCELL: u32 = 4;
/// Side in voxels of a cell of a macrocell; CELL in shaders/common/packing.wgsl.
pub(crate) const CELL: u32 = 2;
/// Side of a tile, in rays: a workgroup of `gather` is 8 x 8 rays.
pub(crate) const TILE: u32 = 8;

#[cfg(test)]
mod tests {
    use super::*;

    /// Unpacks a gradient as `splat_gradient` does in shaders/common/splat.wgsl.
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
