//! Colour maps of niivue and of napari, as JSON.

use serde_json::Value;

use super::{Found, fault, number, numbers, opaque};
use crate::error::Result;

/// niivue: bytes of red, green, blue and alpha at intensities from 0 to 255, which may stand for values.
pub(super) fn niivue(map: &Value) -> Result<Found> {
    let list = |key: &str| map.get(key).map(numbers).transpose().map_err(|e| fault(format!("{key}: {e}")));
    let missing = |key: &str| fault(format!("{key} is missing"));
    let channels = [("R", list("R")?), ("G", list("G")?), ("B", list("B")?)];
    let [red, green, blue] = channels.map(|(key, list)| list.ok_or_else(|| missing(key)));
    let (red, green, blue) = (red?, green?, blue?);
    let count = red.len();
    let evenly = || (0..count).map(|i| 255.0 * i as f64 / (count - 1).max(1) as f64).collect();
    let places: Vec<f64> = list("I")?.unwrap_or_else(evenly);
    let alpha = list("A")?;
    if [green.len(), blue.len(), places.len(), alpha.as_ref().map_or(count, Vec::len)].iter().any(|&n| n != count) {
        return Err(fault("R, G, B, A and I are of unlike lengths"));
    }
    if !places.is_sorted() {
        return Err(fault("I does not ascend"));
    }
    let range = [map.get("min"), map.get("max")].map(|end| end.map(number).transpose());
    let [low, high] = range;
    let range = low?.zip(high?).filter(|(low, high)| low < high);
    let value = |place: f64| range.map_or(place / 255.0, |(low, high)| low + (high - low) * place / 255.0);
    let colors = (0..count).map(|i| (value(places[i]), [red[i], green[i], blue[i]].map(|c| c / 255.0)));
    let opacities = alpha.map(|alpha| (0..count).map(|i| (value(places[i]), [alpha[i] / 255.0])).collect::<Vec<_>>());
    Ok(Found {
        colors: Some(colors.collect()),
        opacities: opacities.filter(|opacities| !opaque(opacities)),
        placed: range.is_some(),
        ..Found::default()
    })
}

/// napari: colours with or without alpha at places from 0 to 1, mixed or as steps.
pub(super) fn napari(map: &Value) -> Result<Found> {
    let rows = map.get("colors").and_then(Value::as_array).map(Vec::as_slice).unwrap_or_default();
    let rows = rows.iter().map(numbers).collect::<Result<Vec<_>, _>>()?;
    if rows.is_empty() || rows.iter().any(|row| row.len() != 3 && row.len() != 4) {
        return Err(fault("colors: expected rows of 3 or 4 numbers"));
    }
    let steps = map.get("interpolation").and_then(Value::as_str) == Some("zero");
    let ends = rows.len() + usize::from(steps);
    let controls = match map.get("controls") {
        Some(controls) if !controls.is_null() => numbers(controls)?,
        _ => (0..ends).map(|i| i as f64 / (ends - 1).max(1) as f64).collect(),
    };
    if controls.len() != ends || !controls.is_sorted() {
        return Err(fault(format!("controls: expected {ends} ascending numbers")));
    }
    let mut found = Found::default();
    let (mut colors, mut opacities) = (Vec::new(), Vec::new());
    for (i, row) in rows.iter().enumerate() {
        let places = if steps { vec![controls[i], controls[i + 1]] } else { vec![controls[i]] };
        for place in places {
            colors.push((place, [row[0], row[1], row[2]]));
            opacities.push((place, [row.get(3).copied().unwrap_or(1.0)]));
        }
    }
    found.opacities = Some(opacities).filter(|opacities| !opaque(opacities));
    found.colors = Some(colors);
    Ok(found)
}
