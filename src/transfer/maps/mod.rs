//! Colour maps by name, and as files.
//!
//! The maps of Crameri and of cmocean are tables, whose sources and licence are in `src/transfer/maps/README.md`; the
//! crate `colorous` has the other maps.

use super::TransferFunction;
use super::lines::merged;
use crate::error::{Error, Result};
use crate::transfer::color;

/// The maps of `colorous`, whose own greys are not linear.
const COLOROUS: [(&str, colorous::Gradient); 6] = [
    ("viridis", colorous::VIRIDIS),
    ("inferno", colorous::INFERNO),
    ("magma", colorous::MAGMA),
    ("plasma", colorous::PLASMA),
    ("cividis", colorous::CIVIDIS),
    ("turbo", colorous::TURBO),
];

/// A line for each map: its name, a blank, and hexadecimal digits of its colours.
const TABLES: &str = include_str!("tables.txt");

/// The number of steps between the colours of a map of `colorous`.
const STEPS: u32 = 64;

/// The number of steps of the ramp of opacity.
const RAMP_STEPS: u32 = 16;

/// The opacity at the upper end of a map.
const RAMP_TOP: f64 = 0.1;

/// A colour map: colours in the order of values, without opacities.
#[derive(Debug, Clone, PartialEq)]
pub struct ColorMap {
    /// The values, ascending, the first and the last apart, with their colours.
    colors: Vec<(f64, [f64; 3])>,
}

impl ColorMap {
    pub(super) fn new(colors: Vec<(f64, [f64; 3])>) -> Result<Self> {
        match (colors.first(), colors.last()) {
            (Some(first), Some(last)) if first.0 < last.0 => Ok(Self { colors }),
            _ => Err(Error::Transfer("a colour map needs colours at two values".to_owned())),
        }
    }

    /// Returns the colours over values from 0 to 1, with a gentle ramp of opacity: a tenth of the square of the value,
    /// for slabs as thick as the smallest spacing. [`TransferFunction::stretched`] moves it to the values of data.
    ///
    /// # Errors
    /// [`Error::Transfer`] if there are over [`TransferFunction::MAX_POINTS`] colours.
    pub fn transfer(&self) -> Result<TransferFunction> {
        let (first, last) = (self.colors[0].0, self.colors[self.colors.len() - 1].0);
        // Halves, because the range may be as wide as the range of f64.
        let place = |value: f64| (value / 2.0 - first / 2.0) / (last / 2.0 - first / 2.0);
        let colors: Vec<_> = self.colors.iter().map(|(value, color)| (place(*value), *color)).collect();
        let ramp: Vec<_> = evenly(RAMP_STEPS).map(|f| (f, [RAMP_TOP * f * f])).collect();
        TransferFunction::new(merged(&colors, &ramp), None)
    }
}

/// Returns the numbers from 0 to 1 at equal distances.
fn evenly(steps: u32) -> impl Iterator<Item = f64> {
    (0..=steps).map(move |step| f64::from(step) / f64::from(steps))
}

/// Returns a colour of `colorous` as red, green and blue in 0..1.
pub(super) fn rgb(colorous::Color { r, g, b }: colorous::Color) -> [f64; 3] {
    [r, g, b].map(|channel| f64::from(channel) / 255.0)
}

/// Returns the name and the digits of each map of the tables.
fn tables() -> impl Iterator<Item = (&'static str, &'static str)> {
    TABLES.lines().filter_map(|line| line.split_once(' '))
}

/// Returns the names of all maps.
#[must_use]
pub fn names() -> Vec<&'static str> {
    let named = std::iter::once("gray").chain(COLOROUS.map(|(name, _)| name));
    named.chain(tables().map(|(name, _)| name)).collect()
}

/// Finds the map with a name.
///
/// # Errors
/// [`Error::Transfer`] if there is no such map; the message lists all.
pub fn find(name: &str) -> Result<ColorMap> {
    let colors: Vec<[f64; 3]> = if name == "gray" {
        vec![[0.0; 3], [1.0; 3]]
    } else if let Some((_, gradient)) = COLOROUS.iter().find(|(known, _)| *known == name) {
        evenly(STEPS).map(|place| rgb(gradient.eval_continuous(place))).collect()
    } else if let Some((_, digits)) = tables().find(|(known, _)| *known == name) {
        let color = |digits: &[u8]| color::hex(&format!("#{}", String::from_utf8_lossy(digits)));
        digits.as_bytes().chunks(6).filter_map(color).collect()
    } else {
        return Err(Error::Transfer(format!("no colour map is called {name:?}: there are {}", names().join(", "))));
    };
    ColorMap::new(evenly(colors.len() as u32 - 1).zip(colors).collect())
}
