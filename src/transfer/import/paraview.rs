//! Transfer functions and colour maps of ParaView, as JSON and as the older XML.

use roxmltree::Document;
use serde_json::Value;

use super::curve::{VtkNode, colors, opacities};
use super::space::ColorSpace;
use super::{ForeignFunction, chosen, fault, groups, number, numbers, parsed};
use crate::error::Result;

const OF_LABELS: &str = "its colours are for labels, not for values";

/// Reads a preset file: an object, or an array of objects.
pub(super) fn json(value: &Value, name: Option<&str>) -> Result<ForeignFunction> {
    let presets = value.as_array().map_or(std::slice::from_ref(value), Vec::as_slice);
    let objects = presets.iter().filter(|preset| preset.is_object());
    let preset = chosen(objects, |preset| preset.get("Name").and_then(Value::as_str), name)?;
    let is_on = |key: &str| preset.get(key).is_some_and(|on| on.as_bool().unwrap_or(on.as_f64() == Some(1.0)));
    let mut found = ForeignFunction::default();
    if let Some(points) = preset.get("RGBPoints") {
        let name = preset.get("ColorSpace").and_then(Value::as_str).unwrap_or("RGB");
        let space = ColorSpace::named(name, is_on("HSVWrap"), &mut found.notes)?;
        found.colors = Some(colors(VtkNode::colors(&groups(&numbers(points)?, "RGBPoints")?), space));
    } else if preset.get("IndexedColors").is_some() {
        return Err(fault(OF_LABELS));
    }
    if let Some(points) = preset.get("Points") {
        let nodes = groups::<4>(&numbers(points)?, "Points")?.into_iter();
        let node = |[at, opacity, midpoint, sharpness]: [f64; 4]| VtkNode { at, value: [opacity], midpoint, sharpness };
        found.opacities = Some(opacities(nodes.map(node).collect()));
        found.placed = true;
    }
    found.unit_distance = preset.get("ScalarOpacityUnitDistance").map(number).transpose()?;
    if is_on("UseLogScale") {
        found.notes.push("its scale is logarithmic, but is read as linear between points".to_owned());
    }
    Ok(found)
}

/// Reads a file of `ColorMap` elements. Their opacities are not used, as in ParaView.
pub(super) fn xml(document: &Document<'_>, name: Option<&str>) -> Result<ForeignFunction> {
    let maps = document.descendants().filter(|node| node.has_tag_name("ColorMap"));
    let map = chosen(maps, |map| map.attribute("name"), name)?;
    if map.attribute("indexedLookup").is_some_and(|indexed| indexed == "1" || indexed == "true") {
        return Err(fault(OF_LABELS));
    }
    let mut found = ForeignFunction::default();
    let space = ColorSpace::named(map.attribute("space").unwrap_or("RGB"), false, &mut found.notes)?;
    let points = map.children().filter(|node| node.has_tag_name("Point")).map(|point| {
        let number = |name: &str| {
            let text = point.attribute(name).unwrap_or_default();
            parsed(text).ok_or_else(|| fault(format!("a point has {name}={text:?}, expected a number")))
        };
        Ok(VtkNode::plain(number("x")?, [number("r")?, number("g")?, number("b")?]))
    });
    let nodes = points.collect::<Result<Vec<_>>>()?;
    if nodes.is_empty() {
        return Err(fault("its colour map has no points"));
    }
    found.colors = Some(colors(nodes, space));
    Ok(found)
}
