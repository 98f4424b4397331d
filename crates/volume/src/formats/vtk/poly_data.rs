//! PolyData in XML, .vtp: meshes.

use std::path::Path;

use super::image_data::{ArrayPlace, Coding, place, tag};
use crate::error::{Result, Subject, refuse, refuse_if};
use crate::formats::decode::Layout;
use crate::formats::input::Input;
use crate::formats::selection::choice;
use crate::formats::xml::Tag;
use crate::memory::reserved;
use crate::meshes::Mesh;
use crate::volume::SampleType;

/// Reads the polygons of a file. Lines, strips and vertices are left out.
pub(crate) fn read(path: &Path) -> Result<Mesh> {
    let mut input = Input::open(path, None)?;
    let file = tag(&mut input, "VTKFile")?;
    match file.as_ref().and_then(|file| file.get("type")) {
        Some("PolyData") => {}
        other => refuse!(path, "is of type {:?}, expected PolyData", other.unwrap_or_default()),
    }
    let Some(piece) = tag(&mut input, "Piece")? else { refuse!(path, "has no tag Piece") };
    refuse_if!(tag(&mut input, "Piece")?.is_some(), path, "is in several pieces: save it as one");
    let count = |name: &str| -> Result<u64> {
        let text = piece.get(name).unwrap_or("0");
        text.trim().parse().map_err(|_| path.error(format!("{name} is {text:?}, expected a number")))
    };
    let (points, polygons) = (count("NumberOfPoints")?, count("NumberOfPolys")?);
    let mut mesh = Mesh::default();
    let places = array(path, "Points", &|_| true, points.saturating_mul(3))?;
    mesh.vertices = places.chunks_exact(3).map(|place| [0, 1, 2].map(|axis| place[axis] as f32)).collect();
    let named = |name: &'static str| move |tag: &Tag| tag.get("Name") == Some(name);
    let ends = array(path, "Polys", &named("offsets"), polygons)?;
    let last = ends.last().copied().unwrap_or_default();
    let corners = array(path, "Polys", &named("connectivity"), last as u64)?;
    let mut first = 0;
    let mut polygon = Vec::new();
    for end in ends {
        let Some(of_polygon) = corners.get(first..end as usize) else {
            refuse!(path, "has offsets that do not ascend")
        };
        polygon.clear();
        for &corner in of_polygon {
            polygon.push(crate::meshes::index(path, corner)?);
        }
        mesh.add_polygon(&polygon);
        first = end as usize;
    }
    Ok(mesh)
}

/// Reads the `count` numbers of the first array of a section that `matches`.
fn array(path: &Path, section: &str, matches: &dyn Fn(&Tag) -> bool, count: u64) -> Result<Vec<f64>> {
    if count == 0 {
        return Ok(Vec::new());
    }
    let mut input = Input::open(path, None)?;
    let Some(file) = tag(&mut input, "VTKFile")? else { refuse!(path, "is not a VTK file: it has no tag VTKFile") };
    let coding = Coding::of(&file, &input)?;
    let missing = || path.error(format!("has no array of its {section}"));
    tag(&mut input, section)?.ok_or_else(missing)?;
    let array = loop {
        let array = tag(&mut input, "DataArray")?.ok_or_else(missing)?;
        if matches(&array) {
            break array;
        }
    };
    let name = array.get("type").unwrap_or_default();
    let Some(kind) = SampleType::from_name(name) else {
        refuse!(path, "has an array of type {name:?}, which is not read");
    };
    let place = match place(&array, &input)? {
        ArrayPlace::Appended { offset, .. } => {
            let Some(appended) = tag(&mut input, "AppendedData")? else {
                refuse!(path, "is cut short: it has no appended data")
            };
            let base64 = choice(path, "encoding", appended.get("encoding"), [("base64", true), ("raw", false)])?;
            ArrayPlace::Appended { offset, base64 }
        }
        place => place,
    };
    let (mut input, layout) = coding.at_samples(input, place)?;
    let cut_short = format!("is cut short: its {section} need {count} numbers");
    match layout {
        Layout::Text => {
            refuse_if!(input.at_most().is_some_and(|left| count > left), path, "{cut_short}");
            let mut numbers = reserved(count, || format!("the mesh {}", path.display()))?;
            let mut token = String::new();
            for _ in 0..count {
                refuse_if!(!input.token(&mut token)?, path, "{cut_short}");
                numbers.push(token.parse().map_err(|_| path.error(format!("has {token:?} in place of a number")))?);
            }
            Ok(numbers)
        }
        Layout::Binary(endian) => {
            let size = kind.size();
            let mut bytes = Vec::new();
            input.append(count.saturating_mul(size as u64), &mut bytes)?;
            refuse_if!(bytes.len() as u64 / (size as u64) < count, path, "{cut_short}");
            Ok(bytes.chunks_exact(size).map(|number| kind.number(number, endian)).collect())
        }
    }
}
