//! Partial pictures: what the matter of a brick, or of several bricks in a row, leaves in each pixel.

use std::ops::Range;

use crate::camera::Camera;
use crate::error::{Error, Result};
use crate::image::{Image, Region};
use crate::settings::{Model, Settings};
use crate::transfer::TransferFunction;

/// The meaning of the four values of a pixel of a partial picture.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Values {
    /// Premultiplied red, green and blue, and optical depth. An X-ray has optical depth alone.
    Emission,
    /// A sum of weights times the largest value less the base of the transfer function, the sum of weights, the sum of
    /// weights times the depth of the value in the box of the voxels (0 to 1, if the picture needs it), and the weight
    /// of rays that meet the box.
    Largest,
    /// The integral of the value less the base along the ray, the length, 0, and the weight of rays that meet the box.
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
            Self::Emission => ["R", "G", "B", "depth.optical"],
            Self::Largest => ["value.sum", "value.weight", "depth.sum", "inside.weight"],
            Self::Mean => ["value.integral", "value.length", "unused", "inside.weight"],
        }
    }

    /// The pixel of `front` before `back`.
    fn over(self, front: [f32; 4], back: [f32; 4]) -> [f32; 4] {
        let [f, b] = [front, back].map(|pixel| pixel.map(f64::from));
        let sums: [f64; 4] = std::array::from_fn(|i| f[i] + b[i]);
        let merged = match self {
            Self::Emission => {
                let passed = (-f[3]).exp();
                [f[0] + passed * b[0], f[1] + passed * b[1], f[2] + passed * b[2], sums[3]]
            }
            Self::Largest => {
                // Of equal values the nearer one counts.
                let value = |[sum, weight, ..]: [f64; 4]| if weight > 0.0 { sum / weight } else { f64::NEG_INFINITY };
                let [value, weight, depth, _] = if value(b) > value(f) { b } else { f };
                [value, weight, depth, f[3].max(b[3])]
            }
            Self::Mean => [sums[0], sums[1], 0.0, f[3].max(b[3])],
        };
        merged.map(|value| value as f32)
    }
}

/// A partial picture: a box of pixels of the whole picture, and what consecutive bricks leave in them.
#[derive(Debug, Clone, PartialEq)]
pub struct Partial {
    /// [`Plan::id`](super::Plan::id) of the plan that it belongs to.
    pub(super) plan: u64,
    /// The places of its bricks in the order of the plan.
    pub(super) bricks: Range<usize>,
    pub(super) values: Values,
    /// The pixels of the picture that its bricks reach.
    pub(super) region: Region,
    pub(super) pixels: Image,
}

impl Partial {
    /// Returns the places of its bricks in the order of the plan.
    #[must_use]
    pub fn bricks(&self) -> Range<usize> {
        self.bricks.clone()
    }

    /// Returns the box of pixels of the whole picture that it holds.
    #[must_use]
    pub fn region(&self) -> Region {
        self.region
    }

    /// Returns the meaning of its pixels.
    #[must_use]
    pub fn values(&self) -> Values {
        self.values
    }

    /// Returns its pixels, row by row from the top.
    #[must_use]
    pub fn pixels(&self) -> &[[f32; 4]] {
        self.pixels.pixels()
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
        if self.plan != back.plan || self.values != back.values {
            return Err(Error::setting("parts", "they belong to different plans: merge the parts of one plan"));
        }
        if self.bricks.end != back.bricks.start {
            let [front, back] = [self, back].map(|part| named(&part.bricks));
            let reason = format!("{back} is not directly behind {front} in the order of the plan");
            return Err(Error::setting("parts", reason));
        }
        let region = around(self.region, back.region);
        let mut pixels = self.spread(region)?;
        let width = region.width as usize;
        let (x, y) = ((back.region.x - region.x) as usize, (back.region.y - region.y) as usize);
        let rows = pixels.pixels_mut().chunks_exact_mut(width).skip(y);
        for (row, behind) in rows.zip(back.pixels.pixels().chunks_exact(back.region.width as usize)) {
            for (front, &back) in row[x..].iter_mut().zip(behind) {
                *front = self.values.over(*front, back);
            }
        }
        Ok(Self { bricks: self.bricks.start..back.bricks.end, region, pixels, ..*self })
    }

    /// The pixels in a region around it; 0 beyond.
    fn spread(&self, region: Region) -> Result<Image> {
        let mut spread = Image::transparent(region.width, region.height)?;
        let (x, y) = ((self.region.x - region.x) as usize, (self.region.y - region.y) as usize);
        let width = self.region.width as usize;
        let rows = spread.pixels_mut().chunks_exact_mut(region.width as usize).skip(y);
        rows.zip(self.pixels.pixels().chunks_exact(width)).for_each(|(to, from)| to[x..x + width].copy_from_slice(from));
        Ok(spread)
    }

    /// The whole picture of a camera, classified now that all bricks are known.
    pub(super) fn picture(&self, look: &Look<'_>, camera: &Camera) -> Result<Image> {
        let [width, height] = camera.size;
        let mut image = self.spread(Region { x: 0, y: 0, width, height })?;
        image.pixels_mut().iter_mut().for_each(|pixel| *pixel = look.shown(self.values, *pixel));
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

/// The smallest region around both.
fn around(a: Region, b: Region) -> Region {
    let (x, y) = (a.x.min(b.x), a.y.min(b.y));
    let (right, bottom) = ((a.x + a.width).max(b.x + b.width), (a.y + a.height).max(b.y + b.height));
    Region { x, y, width: right - x, height: bottom - y }
}

/// What turns the values of merged bricks into pixels.
pub(super) struct Look<'a> {
    pub(super) settings: &'a Settings,
    /// The largest of each channel of the colours.
    pub(super) brightest: [f64; 3],
    /// The transfer function of a projection, mirrored for a minimum.
    pub(super) transfer: Option<&'a TransferFunction>,
}

impl Look<'_> {
    /// The premultiplied pixel of the values of all bricks.
    fn shown(&self, values: Values, pixel: [f32; 4]) -> [f32; 4] {
        let [a, b, c, d] = pixel.map(f64::from);
        let shown = match values {
            Values::Emission if self.settings.model == Model::Xray => self.settings.response.pixel(d.max(0.0)),
            Values::Emission => {
                // Colours of cells and of fitted slabs may be slightly negative.
                let alpha = -(-d.max(0.0)).exp_m1();
                let [red, green, blue] = self.brightest.map(|most| most * alpha);
                [a.clamp(0.0, red), b.clamp(0.0, green), c.clamp(0.0, blue), alpha]
            }
            // Rays beside the box show nothing; rays through skipped space alone have the base.
            _ if d <= 0.0 => [0.0; 4],
            Values::Largest => self.projected(if b > 0.0 { a / b } else { 0.0 }, if b > 0.0 { c / b } else { 0.0 }),
            Values::Mean => self.projected(if b > 0.0 { a / b } else { 0.0 }, 0.0),
        };
        shown.map(|channel| channel as f32)
    }

    /// The pixel of a projected value, relative to the base.
    fn projected(&self, value: f64, depth: f64) -> [f64; 4] {
        let Some(transfer) = self.transfer else { return [0.0; 4] };
        transfer.projected(value, self.settings.depth_coded.then_some(depth))
    }
}
