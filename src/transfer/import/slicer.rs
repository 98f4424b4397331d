//! Volume properties of 3D Slicer: `.vp` (lines of numbers), `.vp.json`, and files of presets.

use roxmltree::Document;
use serde_json::Value;

use super::curve::{Node, colors, opacities};
use super::space::Space;
use super::{Found, chosen, fault, groups, number, numbers, opaque};
use crate::error::Result;
use crate::transfer::GradientPoint;

/// What a `.vp` and an element of a preset file state.
struct Property<'a> {
    shade: &'a str,
    /// Ambient, diffuse, specular and power.
    material: [&'a str; 4],
    scalar_opacity: &'a str,
    gradient_opacity: &'a str,
    colors: &'a str,
}

/// A `.vp`: interpolation, shade, diffuse, ambient, specular, power, opacities, gradient opacities and colours, each a
/// line.
pub(super) fn lines(text: &str) -> Result<Found> {
    let lines: Vec<&str> = text.lines().map(str::trim).filter(|line| !line.is_empty()).collect();
    let &[_, shade, diffuse, ambient, specular, power, scalar_opacity, gradient_opacity, colors, ..] = lines.as_slice()
    else {
        return Err(fault(format!("{} lines of numbers, expected the 9 of a volume property", lines.len())));
    };
    let material = [ambient, diffuse, specular, power];
    property(&Property { shade, material, scalar_opacity, gradient_opacity, colors })
}

/// A file of `VolumeProperty` elements.
pub(super) fn presets(document: &Document<'_>, name: Option<&str>) -> Result<Found> {
    let elements = document.descendants().filter(|node| node.has_tag_name("VolumeProperty"));
    let named = elements.map(|node| (node.attribute("name").unwrap_or("(no name)").to_owned(), node)).collect();
    let element = chosen(named, name)?;
    let text = |key: &str| element.attribute(key).unwrap_or_default();
    property(&Property {
        shade: text("shade"),
        material: ["ambient", "diffuse", "specular", "specularPower"].map(text),
        scalar_opacity: text("scalarOpacity"),
        gradient_opacity: text("gradientOpacity"),
        colors: text("colorTransfer"),
    })
}

fn property(property: &Property<'_>) -> Result<Found> {
    let plain = |[at, value]: [f64; 2]| Node::plain(at, [value]);
    let gradient: Vec<Node<1>> = match property.gradient_opacity {
        "" => Vec::new(),
        text => groups::<2>(&counted(text)?, "gradient opacity")?.into_iter().map(plain).collect(),
    };
    let nodes = groups::<2>(&counted(property.scalar_opacity)?, "scalar opacity")?;
    let points = groups::<4>(&counted(property.colors)?, "colour transfer")?;
    let mut found = Found {
        colors: Some(colors(points.into_iter().map(|[x, r, g, b]| Node::plain(x, [r, g, b])).collect(), Space::Rgb)),
        opacities: Some(opacities(nodes.into_iter().map(plain).collect())),
        placed: true,
        ..Found::default()
    };
    found.take_gradient(gradient);
    if property.shade == "1" {
        let material = property.material.map(|text| text.parse().ok().filter(|n: &f64| n.is_finite()));
        if let [Some(ambient), Some(diffuse), Some(specular), Some(power)] = material {
            found.material = Some([ambient, diffuse, specular, power]);
        }
    }
    Ok(found)
}

/// Numbers between blanks; the first is their count.
fn counted(text: &str) -> Result<Vec<f64>> {
    let number = |word: &str| {
        let number = word.parse().ok().filter(|n: &f64| n.is_finite());
        number.ok_or_else(|| fault(format!("{word:?}, expected a number")))
    };
    let numbers = text.split_whitespace().map(number).collect::<Result<Vec<f64>, _>>()?;
    match numbers.split_first() {
        Some((count, numbers)) if *count == numbers.len() as f64 => Ok(numbers.to_vec()),
        Some((count, numbers)) => Err(fault(format!("{} numbers where {count} are announced", numbers.len()))),
        None => Err(fault("a function has no points")),
    }
}

/// A `.vp.json`, of which the first component is read.
pub(super) fn json(value: &Value, name: Option<&str>) -> Result<Found> {
    let properties = value.get("volumeProperties").and_then(Value::as_array).map(Vec::as_slice).unwrap_or_default();
    let label = |property: &Value| property.get("name").and_then(Value::as_str).unwrap_or("(no name)").to_owned();
    let property = chosen(properties.iter().map(|property| (label(property), property)).collect(), name)?;
    let components = property.get("components").and_then(Value::as_array).map(Vec::as_slice).unwrap_or_default();
    let Some(component) = components.first() else {
        return Err(fault("its volume property has no components"));
    };
    let mut found = self::component(component)?;
    if components.len() > 1 {
        found.notes.push(format!("of its {} components the first is taken", components.len()));
    }
    Ok(found)
}

fn component(component: &Value) -> Result<Found> {
    let mut found = Found { placed: true, ..Found::default() };
    let points = |key: &str| component.get(key).and_then(|f| f.get("points")).and_then(Value::as_array);
    if let Some(points) = points("rgbTransferFunction") {
        let function = component.get("rgbTransferFunction");
        let space = function.and_then(|f| f.get("colorSpace")).and_then(Value::as_str).unwrap_or("RGB");
        let (space, note) = Space::named(space, false)?;
        found.notes.extend(note.map(str::to_owned));
        let nodes = points.iter().map(|point| {
            let color = groups::<3>(&numbers(&point["color"])?, "color")?;
            node(point, color[0])
        });
        found.colors = Some(colors(nodes.collect::<Result<_>>()?, space)).filter(|line| !line.is_empty());
    }
    let curve = |key: &str| {
        let nodes = points(key).map(Vec::as_slice).unwrap_or_default().iter();
        nodes.map(|point| node(point, [number(&point["y"])?])).collect::<Result<Vec<_>>>()
    };
    found.opacities = Some(opacities(curve("scalarOpacity")?)).filter(|line| !line.is_empty());
    if component.get("disableGradientOpacity").and_then(Value::as_bool) != Some(true) {
        found.take_gradient(curve("gradientOpacity")?);
    }
    found.unit_distance = component.get("scalarOpacityUnitDistance").map(number).transpose()?;
    if component.get("shade").and_then(Value::as_bool) == Some(true)
        && let Some(lighting) = component.get("lighting")
    {
        let [ambient, diffuse, specular, power] =
            ["ambient", "diffuse", "specular", "specularPower"].map(|key| lighting.get(key).map(number).transpose());
        let material = ambient?.zip(diffuse?).zip(specular?).zip(power?);
        found.material = material.map(|(((ambient, diffuse), specular), power)| [ambient, diffuse, specular, power]);
    }
    Ok(found)
}

/// A point with its midpoint and sharpness.
fn node<const N: usize>(point: &Value, value: [f64; N]) -> Result<Node<N>> {
    let or = |key: &str, default: f64| point.get(key).map_or(Ok(default), number);
    Ok(Node { at: number(&point["x"])?, value, midpoint: or("midpoint", 0.5)?, sharpness: or("sharpness", 0.0)? })
}

impl Found {
    /// Keeps opacities over gradients, if they say anything.
    fn take_gradient(&mut self, nodes: Vec<Node<1>>) {
        let line = opacities(nodes);
        if !opaque(&line) {
            let point = |(magnitude, [opacity]): (f64, [f64; 1])| GradientPoint { magnitude, opacity };
            self.gradient = line.into_iter().map(point).collect();
        }
    }
}
