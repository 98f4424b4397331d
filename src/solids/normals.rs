//! Normals of a mesh at the corners of its triangles.

use std::collections::HashMap;

use glam::DVec3;

use super::Mesh;

/// The cosine of the largest angle between triangles that share a normal: 40 degrees.
const CREASE: f64 = 0.766;

/// The normal at each corner of each triangle: the sum of the normals of the triangles around its place, by their areas,
/// that lie within 40 degrees of its own. Triangles without an area have a normal of 0.
pub(super) fn corner_normals(mesh: &Mesh) -> Vec<[DVec3; 3]> {
    let faces: Vec<DVec3> = mesh.triangles.iter().map(|&triangle| face(mesh, triangle)).collect();
    // Triangles share places, whether or not they share vertices: an STL has no vertices in common.
    let mut around: HashMap<[u32; 3], Vec<u32>> = HashMap::new();
    // The positive zero stands for both.
    let key = |vertex: u32| mesh.vertices[vertex as usize].map(|number| (number + 0.0).to_bits());
    for (number, triangle) in (0_u32..).zip(&mesh.triangles) {
        triangle.iter().for_each(|&vertex| around.entry(key(vertex)).or_default().push(number));
    }
    let normal = |vertex: u32, own: DVec3| {
        let others = around.get(&key(vertex)).into_iter().flatten().map(|&other| faces[other as usize]);
        let unit = own.normalize_or_zero();
        others.filter(|other| unit.dot(other.normalize_or_zero()) > CREASE).sum::<DVec3>().normalize_or(unit)
    };
    mesh.triangles.iter().zip(&faces).map(|(corners, &own)| corners.map(|vertex| normal(vertex, own))).collect()
}

/// Twice the area of a triangle along its normal.
fn face(mesh: &Mesh, [a, b, c]: [u32; 3]) -> DVec3 {
    let [a, b, c] = [a, b, c].map(|vertex| mesh.place(vertex));
    (b - a).cross(c - a)
}
