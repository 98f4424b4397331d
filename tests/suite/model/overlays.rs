//! Overlays on lattices of their own: against layers on one lattice, the f64 reference and media on their own lattices.

use glam::{DAffine3, DMat3, DVec3};
use voxsplat::camera::{Camera, View};
use voxsplat::image::Image;
use voxsplat::layers::{Fit, Lattice, Layer, Layers};
use voxsplat::program::{Overlay, OverlaySpec, Overlays, UsedColors};
use voxsplat::reference::Reference;
use voxsplat::settings::Settings;
use voxsplat::transfer::TransferFunction;
use voxsplat::volume::{Grid, Units, Volume};

use crate::support::{draw, errors, full, renderer, rms_covered, transfer, two_lights};

/// A volume of a field of the world, on a lattice with axes and an origin.
fn sampled(dims: [u32; 3], axes: DMat3, origin: DVec3, field: impl Fn(DVec3) -> f64) -> Volume {
    let grid = Grid::new(dims, DAffine3::from_mat3_translation(axes, origin)).unwrap();
    let [nx, ny, nz] = dims;
    let place = |i: u32| {
        grid.to_world().transform_point3(DVec3::new((i % nx).into(), (i / nx % ny).into(), (i / nx / ny).into()))
    };
    let samples: Vec<f32> = (0..nx * ny * nz).map(|i| field(place(i)) as f32).collect();
    Volume::from_slice(dims, [1.0; 3], &samples).unwrap().with_grid(grid).unwrap().with_orientation_known()
}

/// A ball with a soft edge, 13 mm in radius: the scan, at 1 mm.
fn ball(place: DVec3) -> f64 {
    100.0 / (1.0 + ((place.length() - 13.0) / 1.2).exp())
}

/// Two blobs of opposite signs, smoothed by 9 mm: the map, at 3 mm.
fn map(place: DVec3) -> f64 {
    let blob = |center: DVec3| (-(place - center).length_squared() / (2.0 * 3.8_f64.powi(2))).exp();
    8.0 * blob(DVec3::new(-4.0, -3.0, 2.0)) - 6.0 * blob(DVec3::new(6.0, 2.0, -3.0))
}

fn scan() -> Volume {
    sampled([36; 3], DMat3::IDENTITY, DVec3::splat(-17.5), ball)
}

fn activation() -> Volume {
    sampled([13; 3], DMat3::from_diagonal(DVec3::splat(3.0)), DVec3::splat(-17.2), map)
}

fn scan_look() -> TransferFunction {
    transfer(&[(20.0, [0.7; 3], 0.0), (60.0, [0.9; 3], 0.03), (100.0, [0.9; 3], 0.01)], None)
}

fn map_look() -> TransferFunction {
    let (cold, hot) = ([0.1, 0.3, 1.0], [1.0, 0.3, 0.1]);
    let points =
        [(-6.0, cold, 0.8), (-2.3, cold, 0.2), (-2.0, cold, 0.0), (2.0, hot, 0.0), (2.3, hot, 0.2), (6.0, hot, 0.8)];
    transfer(&points, Some(3.0))
}

fn camera(grid: &Grid) -> Camera {
    Camera::new(&View { azimuth: 25.0, elevation: 15.0, ..View::default() }, grid, [64; 2]).unwrap()
}

/// The picture of media that absorb and emit at each place of the world: colour times extinction, and extinction.
fn integrated(camera: &Camera, media: impl Fn(DVec3) -> [f64; 4]) -> Image {
    let step = 0.1;
    let pixel = |i: u32| -> [f32; 4] {
        let (x, y) = camera.image_coordinates([i % 64, i / 64]);
        let (origin, direction) = camera.ray(x, y);
        let direction = direction.normalize();
        let (mut color, mut light) = ([0.0; 3], 1.0_f64);
        let nearest = -origin.dot(direction);
        for k in -400..400 {
            let [r, g, b, tau] = media(origin + direction * (nearest + step * (f64::from(k) + 0.5)));
            if tau > 0.0 {
                let kept = (-tau * step).exp();
                let share = light * (1.0 - kept) / tau;
                [r, g, b].iter().zip(&mut color).for_each(|(e, sum)| *sum += share * e);
                light *= kept;
            }
        }
        [color[0], color[1], color[2], 1.0 - light].map(|channel| channel as f32)
    };
    Image::new(64, 64, (0..64 * 64).map(pixel).collect()).unwrap()
}

/// Colour times extinction, and extinction, of a value.
fn matter(look: &TransferFunction, value: f64, unit: f64) -> [f64; 4] {
    let (color, opacity) = look.sample(value);
    let tau = TransferFunction::extinction(opacity, look.unit_distance().unwrap_or(unit));
    [color[0] * tau, color[1] * tau, color[2] * tau, tau]
}

/// The matter of a volume at a place, as splats of the default kernel on its own lattice.
fn splatted(volume: &Volume, look: &TransferFunction, place: DVec3) -> [f64; 4] {
    // The integral of exp(-r^2 / 2) in a ball of radius 2.
    const INTEGRAL: f64 = 11.631_7;
    let grid = volume.grid();
    let samples = volume.held().unwrap();
    let at = grid.to_lattice().transform_point3(place);
    let [nx, ny, nz] = grid.dims().map(i64::from);
    let mut sum = [0.0; 4];
    let first = (at - 2.0).ceil();
    for step in 0..125 {
        let j = first + DVec3::new((step % 5).into(), (step / 5 % 5).into(), (step / 25).into());
        let r2 = (at - j).length_squared();
        let [x, y, z] = j.to_array().map(|c| c as i64);
        if r2 <= 4.0 && (0..nx).contains(&x) && (0..ny).contains(&y) && (0..nz).contains(&z) {
            let value = samples.raw((x + nx * (y + ny * z)) as usize);
            let weight = (-r2 / 2.0).exp() / INTEGRAL;
            let own = matter(look, value, grid.min_spacing());
            sum.iter_mut().zip(own).for_each(|(sum, channel)| *sum += weight * channel);
        }
    }
    sum
}

fn added(a: [f64; 4], b: [f64; 4]) -> [f64; 4] {
    std::array::from_fn(|channel| a[channel] + b[channel])
}

#[test]
#[ignore = "slow: integrals of two fields for each pixel"]
fn pictures_of_two_lattices_are_near_the_media_and_nearer_to_the_fields_than_splats_of_each() {
    let (scan, activation) = (scan(), activation());
    let (scan_look, map_look) = (scan_look(), map_look());
    let lattice = Lattice::of(&scan);
    let (over, fit) = Layer::scalars(&activation, &map_look).on_lattice(&lattice, "overlay").unwrap();
    assert_eq!(fit, Fit::Interpolated { outside: 0.0 });
    let layers = Layers::of_volume(&scan, &scan_look).with(over).unwrap();
    let camera = camera(scan.grid());
    let settings = Settings { termination: 0.0, ..full() };
    let picture = draw(&renderer().prepare_layers(&layers, &settings).unwrap(), &camera, &settings).image;
    // The same layers in f64: as for layers of one lattice.
    let truth = Reference::of_layers(&layers, &settings).unwrap().render(&camera).unwrap();
    let (worst, rms) = errors(&picture, &truth);
    assert!(rms < 1e-3 && worst < 6e-3, "{rms} {worst}");
    let own =
        integrated(&camera, |place| added(splatted(&scan, &scan_look, place), splatted(&activation, &map_look, place)));
    let fields =
        integrated(&camera, |place| added(matter(&scan_look, ball(place), 1.0), matter(&map_look, map(place), 3.0)));
    let of_fields = [&picture, &own].map(|image| rms_covered(image, &fields));
    let of_own = rms_covered(&picture, &own);
    println!(
        "layers {rms:.1e}, media on their own lattices {of_own:.4}; fields {:.4} and {:.4}",
        of_fields[0], of_fields[1]
    );
    // Splats of 3 mm blur the map: the interpolated values are nearer to the field.
    assert!(of_fields[0] < 0.03 && of_fields[0] < 0.5 * of_fields[1], "{of_fields:?}");
    assert!((0.02..0.12).contains(&of_own), "{of_own}");
}

#[test]
fn overlays_on_an_equal_lattice_are_layers() {
    let scan = scan();
    let over = sampled([36; 3], DMat3::IDENTITY, DVec3::splat(-17.5), map);
    let layer = Layer::scalars(&over, &map_look());
    let (placed, fit) = layer.on_lattice(&Lattice::of(&scan), "overlay").unwrap();
    assert!(fit == Fit::Same && placed == layer);
    let (base, camera) = (Layers::of_volume(&scan, &scan_look()), camera(scan.grid()));
    let settings = Settings { lighting: two_lights(), ..full() };
    let drawn =
        |layers: &Layers| draw(&renderer().prepare_layers(layers, &settings).unwrap(), &camera, &settings).image;
    let plain = base.clone().with(layer.clone()).unwrap();
    assert!(drawn(&base.clone().with(placed).unwrap()) == drawn(&plain));
    // A lattice finer than the scan's becomes that of the picture, and fills the box of the scan.
    let fine =
        sampled([30, 30, 30], DMat3::from_diagonal(DVec3::new(-0.5, 0.5, 0.5)), DVec3::new(4.0, -2.0, -3.0), map);
    let (lattice, refused) = Lattice::finest(&scan, [&over, &fine]).unwrap();
    assert_eq!((lattice.grid.dims(), refused), ([73; 3], None));
    let middle = (lattice.grid.center() - scan.grid().center()).length();
    assert!(middle < 0.5 && lattice.grid.spacing() == [0.5; 3], "{middle}");
    assert_eq!(Lattice::finest(&scan, [&activation()]).unwrap(), (Lattice::of(&scan), None));
    // A lattice far too large stays away.
    let tiny = sampled([8; 3], DMat3::from_diagonal(DVec3::splat(0.001)), DVec3::ZERO, map);
    let (lattice, refused) = Lattice::finest(&scan, [&tiny]).unwrap();
    assert!(lattice == Lattice::of(&scan) && refused.is_some_and(|samples| samples > 1e13));
}

#[test]
fn turned_overlays_lie_in_their_place_and_end_at_their_box() {
    let scan = scan();
    let lattice = Lattice::of(&scan);
    // Two pixels for each millimetre.
    let view = View { view_height: Some(36.0), ..View::default() };
    let camera = Camera::new(&view, scan.grid(), [72; 2]).unwrap();
    let drawn = |layer: &Layer| {
        draw(&renderer().prepare_layers(&Layers::new(layer.clone()), &full()).unwrap(), &camera, &full()).image
    };
    let width = |image: &Image| {
        let row = &image.pixels()[36 * 72..37 * 72];
        row.iter().filter(|pixel| pixel[3] > 0.5 * row[36][3]).count() as f64 / 2.0
    };
    // Flipped and turned lattices of the same field make the same picture.
    let straight = Layer::scalars(&activation(), &map_look()).on_lattice(&lattice, "overlay").unwrap().0;
    for axes in [
        DMat3::from_diagonal(DVec3::new(-3.0, 3.0, -3.0)),
        3.0 * DMat3::from_rotation_z(0.5),
        3.0 * DMat3::from_rotation_x(1.2) * DMat3::from_rotation_y(0.4),
    ] {
        let turned = sampled([17; 3], axes, -(axes * DVec3::splat(8.0)), map);
        let (placed, fit) = Layer::scalars(&turned, &map_look()).on_lattice(&lattice, "overlay").unwrap();
        assert!(matches!(fit, Fit::Interpolated { outside } if outside < 0.05), "{fit:?}");
        let error = rms_covered(&drawn(&placed), &drawn(&straight));
        assert!(error < 0.01, "{error}");
    }
    // Visible values end at the box of the overlay, also if no value is invisible.
    for points in [&[(-1.0, [1.0; 3], 0.0), (1.0, [1.0; 3], 0.5)][..], &[(0.0, [1.0; 3], 0.5)]] {
        let cube = sampled([4; 3], DMat3::from_diagonal(DVec3::splat(3.0)), DVec3::splat(-4.5), |_| 5.0);
        let (placed, _) = Layer::scalars(&cube, &transfer(points, None)).on_lattice(&lattice, "overlay").unwrap();
        // Twelve voxels of the scan.
        let width = width(&drawn(&placed));
        // Where there is an invisible value, visible matter fades within a voxel beyond the box.
        assert!((width - 12.0).abs() <= 2.0, "{width}");
    }
}

/// The look that an overlay gets, in the words of a request.
fn look(spec: &str, volume: Volume) -> String {
    let spec = OverlaySpec::new(spec.as_ref()).unwrap();
    Overlay::new(&spec, volume.into(), &mut UsedColors::default()).unwrap().look.to_string()
}

#[test]
fn looks_follow_from_the_values() {
    let unit = |volume: Volume, unit: &str| volume.with_units(Units { length: None, value: Some(unit.to_owned()) });
    let of = |field: &dyn Fn(DVec3) -> f64| {
        sampled([24; 3], DMat3::from_diagonal(DVec3::splat(2.0)), DVec3::splat(-23.0), field)
    };
    let positive = |place: DVec3| map(place).max(0.0);
    assert!(look("z.nii", unit(of(&map), "z")).starts_with("z.nii:two-sided@2.3.."));
    assert!(look("b.nii", of(&map)).starts_with("b.nii:two-sided@"));
    assert!(look("p.nii", of(&positive)).starts_with("p.nii:hot@"));
    assert_eq!(look("p.nii@1..2", of(&positive)), "p.nii:hot@1..2");
    assert_eq!(look("p.nii:two-sided@3..", of(&map)).split("..").next(), Some("p.nii:two-sided@3"));
    assert_eq!(look("p.nii:gold@1..2", of(&map)), "p.nii:gold@1..2");
    assert_eq!(look("p.nii:map:viridis@1..2", of(&map)), "p.nii:map:viridis@1..2");
    // A scan has a colour, and labels are labels.
    let bytes = |field: &dyn Fn(usize) -> u8| {
        let samples: Vec<u8> = (0..24 * 24 * 24).map(field).collect();
        Volume::from_slice([24; 3], [1.0; 3], &samples).unwrap()
    };
    let noise = |i: usize| ((i * 7919) % 53) as u8;
    assert!(look("s.nrrd", bytes(&|i| if i % 24 > 8 { 90 + noise(i) } else { noise(i) / 4 })).starts_with("s.nrrd:#"));
    assert_eq!(look("l.nrrd", bytes(&|i| u8::from(i % 24 > 18 && i / 24 % 24 > 18))), "l.nrrd:labels");
}

#[test]
fn overlays_of_other_worlds_are_refused() {
    let scan = scan();
    let spec = OverlaySpec::new("m.nii:hot".as_ref()).unwrap();
    let refused = |volume: Volume| {
        let overlay = Overlay::new(&spec, volume.into(), &mut UsedColors::default()).unwrap();
        Overlays::new(&scan, vec![overlay]).unwrap_err().to_string()
    };
    let elsewhere = sampled([13; 3], DMat3::from_diagonal(DVec3::splat(3.0)), DVec3::splat(80.0), |p| map(p - 97.2));
    let text = refused(elsewhere);
    assert!(text.starts_with("overlay: m.nii: nothing of it lies in the volume"), "{text}");
    let plain = Volume::from_slice([13; 3], [3.0; 3], &[1_u8; 13 * 13 * 13]).unwrap();
    let refused = |volume: Volume| {
        let spec = OverlaySpec::new("m.nii:red@0..2".as_ref()).unwrap();
        let overlay = Overlay::new(&spec, volume.into(), &mut UsedColors::default()).unwrap();
        Overlays::new(&scan, vec![overlay]).unwrap_err().to_string()
    };
    let text = refused(plain);
    assert!(text.contains("m.nii: a lattice of 13 x 13 x 13, expected that of the volume, 36 x 36 x 36"), "{text}");
}
