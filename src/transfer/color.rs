//! Colours in the spellings of users: red, green and blue from 0 to 1, in display space.

use voxsplat_volume::names::nearest;

/// A line for each name of CSS: the name in lower case, a blank, and six hexadecimal digits
/// (<https://www.w3.org/TR/css-color-4/#named-colors>).
const NAMES: &str = include_str!("color_names.txt");

/// Unpacks the colour `0xrrggbb`.
pub(crate) fn packed(rgb: u32) -> [f64; 3] {
    [16, 8, 0].map(|shift| f64::from(rgb >> shift & 0xff) / 255.0)
}

/// Parses the colour `#rrggbb`; digits may have either case.
pub(crate) fn hex(text: &str) -> Option<[f64; 3]> {
    digits(text, 6).map(packed)
}

/// Parses the colour `#rgb`, which stands for `#rrggbb` with each digit doubled.
fn short_hex(text: &str) -> Option<[f64; 3]> {
    digits(text, 3).map(|rgb| [8, 4, 0].map(|shift| f64::from(rgb >> shift & 0xf) / 15.0))
}

/// Returns the names of CSS, each with its digits.
fn names() -> impl Iterator<Item = (&'static str, &'static str)> {
    NAMES.lines().filter_map(|line| line.split_once(' '))
}

/// Looks up a colour of CSS by its name in lower case.
fn named(name: &str) -> Option<[f64; 3]> {
    let (_, rgb) = names().find(|(known, _)| *known == name)?;
    u32::from_str_radix(rgb, 16).ok().map(packed)
}

/// Parses a colour in a spelling of users: `#rrggbb`, `#rgb`, a name of CSS in any case, or `r,g,b` in 0..1.
pub(crate) fn parse(text: &str) -> Option<[f64; 3]> {
    let lower = text.trim().to_lowercase();
    hex(&lower).or_else(|| short_hex(&lower)).or_else(|| named(&lower)).or_else(|| channels(&lower))
}

/// Returns the end of an error about a colour: the name of CSS that is most similar to the text, if one is.
pub(crate) fn tip(text: &str) -> String {
    let near = nearest(&text.trim().to_lowercase(), names().map(|(name, _)| name));
    near.map(|name| format!("; a similar colour exists: {name}")).unwrap_or_default()
}

/// Parses the colour `r,g,b`, each in 0..1.
fn channels(text: &str) -> Option<[f64; 3]> {
    let channels: Option<Vec<f64>> = text.split(',').map(|channel| channel.trim().parse().ok()).collect();
    let color: [f64; 3] = channels?.try_into().ok()?;
    color.iter().all(|c| (0.0..=1.0).contains(c)).then_some(color)
}

/// Returns the colour of a hue, a saturation and a value in 0..1 (Smith 1978, "Color gamut transform pairs").
pub(crate) fn hsv([hue, saturation, value]: [f64; 3]) -> [f64; 3] {
    [5.0, 3.0, 1.0].map(|n: f64| {
        let k = (n + 6.0 * hue) % 6.0;
        value * (1.0 - saturation * k.min(4.0 - k).clamp(0.0, 1.0))
    })
}

/// Converts a display value from 0 to 1 to the intensity of its light (sRGB, IEC 61966-2-1).
pub(crate) fn to_linear(value: f64) -> f64 {
    if value <= 0.040_45 { value / 12.92 } else { libm::pow((value + 0.055) / 1.055, 2.4) }
}

/// Converts an intensity of light from 0 to 1 to its display value: the inverse of [`to_linear`].
pub(crate) fn from_linear(light: f64) -> f64 {
    if light <= 0.003_130_8 { light * 12.92 } else { 1.055 * libm::pow(light, 1.0 / 2.4) - 0.055 }
}

/// Returns the relative luminance of a colour in display space, 0 to 1 (ITU-R BT.709).
pub(crate) fn luminance(color: [f64; 3]) -> f64 {
    let [r, g, b] = color.map(to_linear);
    0.2126 * r + 0.7152 * g + 0.0722 * b
}

/// Parses exactly `count` hexadecimal digits after `#`.
fn digits(text: &str, count: usize) -> Option<u32> {
    let digits = text.strip_prefix('#').filter(|d| d.len() == count && d.bytes().all(|b| b.is_ascii_hexdigit()))?;
    u32::from_str_radix(digits, 16).ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn digits_are_channels() {
        assert_eq!(hex("#ff8000"), Some([1.0, 128.0 / 255.0, 0.0]));
        assert_eq!(hex("#FF8000"), hex("#ff8000"));
        assert_eq!(short_hex("#f80"), hex("#ff8800"));
        assert_eq!(named("teal"), hex("#008080"));
        for bad in ["", "#", "ff8000", "#ff800", "#ff80000", "#+f8000", "#gg0000", "#\u{e4}\u{e4}\u{e4}"] {
            assert_eq!(hex(bad), None, "{bad}");
        }
        assert_eq!([hsv([0.0, 1.0, 1.0]), hsv([1.0 / 3.0, 1.0, 0.5])], [[1.0, 0.0, 0.0], [0.0, 0.5, 0.0]]);
        assert_eq!(short_hex("#ff8000"), None);
        assert_eq!(named("blurple"), None);
    }

    #[test]
    fn all_names_of_css_are_colours_in_any_case() {
        let all: Vec<&str> = names().map(|(name, _)| name).collect();
        assert_eq!(all.len(), 148);
        assert!(all.is_sorted() && all.iter().all(|name| parse(name).is_some()), "{all:?}");
        for (text, digits) in [
            ("RebeccaPurple", "#663399"),
            (" cornflowerblue ", "#6495ed"),
            ("LIGHTGOLDENRODYELLOW", "#fafad2"),
            ("tomato", "#ff6347"),
            ("yellowgreen", "#9acd32"),
            ("aqua", "#00ffff"),
        ] {
            assert_eq!(parse(text), hex(digits), "{text}");
        }
        for name in all.iter().filter(|name| name.contains("gray")) {
            assert_eq!(named(name), named(&name.replace("gray", "grey")), "{name}");
        }
        assert_eq!(all.iter().filter(|name| name.contains("grey")).count(), 7);
    }

    #[test]
    fn misspelt_names_have_a_tip() {
        assert_eq!(tip("Tomatoe"), "; a similar colour exists: tomato");
        assert_eq!(tip("darkslategrai"), "; a similar colour exists: darkslategray");
        assert_eq!([tip(""), tip("nonesuch"), tip("#ff00")], ["", "", ""]);
    }

    #[test]
    fn display_values_stand_for_light() {
        for value in [0.0, 0.02, 0.5, 1.0] {
            assert!((from_linear(to_linear(value)) - value).abs() < 1e-7, "{value}");
        }
        // A middle grey.
        assert!((to_linear(0.5) - 0.214_041).abs() < 1e-6);
        assert!((luminance([1.0; 3]) - 1.0).abs() < 1e-9 && luminance([0.0, 1.0, 0.0]) > luminance([1.0, 0.0, 1.0]));
    }
}
