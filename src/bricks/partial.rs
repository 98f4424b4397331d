//! Partial pictures: the pixel values of a brick, or of several bricks in a row, before the other bricks are known.

use std::ops::Range;

use crate::camera::Camera;
use crate::error::{Error, Result};
use crate::image::{Image, Region};
use crate::painters::painter::FamilyShare;
use crate::settings::{Model, Settings};
use crate::transfer::TransferFunction;

/// The meaning of the four values of a pixel of a partial picture.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Values {
    /// Premultiplied red, green and blue, and optical depth. An X-ray has optical depth alone.
    Emission,
    /// The largest value on the ray less the base of the transfer function, 1 if there is one, its depth in the box of
    /// the voxels (0 to 1, if the picture needs it), and 1 if the ray meets the box.
    Largest,
    /// The integral of the value less the base along the ray, the length, 0, and 1 if the ray meets the box.
    Mean,
}

impl Values {
    /// Returns the values of the partial pictures of a model.
    #[must_use]
    pub fn of_model(model: Model) -> Self {
        match model {
            Model::Composite | Model::Xray => Self::Emission,
            Model::Mip | Model::Minip => Self::Largest,
            Model::Average => Self::Mean,
        }
    }

    /// Returns the names of the four channels in a file.
    #[must_use]
    pub fn channels(self) -> [&'static str; 4] {
        match self {
            Self::Emission => ["R", "G", "B", "tau"],
            Self::Largest => ["value", "found", "depth", "inside"],
            Self::Mean => ["integral", "length", "unused", "inside"],
        }
    }

    /// Composites the pixel `front` over the pixel `back`.
    fn over(self, front: [f32; 4], back: [f32; 4]) -> [f32; 4] {
        let [f, b] = [front, back].map(|pixel| pixel.map(f64::from));
        let sums: [f64; 4] = std::array::from_fn(|i| f[i] + b[i]);
        let merged = match self {
            Self::Emission => {
                let passed = libm::exp(-f[3]);
                [f[0] + passed * b[0], f[1] + passed * b[1], f[2] + passed * b[2], sums[3]]
            }
            Self::Largest => {
                // Of equal values the nearer one counts.
                let value = |[value, found, ..]: [f64; 4]| if found > 0.0 { value } else { f64::NEG_INFINITY };
                let [value, found, depth, _] = if value(b) > value(f) { b } else { f };
                [value, found, depth, f[3].max(b[3])]
            }
            Self::Mean => [sums[0], sums[1], 0.0, f[3].max(b[3])],
        };
        merged.map(|value| value as f32)
    }
}

/// A partial picture: a box of pixels of the whole picture, with the values of consecutive bricks.
#[derive(Debug, Clone, PartialEq)]
pub struct Partial {
    /// The [`Plan::id`](super::Plan::id) of the partial picture's plan.
    pub(super) plan: u64,
    /// The places of the composited bricks in the order of the plan.
    pub(super) bricks: Range<usize>,
    pub(super) values: Values,
    /// Width and height of the whole picture.
    pub(super) size: [u32; 2],
    /// The pixels of the picture that the composited bricks reach.
    pub(super) region: Region,
    /// The values of each family of rays.
    pub(super) families: Vec<Image>,
}

impl Partial {
    /// Returns the places of the composited bricks in the order of the plan.
    #[must_use]
    pub fn bricks(&self) -> Range<usize> {
        self.bricks.clone()
    }

    /// Returns the box of pixels of the whole picture that the partial picture holds.
    #[must_use]
    pub fn region(&self) -> Region {
        self.region
    }

    /// Returns the meaning of the pixels' values.
    #[must_use]
    #[doc(hidden)]
    pub fn values(&self) -> Values {
        self.values
    }

    /// Returns the number of families of rays: along the principal axes of the painter tiles near a tie, otherwise 1.
    /// Each family has slabs of its own, and its values are merged on their own.
    #[must_use]
    pub fn families(&self) -> usize {
        self.families.len()
    }

    /// Returns the pixels of a family, row by row from the top.
    ///
    /// # Panics
    /// If `family` is not under [`Self::families`].
    #[must_use]
    pub fn pixels(&self, family: usize) -> &[[f32; 4]] {
        self.families[family].pixels()
    }

    /// Composites this partial picture over the one of the bricks directly behind. Associative: any tree over the
    /// ordered bricks makes the same picture, to the rounding of f32.
    ///
    /// Emission and absorption: C = C1 + exp(-D1) C2 and D = D1 + D2, with colours C and optical depths D. The largest
    /// value is kept with its depth; integrals and lengths add up.
    ///
    /// # Errors
    /// [`Error::Setting`] if `back` belongs to another plan or is not directly behind; [`Error::Memory`].
    pub fn over(&self, back: &Self) -> Result<Self> {
        if self.plan != back.plan || self.values != back.values || self.families.len() != back.families.len() {
            return Err(Error::setting("parts", "they belong to different plans: merge the parts of one plan"));
        }
        if self.bricks.end != back.bricks.start {
            let [front, back] = [self, back].map(|part| named(&part.bricks));
            let reason = format!("{back} is not directly behind {front} in the order of the plan");
            return Err(Error::setting("parts", reason));
        }
        let region = self.region.around(back.region);
        let (x, y) = ((back.region.x - region.x) as usize, (back.region.y - region.y) as usize);
        let mut families = self.spread(region)?;
        for (pixels, behind) in families.iter_mut().zip(&back.families) {
            let rows = pixels.pixels_mut().chunks_exact_mut(region.width as usize).skip(y);
            for (row, behind) in rows.zip(behind.pixels().chunks_exact(back.region.width as usize)) {
                for (front, &back) in row[x..].iter_mut().zip(behind) {
                    *front = self.values.over(*front, back);
                }
            }
        }
        Ok(Self { bricks: self.bricks.start..back.bricks.end, region, families, ..*self })
    }

    /// Returns the pixels of all families in a region around theirs; 0 beyond.
    fn spread(&self, region: Region) -> Result<Vec<Image>> {
        let at = [self.region.x - region.x, self.region.y - region.y];
        let spread = |family: &Image| {
            let mut spread = Image::transparent(region.width, region.height)?;
            spread.put(family, at);
            Ok(spread)
        };
        self.families.iter().map(spread).collect()
    }

    /// Returns the whole picture of a camera, classified now that all bricks are known: the sum over families of their
    /// pixels times their shares.
    pub(super) fn picture(&self, look: &Look<'_>, camera: &Camera, shares: &[FamilyShare<'_>]) -> Result<Image> {
        let [width, height] = camera.size;
        let families = self.spread(Region { x: 0, y: 0, width, height })?;
        let mut image = Image::transparent(width, height)?;
        for (values, share) in families.iter().zip(shares) {
            for (number, (pixel, values)) in (0_u32..).zip(image.pixels_mut().iter_mut().zip(values.pixels())) {
                let share = share([number % width, number / width]);
                if share > 0.0 {
                    let shown = look.shown(self.values, *values);
                    pixel.iter_mut().zip(shown).for_each(|(sum, value)| *sum += (share * value) as f32);
                }
            }
        }
        Ok(image)
    }
}

/// Bricks by their places in the order of a plan.
pub(super) fn named(bricks: &Range<usize>) -> String {
    match bricks.len() {
        1 => format!("brick {}", bricks.start),
        _ => format!("bricks {} to {}", bricks.start, bricks.end.saturating_sub(1)),
    }
}

/// The settings, colours and transfer function that turn the values of merged bricks into pixels.
pub(super) struct Look<'a> {
    pub(super) settings: &'a Settings,
    /// The largest of each channel of the colours, to which they are clamped.
    pub(super) brightest: Option<[f64; 3]>,
    pub(super) transfer: Option<&'a TransferFunction>,
}

impl Look<'_> {
    /// Returns the premultiplied pixel of the values of all bricks.
    fn shown(&self, values: Values, pixel: [f32; 4]) -> [f64; 4] {
        let [a, b, c, d] = pixel.map(f64::from);
        match values {
            Values::Emission if self.settings.model == Model::Xray => self.settings.response.pixel(d.max(0.0)),
            Values::Emission => {
                let alpha = -libm::expm1(-d.max(0.0));
                let Some(brightest) = self.brightest else { return [a, b, c, alpha] };
                // Colours of cells and of fitted slabs may be slightly negative.
                let [red, green, blue] = brightest.map(|most| most * alpha);
                [a.clamp(0.0, red), b.clamp(0.0, green), c.clamp(0.0, blue), alpha]
            }
            // Rays beside the box show nothing; rays through skipped space alone have the base.
            _ if d <= 0.0 => [0.0; 4],
            Values::Largest => self.projected(a, c),
            Values::Mean => self.projected(if b > 0.0 { a / b } else { 0.0 }, 0.0),
        }
    }

    /// Returns the pixel of a projected value, relative to the base.
    fn projected(&self, value: f64, depth: f64) -> [f64; 4] {
        let Some(transfer) = self.transfer else { return [0.0; 4] };
        transfer.projected(value, self.settings.depth_coded.then_some(depth))
    }
}
