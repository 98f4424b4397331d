//! Colour maps of niivue and of napari, as JSON.

use serde_json::Value;

use super::{ForeignFunction, fault, list, number, numbers, opaque};
use crate::error::Result;

/// Reads a map of niivue: bytes of red, green, blue and alpha at intensities from 0 to 255, which may stand for values.
pub(super) fn niivue(map: &Value) -> Result<ForeignFunction> {
    let channel = |key: &str| map.get(key).map(numbers).transpose().map_err(|e| fault(format!("{key}: {e}")));
    let stated = |key: &str| channel(key)?.ok_or_else(|| fault(format!("{key} is missing")));
    let (red, green, blue) = (stated("R")?, stated("G")?, stated("B")?);
    let count = red.len();
    let evenly = || (0..count).map(|i| 255.0 * i as f64 / (count - 1).max(1) as f64).collect();
    let places: Vec<f64> = channel("I")?.unwrap_or_else(evenly);
    let alpha = channel("A")?;
    if [&green, &blue, &places].into_iter().chain(&alpha).any(|list| list.len() != count) {
        return Err(fault("R, G, B, A and I are of unlike lengths"));
    }
    if !places.is_sorted() {
        return Err(fault("I does not ascend"));
    }
    let end = |key: &str| map.get(key).map(number).transpose();
    let range = end("min")?.zip(end("max")?).filter(|(low, high)| low < high);
    let value = |place: f64| range.map_or(place / 255.0, |(low, high)| low + (high - low) * place / 255.0);
    let colors = (0..count).map(|i| (value(places[i]), [red[i], green[i], blue[i]].map(|c| c / 255.0)));
    let opacities = alpha.map(|alpha| (0..count).map(|i| (value(places[i]), [alpha[i] / 255.0])).collect::<Vec<_>>());
    Ok(ForeignFunction {
        colors: Some(colors.collect()),
        opacities: opacities.filter(|opacities| !opaque(opacities)),
        placed: range.is_some(),
        ..ForeignFunction::default()
    })
}

/// Reads a map of napari: colours with or without alpha at places from 0 to 1, mixed or as steps.
pub(super) fn napari(map: &Value) -> Result<ForeignFunction> {
    let rows = list(map, "colors").iter().map(numbers).collect::<Result<Vec<_>>>()?;
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
    let (mut colors, mut opacities) = (Vec::new(), Vec::new());
    for (i, row) in rows.iter().enumerate() {
        for &place in &controls[i..=i + usize::from(steps)] {
            colors.push((place, [row[0], row[1], row[2]]));
            opacities.push((place, [row.get(3).copied().unwrap_or(1.0)]));
        }
    }
    let opacities = Some(opacities).filter(|opacities| !opaque(opacities));
    Ok(ForeignFunction { colors: Some(colors), opacities, ..ForeignFunction::default() })
}
