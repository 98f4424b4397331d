//! Colours as users write them: red, green and blue from 0 to 1, in display space.

/// The sixteen colours of HTML 4 (<https://www.w3.org/TR/html401/types.html#h-6.5>), "gray" in both spellings.
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

/// Unpacks the colour `0xrrggbb`.
pub(crate) fn packed(rgb: u32) -> [f64; 3] {
    [16, 8, 0].map(|shift| f64::from(rgb >> shift & 0xff) / 255.0)
}

/// Parses the colour `#rrggbb`; digits may have either case.
pub(crate) fn hex(text: &str) -> Option<[f64; 3]> {
    digits(text, 6).map(packed)
}

/// Parses the colour `#rgb`, which stands for `#rrggbb` with each digit doubled.
pub(crate) fn short_hex(text: &str) -> Option<[f64; 3]> {
    digits(text, 3).map(|rgb| [8, 4, 0].map(|shift| f64::from(rgb >> shift & 0xf) / 15.0))
}

/// Looks up a colour of HTML 4 by its name in lower case.
pub(crate) fn named(name: &str) -> Option<[f64; 3]> {
    NAMED.iter().find(|(known, _)| *known == name).map(|(_, rgb)| packed(*rgb))
}

/// The colour of a hue, a saturation and a value in 0..1 (Smith 1978, "Color gamut transform pairs").
pub(crate) fn hsv([hue, saturation, value]: [f64; 3]) -> [f64; 3] {
    [5.0, 3.0, 1.0].map(|n: f64| {
        let k = (n + 6.0 * hue) % 6.0;
        value * (1.0 - saturation * k.min(4.0 - k).clamp(0.0, 1.0))
    })
}

/// Converts a display value from 0 to 1 to the intensity of its light (sRGB, IEC 61966-2-1).
pub(crate) fn to_linear(value: f64) -> f64 {
    if value <= 0.040_45 { value / 12.92 } else { ((value + 0.055) / 1.055).powf(2.4) }
}

/// Converts an intensity of light from 0 to 1 to its display value: the inverse of [`to_linear`].
pub(crate) fn from_linear(light: f64) -> f64 {
    if light <= 0.003_130_8 { light * 12.92 } else { 1.055 * light.powf(1.0 / 2.4) - 0.055 }
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
    fn display_values_stand_for_light() {
        for value in [0.0, 0.02, 0.5, 1.0] {
            assert!((from_linear(to_linear(value)) - value).abs() < 1e-7, "{value}");
        }
        // A middle grey.
        assert!((to_linear(0.5) - 0.214_041).abs() < 1e-6);
        assert!((luminance([1.0; 3]) - 1.0).abs() < 1e-9 && luminance([0.0, 1.0, 0.0]) > luminance([1.0, 0.0, 1.0]));
    }
}
