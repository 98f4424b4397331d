//! Voxels that are classified: their words, the bricks that hold them, and the classification of layers.

pub(crate) mod brick;
pub(crate) mod classification;
pub(crate) mod gradients;
pub(crate) mod layers;
pub(crate) mod words;
