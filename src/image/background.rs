//! What a picture is laid over.

use std::str::FromStr;

use crate::error::Error;

/// The background of a PNG.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Background {
    /// None: the PNG keeps straight alpha.
    Transparent,
    /// An opaque colour, red, green and blue in 0..1, in display space.
    Color([f64; 3]),
}

impl Default for Background {
    fn default() -> Self {
        Self::Color([0.0; 3])
    }
}

/// The sixteen colours of HTML 4.
const NAMED: [(&str, u32); 17] = [
    ("black", 0x00_0000),
    ("silver", 0xc0_c0c0),
    ("gray", 0x80_8080),
    ("grey", 0x80_8080),
    ("white", 0xff_ffff),
    ("maroon", 0x80_0000),
    ("red", 0xff_0000),
    ("purple", 0x80_0080),
    ("fuchsia", 0xff_00ff),
    ("green", 0x00_8000),
    ("lime", 0x00_ff00),
    ("olive", 0x80_8000),
    ("yellow", 0xff_ff00),
    ("navy", 0x00_0080),
    ("blue", 0x00_00ff),
    ("teal", 0x00_8080),
    ("aqua", 0x00_ffff),
];

impl FromStr for Background {
    type Err = Error;

    /// `transparent`, `#rgb`, `#rrggbb`, a colour of HTML 4 by name, or `r,g,b` in 0..1.
    fn from_str(text: &str) -> Result<Self, Error> {
        let packed = |v: u32| [16, 8, 0].map(|shift| f64::from(v >> shift & 0xff) / 255.0);
        let lower = text.trim().to_lowercase();
        let color = if lower == "transparent" {
            return Ok(Self::Transparent);
        } else if let Some(hex) = lower.strip_prefix('#') {
            match (hex.len(), u32::from_str_radix(hex, 16)) {
                (6, Ok(v)) => Some(packed(v)),
                (3, Ok(v)) => Some([8, 4, 0].map(|shift| f64::from(v >> shift & 0xf) / 15.0)),
                _ => None,
            }
        } else if let Some((_, v)) = NAMED.iter().find(|(name, _)| *name == lower) {
            Some(packed(*v))
        } else {
            let parts: Option<Vec<f64>> = lower.split(',').map(|p| p.trim().parse().ok()).collect();
            parts.and_then(|p| <[f64; 3]>::try_from(p).ok()).filter(|p| p.iter().all(|c| (0.0..=1.0).contains(c)))
        };
        color.map(Self::Color).ok_or_else(|| Error::Setting {
            name: "background",
            reason: format!("{text:?}, expected transparent, #rrggbb, a colour name such as white, or r,g,b in 0..1"),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn colours_are_read() {
        let color = |text: &str| text.parse::<Background>().unwrap();
        assert_eq!(color("transparent"), Background::Transparent);
        assert_eq!(color("#f80"), Background::Color([1.0, 8.0 / 15.0, 0.0]));
        assert_eq!(color("#ff0080"), Background::Color([1.0, 0.0, 128.0 / 255.0]));
        assert_eq!(color("White"), Background::Color([1.0; 3]));
        assert_eq!(color("0,0.5,1"), Background::Color([0.0, 0.5, 1.0]));
        for bad in ["", "#12", "#ggg", "blurple", "1,2,3", "0,0", "nan,0,0"] {
            assert!(bad.parse::<Background>().is_err(), "{bad}");
        }
    }
}
