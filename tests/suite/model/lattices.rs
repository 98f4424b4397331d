//! Labels and masks on other lattices than the scan: the picture equals the picture of labels on the lattice of the
//! scan.

use glam::{DAffine3, DMat3, DVec3};
use voxsplat::camera::ProjectionKind;
use voxsplat::error::Error;
use voxsplat::image::Image;
use voxsplat::layers::{Fit, LabelSelection, Labels, Layer, Layers, on_lattice};
use voxsplat::transfer::TransferFunction;
use voxsplat::volume::{Grid, Samples, Volume};

use crate::support::{camera, draw, full, renderer, transfer, two_lights};
use voxsplat::settings::Settings;

/// Voxels of the scan along its axes.
const DIMS: [usize; 3] = [30, 26, 22];
const SPACING: [f64; 3] = [1.0, 1.25, 1.5];
const ORIGIN: DVec3 = DVec3::new(-40.0, 12.5, 7.0);

/// The label at a voxel of the scan.
fn label([x, y, z]: [usize; 3]) -> u8 {
    let place = [x, y, z].map(|p| p as f64);
    let middle = [15.0, 12.0, 10.0];
    let radius = place.iter().zip(middle).map(|(p, m)| (p - m) * (p - m)).sum::<f64>().sqrt();
    match radius {
        r if r > 9.0 => 0,
        _ if x > 17 => 3,
        _ if y + z > 24 => 7,
        _ => 1,
    }
}

/// A volume with the samples of `sample` at the voxels of a lattice with these axes.
fn volume<T: Into<f64>>(
    dims: [usize; 3],
    axes: [DVec3; 3],
    origin: DVec3,
    sample: impl Fn([usize; 3]) -> T,
    oriented: bool,
) -> Volume {
    let [nx, ny, nz] = dims;
    let place = |i: usize| [i % nx, i / nx % ny, i / nx / ny];
    let samples = (0..nx * ny * nz).map(|i| sample(place(i)).into() as i16).collect();
    let to_world = DAffine3::from_mat3_translation(DMat3::from_cols(axes[0], axes[1], axes[2]), origin);
    let grid = Grid::new(dims.map(|d| d as u32), to_world).unwrap();
    let volume = Volume::new(grid, Samples::I16(samples)).unwrap();
    if oriented { volume.with_orientation_known() } else { volume }
}

fn axes() -> [DVec3; 3] {
    [0, 1, 2].map(|axis| DVec3::AXES[axis] * SPACING[axis])
}

fn scan() -> (Volume, TransferFunction) {
    let scan = volume(DIMS, axes(), ORIGIN, |[x, y, z]| (4 * x + 3 * y + (x * y * z) % 17) as i16, true);
    (scan, transfer(&[(20.0, [0.2, 0.4, 1.0], 0.0), (150.0, [1.0, 0.8, 0.5], 0.3)], None))
}

fn matching() -> Volume {
    volume(DIMS, axes(), ORIGIN, label, true)
}

/// The same labels on other lattices: flipped along two axes, with the axes in another order, with a border of 0 that
/// moves the first voxel, twice as fine, and with a border and a fifth of a voxel off.
fn others() -> [(&'static str, Volume); 5] {
    let [a, b, c] = axes();
    let [nx, ny, nz] = DIMS;
    let far = ORIGIN + a * (nx - 1) as f64 + c * (nz - 1) as f64;
    let flipped = |[x, y, z]: [usize; 3]| label([nx - 1 - x, y, nz - 1 - z]);
    let bordered = |[x, y, z]: [usize; 3]| {
        let inside = |p: usize, n: usize, border: usize| p >= border && p < n + border;
        if inside(x, nx, 3) && inside(y, ny, 2) && inside(z, nz, 4) { label([x - 3, y - 2, z - 4]) } else { 0 }
    };
    let around = [nx + 5, ny + 6, nz + 6];
    let border = ORIGIN - 3.0 * a - 2.0 * b - 4.0 * c;
    // The centres of the eight fine voxels are a quarter of a voxel from the centre of the coarse voxel.
    let fine = [2 * nx, 2 * ny, 2 * nz];
    let corner = ORIGIN - (a + b + c) / 4.0;
    [
        ("flipped", volume(DIMS, [-a, b, -c], far, flipped, true)),
        ("permuted", volume([nz, nx, ny], [c, a, b], ORIGIN, |[z, x, y]| label([x, y, z]), true)),
        ("shifted", volume(around, [a, b, c], border, bordered, true)),
        ("finer", volume(fine, [a / 2.0, b / 2.0, c / 2.0], corner, |p| label(p.map(|p| p / 2)), true)),
        ("off", volume(around, [a, b, c], border + (a + b - c) / 5.0, bordered, true)),
    ]
}

fn picture(layers: &Layers, of: &Volume) -> Image {
    let settings = Settings { lighting: two_lights(), ..full() };
    let camera = camera(33.0, ProjectionKind::Orthographic, of, 40);
    draw(&renderer().prepare_layers(layers, &settings).unwrap(), &camera, &settings).image
}

#[test]
fn labels_on_other_lattices_give_the_picture_of_the_matching_one() {
    let (scan, transfer) = scan();
    let over =
        |labels: &Volume| Layers::of_volume(&scan, &transfer).with(Layer::labels(labels, &Labels::default()).unwrap());
    let masked = |mask: &Volume| {
        let which = LabelSelection::Numbers(vec![[3, 7]]);
        Layer::scalars(&scan, &transfer).masked(mask, &which).map(Layers::new)
    };
    let truth = [over(&matching()).unwrap(), masked(&matching()).unwrap()].map(|layers| picture(&layers, &scan));
    assert!(truth[0].pixels() != truth[1].pixels());
    assert!(on_lattice(&matching(), &scan).unwrap().1 == Fit::Same);
    for (name, labels) in others() {
        // Without a new lattice the labels are refused, as labels and as masks.
        let refused = |error: Error| error.to_string();
        assert!(refused(over(&labels).unwrap_err()).starts_with("labels: "), "{name}");
        assert!(refused(masked(&labels).unwrap_err()).starts_with("mask: "), "{name}");
        let (placed, fit) = on_lattice(&labels, &scan).unwrap();
        assert_eq!(fit, Fit::Nearest { outside: 0.0 }, "{name}");
        assert_eq!(placed.grid(), scan.grid());
        let drawn = [over(&placed).unwrap(), masked(&placed).unwrap()].map(|layers| picture(&layers, &scan));
        // No label is interpolated, so each voxel has its true label, and the picture has the same bytes.
        assert!(drawn[0].pixels() == truth[0].pixels() && drawn[1].pixels() == truth[1].pixels(), "{name}");
    }
}

#[test]
fn less_than_half_a_voxel_changes_no_label() {
    let [a, b, c] = axes();
    let shifted = |by: f64| volume(DIMS, [a, b, c], ORIGIN + by * (a - b + c), label, true);
    let (scan, _) = scan();
    assert_eq!(on_lattice(&shifted(0.49), &scan).unwrap().1, Fit::Same);
    let (placed, fit) = on_lattice(&shifted(0.51), &scan).unwrap();
    assert!(matches!(fit, Fit::Nearest { .. }));
    // The ball moved by one voxel along each axis.
    let memory = placed.in_memory().unwrap();
    let at = |[x, y, z]: [usize; 3]| memory.value(x + DIMS[0] * (y + DIMS[1] * z));
    assert!(at([15, 12, 10]) == f64::from(label([14, 13, 9])) && at([18, 12, 10]) == f64::from(label([17, 13, 9])));
    assert_eq!(at([0, 3, 3]), 0.0);
}

#[test]
fn what_lies_outside_is_told_and_what_lies_elsewhere_is_refused() {
    let (scan, _) = scan();
    let [a, b, c] = axes();
    // A block of labels; a quarter of it lies beyond the last voxels along x.
    let block = |along: f64| volume([8, 4, 4], [a, b, c], ORIGIN + along * a, |_| 5_u8, true);
    assert_eq!(on_lattice(&block(24.0), &scan).unwrap().1, Fit::Nearest { outside: 0.25 });
    let refused = |labels: &Volume, reason: &str| {
        let error = on_lattice(labels, &scan).unwrap_err().to_string();
        assert!(error.starts_with("labels: ") && error.contains(reason), "{error}");
    };
    refused(&block(30.0), "nothing of it lies in the volume");
    refused(&block(-500.0), "nothing of it lies in the volume");
    // The lattices meet, the labels do not.
    let far = volume([60, 4, 4], [a, b, c], ORIGIN, |[x, ..]| u8::from(x > 40), true);
    refused(&far, "nothing of it lies in the volume");
    // A file without a position is matched voxel by voxel, or refused.
    let silent = volume(DIMS, DVec3::AXES, DVec3::ZERO, label, false);
    assert_eq!(on_lattice(&silent, &scan).unwrap().1, Fit::Unplaced);
    refused(&volume([3; 3], DVec3::AXES, DVec3::ZERO, |_| 1_u8, false), "do not say where both lie");
    // Values of a rescaled file: outside is label 0, not sample 0.
    let rescaled = volume([8, 4, 4], [a, b, c], ORIGIN + 4.0 * a, |_| 4_u8, true).with_rescale(2.0, -3.0).unwrap();
    let (placed, _) = on_lattice(&rescaled, &scan).unwrap();
    let memory = placed.in_memory().unwrap();
    assert_eq!([0, 3, 4, 11, 12].map(|x| memory.value(x)), [0.0, 0.0, 5.0, 5.0, 0.0]);
}
