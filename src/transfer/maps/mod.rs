//! Colour maps by name, and as files.
//!
//! The maps of Crameri and of cmocean are tables, whose sources and licence are in `src/transfer/maps/README.md`; the
//! others are of the crate `colorous`.

use super::TransferFunction;
use super::lines::merged;
use crate::color::hex;
use crate::error::{Error, Result};

/// Maps of `colorous`. That of greys runs from white to black.
const COLOROUS: [(&str, colorous::Gradient); 6] = [
    ("viridis", colorous::VIRIDIS),
    ("inferno", colorous::INFERNO),
    ("magma", colorous::MAGMA),
    ("plasma", colorous::PLASMA),
    ("cividis", colorous::CIVIDIS),
    ("turbo", colorous::TURBO),
];

/// A line for each name, followed by the colours of the map in lines of hexadecimal digits.
const TABLES: &str = include_str!("tables.txt");

/// Colours taken of a map of `colorous`.
const STEPS: u32 = 64;

/// Steps of the ramp of opacity.
const RAMP_STEPS: u32 = 16;

/// The opacity at the upper end.
const RAMP_TOP: f64 = 0.1;

/// Colours in the order of values, without opacities.
#[derive(Debug, Clone, PartialEq)]
pub struct ColorMap {
    /// Values ascending, the first and the last apart.
    colors: Vec<(f64, [f64; 3])>,
}

impl ColorMap {
    pub(super) fn new(colors: Vec<(f64, [f64; 3])>) -> Result<Self> {
        match (colors.first(), colors.last()) {
            (Some(first), Some(last)) if first.0 < last.0 => Ok(Self { colors }),
            _ => Err(Error::Transfer("a colour map needs colours at two values".to_owned())),
        }
    }

    /// The colours over values from 0 to 1, with a gentle ramp of opacity: a tenth of the square of the value, for
    /// slabs as thick as the smallest spacing. [`TransferFunction::stretched`] moves it to the values of data.
    ///
    /// # Errors
    /// [`Error::Transfer`] if there are over [`TransferFunction::MAX_POINTS`] colours.
    pub fn transfer(&self) -> Result<TransferFunction> {
        let (first, last) = (self.colors[0].0, self.colors[self.colors.len() - 1].0);
        // Halves, as the range may be that of f64.
        let place = |value: f64| (value / 2.0 - first / 2.0) / (last / 2.0 - first / 2.0);
        let colors: Vec<_> = self.colors.iter().map(|(value, color)| (place(*value), *color)).collect();
        let ramp = (0..=RAMP_STEPS).map(|i| f64::from(i) / f64::from(RAMP_STEPS));
        let ramp: Vec<_> = ramp.map(|f| (f, [RAMP_TOP * f * f])).collect();
        TransferFunction::new(merged(&colors, &ramp), None)
    }
}

/// The names of all maps.
#[must_use]
pub fn names() -> Vec<&'static str> {
    let tables = TABLES.lines().filter(|line| is_name(line));
    std::iter::once("gray").chain(COLOROUS.map(|(name, _)| name)).chain(tables).collect()
}

/// The map of a name.
///
/// # Errors
/// [`Error::Transfer`] if there is no such map; the message lists all.
pub fn find(name: &str) -> Result<ColorMap> {
    if name == "gray" {
        return ColorMap::new(vec![(0.0, [0.0; 3]), (1.0, [1.0; 3])]);
    }
    let steps = |count: u32| (0..=count).map(move |i| f64::from(i) / f64::from(count));
    if let Some((_, gradient)) = COLOROUS.iter().find(|(known, _)| *known == name) {
        let color = |place: f64| {
            let colorous::Color { r, g, b } = gradient.eval_continuous(place);
            [r, g, b].map(|c| f64::from(c) / 255.0)
        };
        return ColorMap::new(steps(STEPS).map(|place| (place, color(place))).collect());
    }
    let mut lines =
        TABLES.lines().skip_while(|line| *line != name || !is_name(line)).skip(1).take_while(|l| !is_name(l));
    let digits: String = lines.by_ref().collect();
    let colors: Vec<[f64; 3]> =
        digits.as_bytes().chunks(6).filter_map(|c| hex(&format!("#{}", String::from_utf8_lossy(c)))).collect();
    if colors.is_empty() {
        return Err(Error::Transfer(format!("no colour map is called {name:?}: there are {}", names().join(", "))));
    }
    ColorMap::new(steps(colors.len() as u32 - 1).zip(colors).collect())
}

/// Whether a line of the tables is a name: lines of colours are 78 digits.
fn is_name(line: &str) -> bool {
    line.len() < 78
}
