//! Normals of a mesh at the corners of its triangles.

use glam::DVec3;
use rayon::prelude::*;

use super::Mesh;

/// The cosine of the largest angle between triangles that share a normal: 40 degrees.
const CREASE: f64 = 0.766;

/// Returns the normal at each corner of each triangle: the sum of the normals, by their areas, of the triangles around
/// its place that lie within 40 degrees of its own. Triangles without an area have a normal of 0.
pub(super) fn corner_normals(mesh: &Mesh) -> Vec<[DVec3; 3]> {
    let faces: Vec<DVec3> = mesh.triangles.par_iter().map(|&triangle| face(mesh, triangle)).collect();
    let (places, count) = places(mesh);
    // The triangles around each place, one list behind the other.
    let mut ends = vec![0_usize; count + 1];
    let corners = || mesh.triangles.iter().flatten().map(|&vertex| places[vertex as usize] as usize);
    corners().for_each(|place| ends[place + 1] += 1);
    (0..count).for_each(|place| ends[place + 1] += ends[place]);
    let (mut next, mut around) = (ends.clone(), vec![0_u32; 3 * mesh.triangles.len()]);
    for (number, place) in corners().enumerate() {
        around[next[place]] = (number / 3) as u32;
        next[place] += 1;
    }
    let normal = |vertex: u32, own: DVec3| {
        let place = places[vertex as usize] as usize;
        let others = around[ends[place]..ends[place + 1]].iter().map(|&other| faces[other as usize]);
        let unit = own.normalize_or_zero();
        others.filter(|other| unit.dot(*other) > CREASE * other.length()).sum::<DVec3>().normalize_or(unit)
    };
    let triangles = mesh.triangles.par_iter().zip(&faces);
    triangles.map(|(corners, &own)| corners.map(|vertex| normal(vertex, own))).collect()
}

/// Returns the number of the place of each vertex, and the number of places. Vertices share places whether or not
/// triangles share vertices: an STL has no vertices in common.
fn places(mesh: &Mesh) -> (Vec<u32>, usize) {
    // The positive zero stands for both.
    let key = |vertex: u32| mesh.vertices[vertex as usize].map(|number| (number + 0.0).to_bits());
    let mut order: Vec<u32> = (0..mesh.vertices.len() as u32).collect();
    order.par_sort_unstable_by_key(|&vertex| key(vertex));
    let mut places = vec![0; order.len()];
    let mut count = 0;
    for group in order.chunk_by(|&a, &b| key(a) == key(b)) {
        group.iter().for_each(|&vertex| places[vertex as usize] = count);
        count += 1;
    }
    (places, count as usize)
}

/// Returns twice the area of a triangle along its normal.
fn face(mesh: &Mesh, [a, b, c]: [u32; 3]) -> DVec3 {
    let [a, b, c] = [a, b, c].map(|vertex| mesh.place(vertex));
    (b - a).cross(c - a)
}
