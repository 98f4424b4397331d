//! Wavefront OBJ: vertices and faces as lines of text. Lines of other things are skipped.

use std::path::Path;

use super::Mesh;
use crate::error::{Result, Subject, refuse};

pub(super) fn read(path: &Path, bytes: &[u8]) -> Result<Mesh> {
    let mut mesh = Mesh::default();
    let mut corners = Vec::new();
    for (number, line) in (1..).zip(String::from_utf8_lossy(bytes).lines()) {
        let mut words = line.split_ascii_whitespace();
        match words.next() {
            Some("v") => {
                let numbers: Vec<f32> = words.map_while(|word| word.parse().ok()).collect();
                let Some(place) = numbers.first_chunk() else {
                    refuse!(path, "line {number} is {line:?}, expected v and three numbers");
                };
                mesh.vertices.push(*place);
                // Some programs write the colour of a vertex behind its place, 0 to 1.
                if let Some(&[r, g, b]) = numbers.get(3..).and_then(|rest| rest.first_chunk()) {
                    mesh.colors.push([r, g, b].map(|channel| (255.0 * channel.clamp(0.0, 1.0)).round() as u8));
                }
            }
            Some("f") => {
                corners.clear();
                for word in words {
                    // Numbers of normals and of places in pictures stand behind slashes. Numbers begin at 1, or at -1
                    // from the last vertex so far.
                    let stated = word.split('/').next().and_then(|text| text.parse::<i64>().ok());
                    let index = stated
                        .and_then(|n| if n < 0 { n.checked_add(mesh.vertices.len() as i64) } else { n.checked_sub(1) });
                    let Some(index) = index.and_then(|index| u32::try_from(index).ok()) else {
                        refuse!(path, "line {number} is {line:?}, expected f and numbers of vertices, from 1");
                    };
                    corners.push(index);
                }
                mesh.add_polygon(&corners);
            }
            _ => {}
        }
    }
    if mesh.colors.len() != mesh.vertices.len() {
        mesh.colors.clear();
    }
    Ok(mesh)
}
