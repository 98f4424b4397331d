//! Sections show the field at their places, in the plane of any view and through any lattice; planes in pictures have
//! the depths of the plane and the colours of its section.

use glam::{DAffine3, DMat3, DVec3};
use voxsplat::camera::{Camera, View};
use voxsplat::image::{Ground, Image, SectionPlane, section};
use voxsplat::layers::{Labels, Layer, Layers};
use voxsplat::solids::Solids;
use voxsplat::transfer::{ControlPoint, TransferFunction};
use voxsplat::volume::{Grid, Volume};

use crate::support::PROJECTIONS;

/// A lattice with a tilt, of long voxels, far from the origin.
fn grid() -> Grid {
    let axes = DMat3::from_cols(DVec3::X, DVec3::new(0.0, 1.2, 0.3), DVec3::new(0.1, -0.4, 2.5));
    Grid::new([30, 26, 18], DAffine3::from_mat3_translation(axes, DVec3::new(-400.0, 70.0, 1000.0))).unwrap()
}

/// A function of the world on the lattice.
fn of_world(value: impl Fn(DVec3) -> f32) -> Volume {
    let grid = grid();
    let [nx, ny, nz] = grid.dims();
    let places = (0..nz).flat_map(|z| (0..ny).flat_map(move |y| (0..nx).map(move |x| [x, y, z])));
    let place = |at: [u32; 3]| grid.to_world().transform_point3(DVec3::from_array(at.map(f64::from)));
    let samples: Vec<f32> = places.map(|at| value(place(at))).collect();
    Volume::from_slice(grid.dims(), [1.0; 3], &samples).unwrap().with_grid(grid).unwrap()
}

fn linear(place: DVec3) -> f64 {
    (place - grid().center()).dot(DVec3::new(0.5, -0.25, 1.0))
}

/// A transfer function that shows nothing.
fn clear() -> TransferFunction {
    TransferFunction::new(vec![ControlPoint { value: 0.0, color: [0.0; 3], opacity: 0.0 }], None).unwrap()
}

/// Whether a place is `margin` voxels inside the box of the voxels.
fn is_inside(place: DVec3, margin: f64) -> bool {
    let at = grid().to_lattice().transform_point3(place);
    let end = DVec3::from_array(grid().dims().map(f64::from)) - 0.5;
    at.cmpge(DVec3::splat(margin - 0.5)).all() && at.cmple(end - margin).all()
}

#[test]
fn a_section_has_the_value_of_each_place() {
    let layers = Layers::of_volume(&of_world(|place| linear(place) as f32), &clear());
    let range = [-30.0, 30.0];
    for (forward, up, pixel) in [
        (DVec3::Z, DVec3::NEG_Y, 0.7),
        (DVec3::new(1.0, 2.0, -0.5), DVec3::Z, 0.3),
        // Pixels that span samples have their mean, which is the value in the middle.
        (DVec3::NEG_X, DVec3::Z, 2.6),
    ] {
        let point = grid().center() + DVec3::new(2.0, -3.0, 4.0);
        let plane = SectionPlane { name: String::new(), point, forward, up };
        let camera = plane.camera(&grid(), pixel, [96, 80]).unwrap();
        let image = section(&layers, &camera, Ground::Grey(range)).unwrap();
        let mut inside = 0;
        for (index, drawn) in (0_u32..).zip(image.pixels()) {
            let (sx, sy) = camera.image_coordinates([index % 96, index / 96]);
            let place = camera.ray(sx, sy).0;
            assert!((place - point).dot(forward).abs() < 1e-9 * place.length());
            if is_inside(place, 1e-6) != is_inside(place, -1e-6) {
                continue;
            }
            assert_eq!(drawn[3], f32::from(u8::from(is_inside(place, 0.0))));
            // Splines are bent at the faces of the lattice, where samples are mirrored.
            if is_inside(place, 5.0) {
                let expected = ((linear(place) - range[0]) / (range[1] - range[0])).clamp(0.0, 1.0);
                assert!((f64::from(drawn[0]) - expected).abs() < 2e-3, "{place}: {drawn:?} {expected}");
                inside += 1;
            }
        }
        assert!(inside > 40, "{forward}: {inside}");
    }
}

#[test]
fn labels_of_a_section_are_whole_and_visible_matter_tints_its_grey() {
    let half = of_world(|place| if place.x > grid().center().x { 2.0 } else { 1.0 });
    let labels = Labels::default();
    let base = Layers::of_volume(&of_world(|place| linear(place) as f32), &clear());
    let layers = base.clone().with(Layer::labels(&half, &labels).unwrap()).unwrap();
    let plane = SectionPlane { name: String::new(), point: grid().center(), forward: DVec3::Z, up: DVec3::NEG_Y };
    let camera = plane.camera(&grid(), 0.37, [64, 48]).unwrap();
    // Of labels alone there are as many colours as labels.
    let own = section(&Layers::new(Layer::labels(&half, &labels).unwrap()), &camera, Ground::Colors).unwrap();
    let mut colors: Vec<[u32; 4]> = own.pixels().iter().map(|pixel| pixel.map(f32::to_bits)).collect();
    colors.sort_unstable();
    colors.dedup();
    assert_eq!(colors.len(), 2);
    let [grey, over] = [&base, &layers].map(|layers| section(layers, &camera, Ground::Grey([-20.0, 20.0])).unwrap());
    assert!(grey.pixels().iter().all(|pixel| pixel[0] == pixel[1]));
    assert!(over.pixels().iter().any(|pixel| pixel[0] != pixel[1]));
    // Voxels without a value are clear.
    let gap = of_world(|place| if place.x > grid().center().x { f32::NAN } else { 1.0 });
    let holed = section(&Layers::of_volume(&gap, &clear()), &camera, Ground::Grey([-20.0, 20.0])).unwrap();
    let clears = |image: &Image| image.pixels().iter().filter(|pixel| pixel[3] == 0.0).count();
    assert!(clears(&holed) > clears(&grey) + 500, "{} {}", clears(&holed), clears(&grey));
    // Opaque matter has the hue of its colour, and the grey of its value.
    let red = ControlPoint { value: 0.0, color: [0.5, 0.0, 0.0], opacity: 1.0 };
    let red = TransferFunction::new(vec![red], None).unwrap();
    let matter = Layers::of_volume(&of_world(|place| linear(place) as f32), &red);
    let tinted = section(&matter, &camera, Ground::Grey([-20.0, 20.0])).unwrap();
    assert!(tinted.pixels().iter().zip(grey.pixels()).all(|(a, b)| *a == [b[0], 0.0, 0.0, b[3]]));
}

#[test]
fn a_plane_in_a_picture_has_its_depths_and_its_section() {
    let volume = of_world(|place| linear(place) as f32);
    let layers = Layers::of_volume(&volume, &clear());
    let point = grid().center() + DVec3::new(1.0, 2.0, 0.0);
    let plane = SectionPlane { name: String::new(), point, forward: DVec3::new(0.6, 1.0, -0.3), up: DVec3::Z };
    let ground = Ground::Grey([-50.0, 30.0]);
    for projection in PROJECTIONS {
        let view = View { azimuth: 20.0, elevation: 25.0, projection, ..View::default() };
        let camera = Camera::new(&view, &grid(), [90, 70]).unwrap();
        let solids = Solids::of_planes(std::slice::from_ref(&plane), &layers, ground, &camera).unwrap().unwrap();
        let image = solids.image.unwrap();
        let mut seen = 0;
        for (index, drawn) in (0_u32..).zip(image.pixels()) {
            let pixel = [index % 90, index / 90];
            let (sx, sy) = camera.image_coordinates(pixel);
            let (origin, direction) = camera.ray(sx, sy);
            let place = origin + direction * ((point - origin).dot(plane.forward) / direction.dot(plane.forward));
            let depth = solids.depths.depths()[index as usize];
            if is_inside(place, 5.0) && drawn[3] == 1.0 {
                let expected = (place - camera.eye().unwrap_or(camera.target)).dot(camera.forward);
                assert!((f64::from(depth) - expected).abs() < 1e-3, "{depth} {expected}");
                let value = (linear(place) + 50.0) / 80.0;
                assert!((f64::from(drawn[0]) - value.clamp(0.0, 1.0)).abs() < 0.01, "{drawn:?} {value}");
                seen += 1;
            } else if !is_inside(place, -2.0) {
                assert!(depth.is_infinite() && drawn[3] == 0.0);
            }
        }
        assert!(seen > 200, "{seen}");
    }
    assert!(
        Solids::of_planes(&[], &layers, ground, &Camera::new(&View::default(), &grid(), [8; 2]).unwrap())
            .unwrap()
            .is_none()
    );
}
