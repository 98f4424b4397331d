//! The description of ImageJ: lines of `name=value`.
//!
//! ImageJ writes a stack of over 4 GB with one directory, and only its description states how many sections follow.

use std::path::Path;

use super::described::Described;
use crate::error::{Result, Subject, refuse};
use crate::formats::placement::named_unit;
use crate::formats::selection::Role;
use crate::names::counted;

/// Returns whether a description is of ImageJ.
pub(super) fn is_imagej(text: &str) -> bool {
    text.starts_with("ImageJ=")
}

/// Describes the series of all `pages` of a file. A pixel has the lengths `resolution` along x and y.
pub(super) fn described(text: &str, resolution: [Option<f64>; 2], pages: usize, path: &Path) -> Result<Described> {
    let get = |name: &str| text.lines().find_map(|line| line.strip_prefix(name)?.strip_prefix('='));
    let count = |name: &str| get(name).and_then(|text| text.trim().parse::<i64>().ok()).unwrap_or(1);
    let together = pages == 1 && count("images") > 1;
    let images = if together { count("images") } else { pages as i64 };
    let (channels, times) = (count("channels").max(1), count("frames").max(1));
    let volumes = channels.saturating_mul(times);
    if images % volumes != 0 {
        let pages = counted(images.unsigned_abs(), "page");
        let channels = counted(channels.unsigned_abs(), "channel");
        let at = if times == 1 { "one point in time".to_owned() } else { format!("{times} points in time") };
        refuse!(path, "has {pages} for {channels} at {at}");
    }
    let axes = vec![(Role::Channel, channels), (Role::Space, images / volumes), (Role::Time, times)];
    let [x, y] = resolution.map(|length| length.unwrap_or(1.0));
    let z = get("spacing").and_then(|text| text.trim().parse().ok()).filter(|z: &f64| z.is_finite() && *z != 0.0);
    let unit = match get("unit").map(str::trim) {
        Some("micron" | "microns" | "um" | "\\u00B5m" | "\u{b5}m") => Some("µm".to_owned()),
        Some("pixel" | "pixels") | None => None,
        Some(other) => named_unit(other),
    };
    // Negative if the stack was turned over.
    let spacing = Some([x, y, z.map_or(1.0, f64::abs)]);
    Ok(Described { pages: (0..pages).collect(), axes, together, spacing, unit, ..Described::default() })
}
