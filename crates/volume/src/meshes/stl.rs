//! STL: triangles without shared vertices, as text or in 50 bytes each ("StereoLithography Interface Specification", 3D
//! Systems, 1989).

use std::path::Path;

use super::{Mesh, Space};
use crate::error::{Result, Subject, refuse, refuse_if};

/// The number of bytes before the number of triangles, and before the first triangle.
const HEADER: usize = 80;
pub(super) const BEFORE: usize = 84;
/// The number of bytes of a triangle: a normal, three places, and two bytes without meaning.
const TRIANGLE: usize = 50;

/// Returns the number of triangles that a binary file states.
fn stated(bytes: &[u8]) -> Option<usize> {
    bytes.get(HEADER..)?.first_chunk().map(|count| u32::from_le_bytes(*count) as usize)
}

/// Returns whether a file has the length that its number of triangles needs in binary.
fn is_whole(bytes: &[u8]) -> bool {
    stated(bytes).is_some_and(|count| bytes.len() == BEFORE + TRIANGLE * count)
}

fn is_text(bytes: &[u8]) -> bool {
    // Binary files may begin like text.
    !is_whole(bytes) && bytes.starts_with(b"solid") && !bytes[..bytes.len().min(HEADER)].contains(&0)
}

/// Returns whether the bytes can be an STL file.
pub(super) fn is_stl(bytes: &[u8]) -> bool {
    is_text(bytes) || is_whole(bytes)
}

pub(super) fn read(path: &Path, bytes: &[u8]) -> Result<Mesh> {
    let mut mesh = Mesh::default();
    if is_text(bytes) {
        for (number, line) in (1..).zip(String::from_utf8_lossy(bytes).lines()) {
            let mut words = line.split_ascii_whitespace();
            if number == 1 {
                mesh.space = Space::of_comment(line);
            }
            if words.next() == Some("vertex") {
                let numbers: Option<Vec<f32>> = words.map(|word| word.parse().ok()).collect();
                let Some(place) = numbers.and_then(|numbers| numbers.try_into().ok()) else {
                    refuse!(path, "line {number} is {:?}, expected vertex and three numbers", line.trim());
                };
                mesh.vertices.push(place);
            }
        }
        refuse_if!(!mesh.vertices.len().is_multiple_of(3), path, "is cut short: its last facet lacks a vertex");
    } else {
        let count = stated(bytes).unwrap_or_default();
        let Some(triangles) = count.checked_mul(TRIANGLE).and_then(|size| bytes[BEFORE..].get(..size)) else {
            refuse!(path, "is cut short, or is no STL: {count} triangles need {} bytes", 84 + 50 * count as u64);
        };
        mesh.space = Space::of_comment(&String::from_utf8_lossy(&bytes[..HEADER]));
        let number = |bytes: &[u8]| bytes.first_chunk().map_or(0.0, |bytes| f32::from_le_bytes(*bytes));
        for triangle in triangles.chunks_exact(TRIANGLE) {
            let corner = |n: usize| std::array::from_fn(|axis| number(&triangle[12 + 12 * n + 4 * axis..]));
            mesh.vertices.extend([0, 1, 2].map(corner));
        }
    }
    let count = mesh.vertices.len() as u32;
    mesh.triangles = (0..count / 3).map(|n| [3 * n, 3 * n + 1, 3 * n + 2]).collect();
    Ok(mesh)
}
