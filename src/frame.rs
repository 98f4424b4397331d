//! Pictures that are requested of a scene.

use crate::camera::Camera;
use crate::error::Result;
use crate::image::{DepthMap, Region};
use crate::settings::Settings;
use crate::solids::Solids;
use crate::stats::Rendered;

/// A picture that is requested of a scene: a camera and settings, and optionally a part of the picture, or opaque
/// surfaces in it.
///
/// ```no_run
/// # use voxsplat::{Camera, Frame, Settings, image::Region, solids::Solids};
/// # fn frames(camera: &Camera, settings: &Settings, solids: &Solids) {
/// let whole = Frame::new(camera, settings);
/// let corner = Frame::new(camera, settings).region(Region { x: 0, y: 0, width: 64, height: 64 });
/// let with_surfaces = Frame::new(camera, settings).solids(solids);
/// # }
/// ```
#[derive(Debug, Clone, Copy)]
pub struct Frame<'a> {
    pub(crate) camera: &'a Camera,
    pub(crate) settings: &'a Settings,
    pub(crate) region: Region,
    pub(crate) surfaces: Surfaces<'a>,
}

/// Opaque surfaces in a picture.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Surfaces<'a> {
    None,
    /// Surfaces of another renderer, which lays the picture over its own.
    Depths(&'a DepthMap),
    Solids(&'a Solids),
}

impl<'a> Frame<'a> {
    /// Requests the whole picture of a camera.
    #[must_use]
    pub fn new(camera: &'a Camera, settings: &'a Settings) -> Self {
        let [width, height] = camera.size;
        Self { camera, settings, region: Region { x: 0, y: 0, width, height }, surfaces: Surfaces::None }
    }

    /// Requests a part of the picture: the image has the size of the region, and the bytes of this part of the whole
    /// picture.
    ///
    /// The painter `tiles` and the processor march only the rays of the region. `quads` draws the parts of the picture
    /// ([`Stats::parts`](crate::stats::Stats::parts)) that the region touches.
    #[must_use]
    pub fn region(self, region: Region) -> Self {
        Self { region, ..self }
    }

    /// Draws surfaces in the picture: the matter before them, and behind it the surfaces. Surfaces without colours only
    /// hide matter. `solids` has the size of the whole picture. Pixels without a surface are as without this call.
    ///
    /// The rectangle around the surfaces is drawn twice, with all matter and with the matter before them, unless they
    /// cover each of its pixels whole: behind the edge of a surface matter is visible too.
    #[must_use]
    pub fn solids(self, solids: impl Into<Option<&'a Solids>>) -> Self {
        Self { surfaces: solids.into().map_or(self.surfaces, Surfaces::Solids), ..self }
    }

    /// Hides the matter behind the surfaces of another renderer: the ray of each pixel ends at its depth.
    /// [`Image::over`](crate::Image::over) lays the picture over the picture of the other renderer. `depths` has the
    /// size of the whole picture. It replaces [`Frame::solids`].
    #[must_use]
    pub fn before(self, depths: impl Into<Option<&'a DepthMap>>) -> Self {
        Self { surfaces: depths.into().map_or(self.surfaces, Surfaces::Depths), ..self }
    }

    /// Refuses a camera that is not finite, settings out of range, a region that is not in the picture, and surfaces of
    /// another size.
    pub(crate) fn check(&self) -> Result<()> {
        self.camera.validate()?;
        self.settings.validate()?;
        self.region.check_within(self.camera.size)?;
        match self.surfaces {
            Surfaces::None => Ok(()),
            Surfaces::Depths(depths) => depths.check(self.camera),
            Surfaces::Solids(solids) => solids.check(self.camera),
        }
    }

    /// Returns the depths of the surfaces.
    pub(crate) fn depths(&self) -> Option<&'a DepthMap> {
        match self.surfaces {
            Surfaces::None => None,
            Surfaces::Depths(depths) => Some(depths),
            Surfaces::Solids(solids) => Some(&solids.depths),
        }
    }

    /// Makes the picture, once it is checked, by `draw`, which draws the matter of a region of the picture before
    /// depths.
    pub(crate) fn drawn(&self, draw: impl Fn(Region, Option<&DepthMap>) -> Result<Rendered>) -> Result<Rendered> {
        self.check()?;
        match self.surfaces {
            Surfaces::None => draw(self.region, None),
            Surfaces::Depths(depths) => draw(self.region, Some(depths)),
            Surfaces::Solids(solids) => solids.in_picture(
                self.region,
                |reached| draw(reached, Some(&solids.depths)),
                || draw(self.region, None),
            ),
        }
    }
}
