//! The conventions of cameras: the sense of angles, the upward direction, and the framing of volumes.

use glam::{DAffine3, DMat3, DVec3};
use voxsplat::camera::{Camera, Hull, Projection, ProjectionKind, View};
use voxsplat::clip::Clip;
use voxsplat::volume::{Grid, Samples, Volume};

use crate::support::{PERSPECTIVE, PROJECTIONS, coordinates, look, transfer};

/// A box of 10 x 20 x 30 world units around a point that is not the origin.
fn volume() -> Volume {
    let middle = DVec3::new(3.0, -4.0, 5.0);
    // 5 x 5 x 5 voxels, whose box reaches half a voxel beyond the outermost voxels.
    let spacing = DVec3::new(2.0, 4.0, 6.0);
    let map = DAffine3::from_mat3_translation(DMat3::from_diagonal(spacing), middle - 2.0 * spacing);
    Volume::new(Grid::new([5; 3], map).unwrap(), Samples::U8(vec![0; 125])).unwrap()
}

fn seen(view: &View) -> Camera {
    look(view, &volume(), [40, 20])
}

/// Asserts the axes of a camera: right, up and forward.
fn assert_axes(view: &View, expected: [DVec3; 3]) {
    let camera = seen(view);
    for (got, expected) in [camera.right, camera.up, camera.forward].into_iter().zip(expected) {
        assert!(got.distance(expected) < 1e-12, "{view:?}: {got} is not {expected}");
    }
}

#[test]
fn the_front_looks_along_y_with_z_up() {
    assert_axes(&View::default(), [DVec3::X, DVec3::Z, DVec3::Y]);
    assert!(seen(&View::default()).target.distance(DVec3::new(3.0, -4.0, 5.0)) < 1e-12);
    let target = Some(DVec3::new(1.0, 2.0, 3.0));
    assert_eq!(seen(&View { target, ..View::default() }).target, DVec3::new(1.0, 2.0, 3.0));
}

#[test]
fn azimuth_takes_the_eye_to_the_right_and_elevation_up() {
    // An eye on the side of +x looks back along -x.
    assert_axes(&View { azimuth: 90.0, ..View::default() }, [DVec3::Y, DVec3::Z, DVec3::NEG_X]);
    assert_axes(&View { azimuth: -90.0, ..View::default() }, [DVec3::NEG_Y, DVec3::Z, DVec3::X]);
    // An eye above looks down; the top of its picture points along the former viewing direction.
    assert_axes(&View { elevation: 90.0, ..View::default() }, [DVec3::X, DVec3::Y, DVec3::NEG_Z]);
    let (sin, cos) = 30.0_f64.to_radians().sin_cos();
    let down = [DVec3::X, DVec3::new(0.0, sin, cos), DVec3::new(0.0, cos, -sin)];
    assert_axes(&View { elevation: 30.0, ..View::default() }, down);
    // Azimuth turns about up, whatever the elevation.
    let both = View { azimuth: 90.0, elevation: 30.0, ..View::default() };
    assert_axes(&both, [DVec3::Y, DVec3::new(-sin, 0.0, cos), DVec3::new(-cos, 0.0, -sin)]);
    let eye = |view: &View| {
        let camera = seen(&View { projection: PERSPECTIVE, distance: Some(100.0), ..view.clone() });
        camera.ray(0.0, 0.0).0 - camera.target
    };
    assert!(eye(&View { azimuth: 30.0, ..View::default() }).x > 49.0);
    assert!(eye(&View { elevation: 30.0, ..View::default() }).z > 49.0);
}

#[test]
fn roll_turns_the_camera_counter_clockwise() {
    // The top of the camera leans to the left, its right side rises.
    assert_axes(&View { roll: 90.0, ..View::default() }, [DVec3::Z, DVec3::NEG_X, DVec3::Y]);
    // So the picture turns clockwise: its former top is at the right.
    let camera = seen(&View { roll: 90.0, ..View::default() });
    assert!(DVec3::Z.dot(camera.right) > 0.99);
}

#[test]
fn up_may_be_any_direction() {
    // If y is up, the front looks along -z.
    assert_axes(&View { up: DVec3::Y, ..View::default() }, [DVec3::X, DVec3::Y, DVec3::NEG_Z]);
    assert_axes(&View { up: DVec3::NEG_Z, ..View::default() }, [DVec3::NEG_X, DVec3::NEG_Z, DVec3::Y]);
    assert_axes(
        &View { up: DVec3::new(0.0, 0.0, 7.0), direction: Some(DVec3::X * 3.0), ..View::default() },
        [DVec3::NEG_Y, DVec3::Z, DVec3::X],
    );
    let oblique = DVec3::new(0.3, -0.5, 0.8);
    for view in [
        View { up: oblique, azimuth: 70.0, elevation: -20.0, ..View::default() },
        View { up: oblique, direction: Some(DVec3::new(-1.0, 2.0, 0.3)), ..View::default() },
    ] {
        let Camera { right, up, forward, .. } = seen(&view);
        assert!(oblique.dot(right).abs() < 1e-12 && oblique.dot(up) > 0.0, "{view:?}");
        assert!(right.cross(up).distance(-forward) < 1e-12 && (up.length() - 1.0).abs() < 1e-12, "{view:?}");
    }
}

/// The place of a point in the image, and its depth along the ray through it.
fn projected(camera: &Camera, point: DVec3) -> (f64, f64) {
    let (origin, _) = camera.ray(0.0, 0.0);
    let d = point - origin;
    let half = match camera.projection {
        Projection::Orthographic { half_height } => half_height,
        Projection::Perspective { tan_half_fov, .. } => tan_half_fov * d.dot(camera.forward),
    };
    (d.dot(camera.right) / half, d.dot(camera.up) / half)
}

#[test]
fn a_fitted_volume_just_fits() {
    let volume = volume();
    for projection in PROJECTIONS {
        for size in [[40, 20], [20, 40], [30, 30]] {
            for (azimuth, elevation) in [(0.0, 0.0), (30.0, 20.0), (130.0, -70.0)] {
                let view = View { azimuth, elevation, roll: 10.0, projection, ..View::default() };
                let camera = look(&view, &volume, size);
                let aspect = f64::from(size[0]) / f64::from(size[1]);
                let places = volume.grid().corners(0.5).map(|corner| projected(&camera, corner));
                let most = places.iter().fold(0.0_f64, |most, (x, y)| most.max(y.abs()).max(x.abs() / aspect));
                // The margin is 2 % of the picture on either side.
                assert!((most - 0.96).abs() < 1e-9, "{view:?} {size:?}: {most}");
            }
        }
    }
}

#[test]
fn what_shows_just_fits_at_every_azimuth() {
    // A ring of voxels around z and one voxel above, in a transparent volume; voxels of 2 x 2 x 1.
    let mut samples = vec![0_u8; 41 * 41 * 20];
    let mut ring = Vec::new();
    for z in [2, 3] {
        for (y, x) in (0..41).flat_map(|y| (0..41).map(move |x| (y, x))) {
            let (dx, dy) = (f64::from(x) - 24.0, f64::from(y) - 18.0);
            if (11.5..=12.0).contains(&dx.hypot(dy)) || (z == 3 && (x, y) == (24, 18)) {
                let z = if (x, y) == (24, 18) { 15 } else { z };
                samples[(z * 41 + y as usize) * 41 + x as usize] = 9;
                ring.push(DVec3::new(2.0 * f64::from(x), 2.0 * f64::from(y), z as f64));
            }
        }
    }
    let volume = Volume::from_slice([41, 41, 20], [2.0, 2.0, 1.0], &samples).unwrap();
    let transfer = transfer(&[(0.0, [1.0; 3], 0.0), (9.0, [1.0; 3], 0.5)], None);
    let around = Hull::of_visible(&volume, &transfer, &Clip::default()).unwrap();
    for projection in PROJECTIONS {
        for size in [[40, 20], [20, 40], [30, 30]] {
            let aspect = f64::from(size[0]) / f64::from(size[1]);
            for (elevation, roll) in [(0.0, 0.0), (35.0, 0.0), (-70.0, 20.0)] {
                let cameras = [0.0, 40.0, 200.0].map(|azimuth| {
                    let around = around.clone();
                    let view = View { azimuth, elevation, roll, around, margin: 0.1, projection, ..View::default() };
                    look(&view, &volume, size)
                });
                for camera in cameras {
                    let aside = (camera.target - DVec3::new(48.0, 36.0, 8.5)).truncate();
                    assert!(aside.length() < 0.3, "{}", camera.target);
                    assert!(camera.target.distance(cameras[0].target) < 1e-9);
                    let [a, b] = [camera, cameras[0]].map(|camera| match camera.projection {
                        Projection::Orthographic { half_height } => half_height,
                        Projection::Perspective { distance, .. } => distance,
                    });
                    assert!((a / b - 1.0).abs() < 1e-12, "{a} {b}");
                    // All voxels fit, and touch the margin up to the reach of a kernel: 2 of a height of 6.5 or more.
                    let places = ring.iter().map(|&point| projected(&camera, point));
                    let most = places.fold(0.0_f64, |most, (x, y)| most.max(y.abs()).max(x.abs() / aspect));
                    assert!((0.6..0.8).contains(&most), "{projection:?} {size:?} {elevation} {roll}: {most}");
                }
            }
        }
    }
}

#[test]
fn height_distance_and_zoom_are_what_they_say() {
    let half_height = |view: &View| match seen(view).projection {
        Projection::Orthographic { half_height } => half_height,
        Projection::Perspective { .. } => panic!("{view:?}"),
    };
    let stated = View { view_height: Some(24.0), ..View::default() };
    assert!((half_height(&stated) - 12.0).abs() < 1e-12);
    assert!((half_height(&View { zoom: 3.0, ..stated }) - 4.0).abs() < 1e-12);

    let eye = |view: View| match seen(&view).projection {
        Projection::Perspective { tan_half_fov, distance } => (tan_half_fov, distance),
        Projection::Orthographic { .. } => panic!("{view:?}"),
    };
    let perspective = View { projection: ProjectionKind::Perspective { fov: 90.0 }, ..View::default() };
    let close = |(a, b): (f64, f64), (c, d): (f64, f64)| (a - c).abs() < 1e-12 && (b - d).abs() < 1e-12;
    // The field of view determines the distance from which a height is seen.
    assert!(close(eye(View { view_height: Some(24.0), ..perspective.clone() }), (1.0, 12.0)));
    assert!(close(eye(View { distance: Some(50.0), ..perspective.clone() }), (1.0, 50.0)));
    // A height at a distance determines the field of view, and zoom narrows it without moving the eye.
    let both = View { view_height: Some(24.0), distance: Some(50.0), ..perspective };
    assert!(close(eye(both.clone()), (0.24, 50.0)));
    assert!(close(eye(View { zoom: 2.0, ..both }), (0.12, 50.0)));
}

#[test]
fn rays_go_through_the_middles_of_pixels_from_the_top_left() {
    let camera = seen(&View { view_height: Some(24.0), ..View::default() });
    let (sx, sy) = coordinates(0, &camera);
    assert!((sx + 1.95).abs() < 1e-12 && (sy - 0.95).abs() < 1e-12, "{sx} {sy}");
    let (sx, sy) = coordinates(40 * 19 + 39, &camera);
    assert!((sx - 1.95).abs() < 1e-12 && (sy + 0.95).abs() < 1e-12, "{sx} {sy}");

    let (origin, direction) = camera.ray(0.5, -1.0);
    assert!(origin.distance(camera.target + DVec3::new(6.0, 0.0, -12.0)) < 1e-12);
    assert!(direction.distance(DVec3::Y) < 1e-12);

    let projection = ProjectionKind::Perspective { fov: 60.0 };
    let camera = seen(&View { projection, distance: Some(50.0), ..View::default() });
    let (origin, direction) = camera.ray(0.0, 1.0);
    assert!(origin.distance(camera.target - 50.0 * DVec3::Y) < 1e-12);
    // The height determines the field of view.
    let half = direction.angle_between(DVec3::Y).to_degrees();
    assert!((half - 30.0).abs() < 1e-9 && direction.z > 0.0, "{half}");
}

#[test]
fn views_of_nothing_are_refused() {
    let volume = volume();
    let front = View::default();
    let perspective = |fov| View { projection: ProjectionKind::Perspective { fov }, ..View::default() };
    let cases = [
        (View { azimuth: f64::NAN, ..front.clone() }, "azimuth is NaN"),
        (View { roll: f64::INFINITY, ..front.clone() }, "roll is inf"),
        (View { zoom: 0.0, ..front.clone() }, "zoom is 0"),
        (View { distance: Some(-1.0), ..front.clone() }, "distance is -1"),
        (View { view_height: Some(f64::NAN), ..front.clone() }, "view-height is NaN"),
        (View { up: DVec3::ZERO, ..front.clone() }, "up is"),
        (View { direction: Some(DVec3::NAN), ..front.clone() }, "direction is"),
        (View { direction: Some(DVec3::NEG_Z), ..front.clone() }, "parallel to up"),
        (View { target: Some(DVec3::INFINITY), ..front }, "target is"),
        (perspective(0.0), "fov is 0"),
        (perspective(180.0), "fov is 180"),
    ];
    for (view, reason) in cases {
        let error = Camera::new(&view, volume.grid(), [4, 4]).unwrap_err().to_string();
        assert!(error.contains(reason), "{error}");
    }
}
