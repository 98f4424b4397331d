//! Volume properties of 3D Slicer: `.vp` (lines of numbers), `.vp.json`, and files of presets.

use roxmltree::Document;
use serde_json::Value;

use super::curve::{VtkNode, colors, opacities};
use super::space::ColorSpace;
use super::{ForeignFunction, chosen, fault, groups, list, number, numbers, opaque, parsed};
use crate::error::Result;
use crate::transfer::GradientPoint;

/// The names of ambient, diffuse and specular share and shininess in presets and `.vp.json`.
const MATERIAL: [&str; 4] = ["ambient", "diffuse", "specular", "specularPower"];

/// Reads a `.vp`: interpolation, shade, diffuse, ambient, specular, power, opacities, gradient opacities and colours,
/// a line each.
pub(super) fn lines(text: &str) -> Result<ForeignFunction> {
    let lines: Vec<&str> = text.lines().map(str::trim).filter(|line| !line.is_empty()).collect();
    let &[_, shade, diffuse, ambient, specular, power, opacities, gradient, colors, ..] = lines.as_slice() else {
        return Err(fault(format!("{} lines of numbers, expected the 9 of a volume property", lines.len())));
    };
    property(shade, [ambient, diffuse, specular, power], [opacities, gradient, colors])
}

/// Reads a file of `VolumeProperty` elements.
pub(super) fn presets(document: &Document<'_>, name: Option<&str>) -> Result<ForeignFunction> {
    let elements = document.descendants().filter(|node| node.has_tag_name("VolumeProperty"));
    let element = chosen(elements, |element| element.attribute("name"), name)?;
    let text = |key: &str| element.attribute(key).unwrap_or_default();
    property(text("shade"), MATERIAL.map(text), ["scalarOpacity", "gradientOpacity", "colorTransfer"].map(text))
}

/// Reads a property by its texts: shade, material, and the points of opacity, gradient opacity and colour.
fn property(shade: &str, material: [&str; 4], [opacity, gradient, color]: [&str; 3]) -> Result<ForeignFunction> {
    let plain = |[at, value]: [f64; 2]| VtkNode::plain(at, [value]);
    let nodes = |text: &str, what: &str| -> Result<Vec<VtkNode<1>>> {
        Ok(groups(&counted(text)?, what)?.into_iter().map(plain).collect())
    };
    let gradient = if gradient.is_empty() { Vec::new() } else { nodes(gradient, "gradient opacity")? };
    let opacity = nodes(opacity, "scalar opacity")?;
    let color = VtkNode::colors(&groups(&counted(color)?, "colour transfer")?);
    let material = match material.map(parsed) {
        [Some(ambient), Some(diffuse), Some(specular), Some(power)] if shade == "1" => {
            Some([ambient, diffuse, specular, power])
        }
        _ => None,
    };
    Ok(ForeignFunction {
        colors: Some(colors(color, ColorSpace::Rgb)),
        opacities: Some(opacities(opacity)),
        placed: true,
        gradient: gradient_points(gradient),
        material,
        ..ForeignFunction::default()
    })
}

/// Reads numbers between blanks; the first is their count.
fn counted(text: &str) -> Result<Vec<f64>> {
    let number = |word: &str| parsed(word).ok_or_else(|| fault(format!("{word:?}, expected a number")));
    let numbers = text.split_whitespace().map(number).collect::<Result<Vec<f64>>>()?;
    match numbers.split_first() {
        Some((count, numbers)) if *count == numbers.len() as f64 => Ok(numbers.to_vec()),
        Some((count, numbers)) => Err(fault(format!("{} numbers where {count} are announced", numbers.len()))),
        None => Err(fault("a function has no points")),
    }
}

/// Reads a `.vp.json`: the first component of a property.
pub(super) fn json(value: &Value, name: Option<&str>) -> Result<ForeignFunction> {
    let properties = list(value, "volumeProperties");
    let property = chosen(properties, |property| property.get("name").and_then(Value::as_str), name)?;
    let components = list(property, "components");
    let component = components.first().ok_or_else(|| fault("its volume property has no components"))?;
    let is_on = |key: &str| component.get(key).and_then(Value::as_bool) == Some(true);
    let mut found = ForeignFunction { placed: true, ..ForeignFunction::default() };

    if let Some(function) =
        component.get("rgbTransferFunction").filter(|f| f.get("points").is_some_and(Value::is_array))
    {
        let space = function.get("colorSpace").and_then(Value::as_str).unwrap_or("RGB");
        let space = ColorSpace::named(space, false, &mut found.notes)?;
        let nodes = list(function, "points").iter().map(|point| {
            let color = groups::<3>(&numbers(&point["color"])?, "color")?;
            node(point, color[0])
        });
        found.colors = Some(colors(nodes.collect::<Result<_>>()?, space)).filter(|line| !line.is_empty());
    }
    let curve = |key: &str| {
        let nodes = list(&component[key], "points").iter();
        nodes.map(|point| node(point, [number(&point["y"])?])).collect::<Result<Vec<_>>>()
    };
    found.opacities = Some(opacities(curve("scalarOpacity")?)).filter(|line| !line.is_empty());
    if !is_on("disableGradientOpacity") {
        found.gradient = gradient_points(curve("gradientOpacity")?);
    }
    found.unit_distance = component.get("scalarOpacityUnitDistance").map(number).transpose()?;
    if let Some(lighting) = component.get("lighting").filter(|_| is_on("shade")) {
        let [ambient, diffuse, specular, power] = MATERIAL.map(|key| lighting.get(key).map(number).transpose());
        let material = ambient?.zip(diffuse?).zip(specular?).zip(power?);
        found.material = material.map(|(((ambient, diffuse), specular), power)| [ambient, diffuse, specular, power]);
    }
    if components.len() > 1 {
        found.notes.push(format!("of its {} components the first is used", components.len()));
    }
    Ok(found)
}

/// Reads a point with its midpoint and sharpness.
fn node<const N: usize>(point: &Value, value: [f64; N]) -> Result<VtkNode<N>> {
    let or = |key: &str, default: f64| point.get(key).map_or(Ok(default), number);
    Ok(VtkNode { at: number(&point["x"])?, value, midpoint: or("midpoint", 0.5)?, sharpness: or("sharpness", 0.0)? })
}

/// Reads opacities over gradients; no points if all are 1.
fn gradient_points(nodes: Vec<VtkNode<1>>) -> Vec<GradientPoint> {
    let point = |(magnitude, [opacity]): (f64, [f64; 1])| GradientPoint { magnitude, opacity };
    let line = opacities(nodes);
    if opaque(&line) { Vec::new() } else { line.into_iter().map(point).collect() }
}
