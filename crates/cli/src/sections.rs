//! Sections beside a picture, and planes in it.

use glam::DVec3;
use voxsplat::figure::{Figure, Shown, Slices};
use voxsplat::image::{Background, Ground, Image, SectionPlane};
use voxsplat::layers::Layers;
use voxsplat::program::PlaneSpec;
use voxsplat::volume::Volume;

use super::failure::Failure;

/// The sections around a picture.
#[derive(Debug, Clone)]
pub(crate) struct Sections {
    pub(crate) planes: Vec<PlaneSpec>,
    /// The point through which planes without a place of their own go; `None`: the middle of the volume.
    pub(crate) at: Option<DVec3>,
    /// Width and height of the figure, pixels.
    pub(crate) size: [u32; 2],
    /// Title and caption of the figure.
    pub(crate) texts: Figure,
}

impl Sections {
    /// Returns the planes of the figure.
    pub(crate) fn planes(&self, volume: &Volume) -> Result<Vec<SectionPlane>, Failure> {
        Ok(PlaneSpec::planes(&self.planes, volume, self.at)?)
    }

    /// Draws the figure around a picture.
    pub(crate) fn draw(
        &self,
        picture: &Image,
        (layers, ground): (&Layers, Ground),
        background: Background,
        shown: &Shown<'_>,
    ) -> Result<Image, Failure> {
        let planes = self.planes(shown.volume)?;
        let slices = Slices { layers, ground, planes: &planes, size: self.size, texts: &self.texts };
        Ok(slices.draw(picture, background, shown)?)
    }
}
