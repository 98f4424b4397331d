//! The light on splats as shaders/common/lit_splat.wgsl reads it.

use super::layout::Lighting;

/// The directions from lattice points to the eye.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct ToEye {
    /// Whether rays go through one eye; otherwise they are parallel.
    pub(crate) perspective: bool,
    /// The lattice point of the eye.
    pub(crate) eye: [f32; 3],
    /// The view coordinates of a step along each axis of the lattice.
    pub(crate) view: [[f32; 3]; 3],
}

impl ToEye {
    /// The directions along parallel rays: all the same.
    pub(crate) const PARALLEL: Self = Self { perspective: false, eye: [0.0; 3], view: [[0.0; 3]; 3] };
}

/// The lights of a picture, as shaders of splats read them.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct SplatLight {
    pub(crate) lighting: Lighting,
    /// The number of lights.
    pub(crate) lights: u32,
    /// Whether a light has a position.
    pub(crate) points: bool,
    pub(crate) to_eye: ToEye,
}
