//! PLY, the Stanford polygon format, as text or binary (Turk 1994, "The PLY polygon file format").

use std::path::Path;

use super::{Mesh, Space, index};
use crate::error::{Error, Result, Subject, refuse, refuse_if};
use crate::volume::{Endian, SampleType};

/// A property of an element: a number, or a list whose length comes first.
struct Property {
    name: String,
    length: Option<SampleType>,
    kind: SampleType,
}

/// A kind of element of a file, such as a vertex, and the number of its elements.
struct Element {
    name: String,
    count: u64,
    properties: Vec<Property>,
}

/// The numbers behind the header.
enum Numbers<'a> {
    Text(std::str::SplitAsciiWhitespace<'a>),
    Binary(&'a [u8], Endian),
}

pub(super) fn read(path: &Path, bytes: &[u8]) -> Result<Mesh> {
    let mut mesh = Mesh::default();
    let (elements, mut numbers) = header(path, bytes, &mut mesh)?;
    for Element { name, count, properties } in &elements {
        let is_vertex = name == "vertex";
        let at = |name: &str| properties.iter().position(|property| property.name == name && property.length.is_none());
        let places = ["x", "y", "z"].map(at);
        if is_vertex && let Some(axis) = places.iter().position(Option::is_none) {
            refuse!(path, "its vertices have no {}", ["x", "y", "z"][axis]);
        }
        let colors = [["red", "diffuse_red"], ["green", "diffuse_green"], ["blue", "diffuse_blue"]];
        let colors = colors.map(|[name, other]| at(name).or_else(|| at(other)));
        let faces = ["vertex_indices", "vertex_index"];
        let mut values: Vec<f64> = Vec::new();
        let mut corners: Vec<u32> = Vec::new();
        for _ in 0..*count {
            values.clear();
            for Property { name: list, length, kind } in properties {
                let Some(length) = length else {
                    values.push(numbers.next(path, *kind)?);
                    continue;
                };
                // Keeps the place of the list among the properties.
                values.push(0.0);
                let is_face = name == "face" && faces.contains(&list.as_str());
                corners.clear();
                for _ in 0..index(path, numbers.next(path, *length)?)? {
                    let number = numbers.next(path, *kind)?;
                    if is_face {
                        corners.push(index(path, number)?);
                    }
                }
                mesh.add_polygon(&corners);
            }
            if is_vertex {
                mesh.vertices.push(places.map(|at| at.map_or(0.0, |at| values[at] as f32)));
                if let [Some(red), Some(green), Some(blue)] = colors {
                    let scale = if properties[red].kind == SampleType::U8 { 1.0 } else { 255.0 };
                    mesh.colors.push([red, green, blue].map(|at| (scale * values[at]).round() as u8));
                }
            }
        }
    }
    Ok(mesh)
}

/// Reads the header: the elements, and the numbers behind it.
fn header<'a>(path: &Path, bytes: &'a [u8], mesh: &mut Mesh) -> Result<(Vec<Element>, Numbers<'a>)> {
    let mut elements: Vec<Element> = Vec::new();
    let (mut format, mut rest) = (None, bytes);
    loop {
        let Some(end) = rest.iter().position(|&byte| byte == b'\n') else {
            refuse!(path, "is cut short: its header has no end_header");
        };
        let (line, after) = rest.split_at(end);
        rest = &after[1..];
        let line = String::from_utf8_lossy(line);
        let words: Vec<&str> = line.split_ascii_whitespace().collect();
        let bad = || path.error(format!("its header has a line {:?}, which is not read", line.trim()));
        let kind = |name: &str| SampleType::from_name(name).ok_or_else(bad);
        match words[..] {
            ["format", name, _] => format = Some(name.to_owned()),
            ["comment" | "obj_info", ..] => mesh.space = mesh.space.or(Space::of_comment(&line)),
            ["element", name, count] => {
                let count = count.parse().map_err(|_| bad())?;
                elements.push(Element { name: name.to_owned(), count, properties: Vec::new() });
            }
            ["property", "list", length, of, name] => {
                let property = Property { name: name.to_owned(), length: Some(kind(length)?), kind: kind(of)? };
                elements.last_mut().ok_or_else(bad)?.properties.push(property);
            }
            ["property", of, name] => {
                let property = Property { name: name.to_owned(), length: None, kind: kind(of)? };
                elements.last_mut().ok_or_else(bad)?.properties.push(property);
            }
            ["end_header"] => break,
            ["ply"] | [] => {}
            _ => return Err(bad()),
        }
    }
    let empty = |element: &&Element| element.count > 0 && element.properties.is_empty();
    if let Some(element) = elements.iter().find(empty) {
        refuse!(path, "its element {} has no property", element.name);
    }
    let numbers = match format.as_deref() {
        Some("ascii") => match std::str::from_utf8(rest) {
            Ok(text) => Numbers::Text(text.split_ascii_whitespace()),
            Err(_) => refuse!(path, "is no text behind its header, which says ascii"),
        },
        Some("binary_little_endian") => Numbers::Binary(rest, Endian::Little),
        Some("binary_big_endian") => Numbers::Binary(rest, Endian::Big),
        other => refuse!(path, "has the format {:?}, which is not read", other.unwrap_or_default()),
    };
    Ok((elements, numbers))
}

impl Numbers<'_> {
    /// Reads the next number.
    fn next(&mut self, path: &Path, kind: SampleType) -> Result<f64> {
        match self {
            Self::Text(words) => {
                let word = words.next().ok_or_else(|| cut_short(path))?;
                word.parse().map_err(|_| path.error(format!("has {word:?} in place of a number")))
            }
            Self::Binary(bytes, endian) => {
                let size = kind.size();
                refuse_if!(bytes.len() < size, path, "is cut short: its header states more");
                let (number, rest) = bytes.split_at(size);
                *bytes = rest;
                Ok(kind.number(number, *endian))
            }
        }
    }
}

fn cut_short(path: &Path) -> Error {
    path.error("is cut short: its header states more")
}
