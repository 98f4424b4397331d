//! Transfer functions and colour maps of ParaView, as JSON and as the older XML.

use roxmltree::{Document, Node as Element};
use serde_json::Value;

use super::curve::{Node, colors, opacities};
use super::space::Space;
use super::{Found, chosen, fault, groups, number, numbers};
use crate::error::Result;

/// A preset file: an object, or an array of them.
pub(super) fn json(value: &Value, name: Option<&str>) -> Result<Found> {
    let presets: Vec<&Value> = value.as_array().map_or_else(|| vec![value], |array| array.iter().collect());
    let label = |preset: &Value| preset.get("Name").and_then(Value::as_str).unwrap_or("(no name)").to_owned();
    let named = presets.into_iter().filter(|preset| preset.is_object()).map(|preset| (label(preset), preset)).collect();
    preset(chosen(named, name)?)
}

fn preset(preset: &Value) -> Result<Found> {
    let mut found = Found::default();
    if let Some(points) = preset.get("RGBPoints") {
        let name = preset.get("ColorSpace").and_then(Value::as_str).unwrap_or("RGB");
        let wrap = preset.get("HSVWrap").is_some_and(|wrap| wrap.as_bool().unwrap_or(wrap.as_f64() == Some(1.0)));
        let (space, note) = Space::named(name, wrap)?;
        found.notes.extend(note.map(str::to_owned));
        let nodes = groups::<4>(&numbers(points)?, "RGBPoints")?;
        found.colors = Some(colors(nodes.into_iter().map(|[x, r, g, b]| Node::plain(x, [r, g, b])).collect(), space));
    } else if preset.get("IndexedColors").is_some() {
        return Err(fault("its colours are for labels, not for values"));
    }
    if let Some(points) = preset.get("Points") {
        let nodes = groups::<4>(&numbers(points)?, "Points")?.into_iter();
        let node = |[at, opacity, midpoint, sharpness]: [f64; 4]| Node { at, value: [opacity], midpoint, sharpness };
        found.opacities = Some(opacities(nodes.map(node).collect()));
        found.placed = true;
    }
    found.unit_distance = preset.get("ScalarOpacityUnitDistance").map(number).transpose()?;
    if preset.get("UseLogScale").is_some_and(|log| log.as_bool().unwrap_or(log.as_f64() == Some(1.0))) {
        found.notes.push("its scale is logarithmic; between points it is taken as linear".to_owned());
    }
    Ok(found)
}

/// A file of `ColorMap` elements. Their opacities are not used, as in ParaView.
pub(super) fn xml(document: &Document<'_>, name: Option<&str>) -> Result<Found> {
    let maps = document.descendants().filter(|node| node.has_tag_name("ColorMap"));
    let named = maps.map(|map| (map.attribute("name").unwrap_or("(no name)").to_owned(), map)).collect();
    color_map(chosen(named, name)?)
}

fn color_map(map: Element<'_, '_>) -> Result<Found> {
    if map.attribute("indexedLookup").is_some_and(|indexed| indexed == "1" || indexed == "true") {
        return Err(fault("its colours are for labels, not for values"));
    }
    let (space, note) = Space::named(map.attribute("space").unwrap_or("RGB"), false)?;
    let mut nodes = Vec::new();
    for point in map.children().filter(|node| node.has_tag_name("Point")) {
        let number = |name: &str| {
            let text = point.attribute(name).unwrap_or_default();
            let number = text.trim().parse().ok().filter(|n: &f64| n.is_finite());
            number.ok_or_else(|| fault(format!("a point has {name}={text:?}, expected a number")))
        };
        nodes.push(Node::plain(number("x")?, [number("r")?, number("g")?, number("b")?]));
    }
    if nodes.is_empty() {
        return Err(fault("its colour map has no points"));
    }
    Ok(Found {
        colors: Some(colors(nodes, space)),
        notes: note.map(str::to_owned).into_iter().collect(),
        ..Found::default()
    })
}
