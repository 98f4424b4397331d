//! The background of 8-bit pictures.

use std::str::FromStr;

use crate::error::Error;
use crate::transfer::color;

/// The background behind a picture when it becomes 8-bit pixels.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Background {
    /// No background: pixels keep their alpha, as straight alpha.
    Transparent,
    /// An opaque colour, red, green and blue in 0..1, in display space.
    Color([f64; 3]),
}

impl Default for Background {
    fn default() -> Self {
        Self::Color([0.0; 3])
    }
}

impl FromStr for Background {
    type Err = Error;

    /// Parses `transparent`, `#rgb`, `#rrggbb`, a colour of CSS by name, or `r,g,b` in 0..1.
    fn from_str(text: &str) -> Result<Self, Error> {
        if text.trim().eq_ignore_ascii_case("transparent") {
            return Ok(Self::Transparent);
        }
        color::parse(text).map(Self::Color).ok_or_else(|| {
            let expected = "expected transparent, #rrggbb, a colour name of CSS such as white, or r,g,b in 0..1";
            Error::setting("background", format!("{text:?}, {expected}{}", color::tip(text)))
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
        assert_eq!(color("lightSlateGrey"), color("#778899"));
        assert_eq!(color("0,0.5,1"), Background::Color([0.0, 0.5, 1.0]));
        for bad in ["", "#12", "#ggg", "blurple", "1,2,3", "0,0", "nan,0,0"] {
            let refused = bad.parse::<Background>().unwrap_err().to_string();
            assert!(refused.starts_with(&format!("background: {bad:?}, expected transparent")), "{refused}");
        }
        let refused = "stealblue".parse::<Background>().unwrap_err().to_string();
        assert!(refused.ends_with("; a similar colour exists: steelblue"), "{refused}");
    }
}
