//! Each algorithm against the f64 reference of its model, and against theory.

use glam::DVec3;
use voxsplat::camera::{ProjectionKind, View};
use voxsplat::kernel::{Kernel, Normalization};
use voxsplat::settings::{Accumulation, Interslice, Model, Settings, Shading, Sheets};
use voxsplat::transfer::Classification;
use voxsplat::volume::{Grid, Samples, Volume};

use crate::support::{
    PERSPECTIVE, PROJECTIONS, by_quads, camera, coordinates, demo, draw, draw_on, errors, exact_quads, look, prepare,
    render, renderer, rms_covered, thick, transfer, two_lights, with_quads,
};
use crate::truth::truth;

#[test]
fn xray_is_the_exact_line_integral() {
    for name in ["shepp-logan", "marschner-lobb"] {
        let (volume, transfer) = demo(name, 32);
        for projection in PROJECTIONS {
            let settings = Settings { model: Model::Xray, ..exact_quads() };
            let camera = camera(33.0, projection, &volume, 40);
            let got = render(&volume, &transfer, &camera, &settings);
            let (color, alpha) = errors(&got, &truth(&volume, &transfer, &camera, &settings));
            assert!(alpha < 2e-5 && color < 2e-5, "{name} {projection:?}: alpha {alpha:e}, colour {color:e}");
        }
    }
}

#[test]
fn xray_of_a_gaussian_mixture_is_its_analytic_projection() {
    // A sampled mixture of wide Gaussians, splatted with a Gaussian kernel: the reconstruction is the mixture convolved
    // with the kernel, and so is its projection. Opacity per unit is small enough for the transfer function, linear in
    // opacity, to be linear in extinction.
    let size = 48_u32;
    let blobs = [(DVec3::new(-5.0, 2.0, 1.0), 4.0_f64, 0.7), (DVec3::new(4.0, -3.0, -4.0), 4.3, 0.3)];
    let middle = f64::from(size - 1) / 2.0;
    let value =
        |p: DVec3| -> f64 { blobs.iter().map(|(c, s, w)| w * (-p.distance_squared(*c) / (2.0 * s * s)).exp()).sum() };
    let at = |i: u32| f64::from(i) - middle;
    let samples = (0..size)
        .flat_map(|z| (0..size).flat_map(move |y| (0..size).map(move |x| DVec3::new(at(x), at(y), at(z)))))
        .map(|p| value(p) as f32)
        .collect();
    let grid = Grid::new([size; 3], glam::DAffine3::from_translation(DVec3::splat(-middle))).unwrap();
    let volume = Volume::new(grid, Samples::F32(samples)).unwrap();
    let opacity = 1e-6;
    let transfer = transfer(&[(0.0, [1.0; 3], 0.0), (1.0, [1.0; 3], opacity)], Some(1.0));
    let transfer = transfer.with_classification(Classification::Point);
    let kernel = Kernel::Gaussian { sigma: 1.0, radius: 5.0 };
    let settings = Settings { model: Model::Xray, kernel, antialiasing: false, ..exact_quads() };
    let camera = camera(33.0, ProjectionKind::Orthographic, &volume, 64);
    let got = render(&volume, &transfer, &camera, &settings);
    let peak = blobs.iter().map(|(_, s, w)| w * s * (2.0 * std::f64::consts::PI).sqrt()).sum::<f64>() * opacity;
    let mut worst = 0.0_f64;
    for (index, pixel) in got.pixels().iter().enumerate() {
        let (sx, sy) = coordinates(index, &camera);
        let (origin, direction) = camera.ray(sx, sy);
        let projected: f64 = blobs
            .iter()
            .map(|(c, s, w)| {
                // Convolution adds variances and keeps the integral.
                let wide2 = s * s + 1.0;
                let r2 = (origin - *c).cross(direction).length_squared();
                w * s.powi(3) / wide2 * (2.0 * std::f64::consts::PI).sqrt() * (-r2 / (2.0 * wide2)).exp()
            })
            .sum();
        worst = worst.max((f64::from(pixel[3]) - projected * opacity).abs() / peak);
    }
    // The volume truncates the mixture at 4.5 sigma or more; opacities are f32.
    assert!(worst < 2e-4, "{worst:e} of the peak");
}

#[test]
fn lit_voxels_follow_the_reference() {
    let (volume, transfer) = demo("marschner-lobb", 32);
    for projection in PROJECTIONS {
        let settings = thick(&Settings { lighting: two_lights(), ..exact_quads() }, 0.5);
        let camera = camera(33.0, projection, &volume, 40);
        let expected = truth(&volume, &transfer, &camera, &settings);
        let got = render(&volume, &transfer, &camera, &settings);
        let (color, alpha) = errors(&got, &expected);
        assert!(alpha < 5e-5 && color < 1.5e-3, "{projection:?}: alpha {alpha:e}, colour {color:e}");
        // Light changes the picture considerably.
        let unlit = render(&volume, &transfer, &camera, &Settings { lighting: None, ..settings });
        assert!(errors(&unlit, &got).0 > 0.05);
    }
}

#[test]
fn lit_voxels_of_sheared_grids_follow_the_reference() {
    let (volume, transfer) = demo("shell", 32);
    let matrix = glam::DMat3::from_cols(DVec3::X, DVec3::new(0.3, 1.0, 0.1), DVec3::new(0.2, -0.4, 2.5));
    let grid = Grid::new([32; 3], glam::DAffine3::from_mat3(matrix)).unwrap();
    let volume = volume.with_grid(grid).unwrap();
    for shading in [Shading::Pre, Shading::Post] {
        let settings = thick(&Settings { lighting: two_lights(), shading, ..exact_quads() }, 0.25);
        let camera = camera(33.0, ProjectionKind::Orthographic, &volume, 40);
        let expected = truth(&volume, &transfer, &camera, &settings);
        let error = rms_covered(&render(&volume, &transfer, &camera, &settings), &expected);
        let allowed = if shading == Shading::Pre { 1e-3 } else { 2e-3 };
        assert!(error < allowed, "{shading:?}: {error:e}");
    }
}

#[test]
fn axis_aligned_sheets_have_the_alpha_of_image_aligned_ones() {
    // Whole footprints add up to the same optical depth in any sheet.
    let (volume, transfer) = demo("marschner-lobb", 32);
    for projection in PROJECTIONS {
        let settings = with_quads(&exact_quads(), |q| q.sheets = Sheets::Axis);
        let camera = camera(33.0, projection, &volume, 40);
        let expected = truth(&volume, &transfer, &camera, &settings);
        let (color, alpha) = errors(&render(&volume, &transfer, &camera, &settings), &expected);
        assert!(alpha < 5e-5, "{projection:?}: alpha errs by {alpha:e}");
        // A whole footprint lies in one sheet, at most two voxels too near or too far: the measured error is 1.8e-2.
        assert!(color < 0.03, "{projection:?}: colour errs by {color:e}");
    }
}

#[test]
fn colour_converges_with_optical_depth_and_not_with_added_opacity() {
    let (volume, transfer) = demo("marschner-lobb", 32);
    let camera = camera(33.0, ProjectionKind::Orthographic, &volume, 40);
    let expected = truth(&volume, &transfer, &camera, &exact_quads());
    let error = |accumulation, sheet_thickness| {
        let settings = with_quads(&thick(&exact_quads(), sheet_thickness), |q| q.accumulation = accumulation);
        errors(&render(&volume, &transfer, &camera, &settings), &expected).0
    };
    let [thick, thin] = [1.0, 0.5].map(|d| error(Accumulation::OpticalDepth, d));
    assert!((3.0..5.0).contains(&(thick / thin)), "{thick:e} / {thin:e}");
    let [thick, thin] = [1.0, 0.5].map(|d| error(Accumulation::Additive, d));
    assert!(thin > 0.8 * thick && thin > 0.005, "{thick:e} / {thin:e}");
}

#[test]
#[ignore = "slow: 6 post-shaded truths"]
fn post_shading_follows_the_reference() {
    for (name, size) in [("marschner-lobb", 24), ("shell", 32), ("vessels", 32)] {
        let (volume, transfer) = demo(name, size);
        for projection in PROJECTIONS {
            let settings = Settings { shading: Shading::Post, ..exact_quads() };
            let camera = camera(33.0, projection, &volume, 40);
            let expected = truth(&volume, &transfer, &camera, &settings);
            let [thick, thin] = [1.0, 0.25].map(|sheet_thickness| {
                rms_covered(&render(&volume, &transfer, &camera, &thick(&settings, sheet_thickness)), &expected)
            });
            assert!(thick < 0.02 && thin < 0.004, "{name} {projection:?}: {thick:e}, {thin:e}");
        }
    }
}

#[test]
fn the_parabola_is_worth_more_than_half_the_thickness() {
    let (volume, transfer) = demo("shell", 40);
    let settings = Settings { shading: Shading::Post, ..exact_quads() };
    let camera = camera(30.0, ProjectionKind::Orthographic, &volume, 48);
    let expected = truth(&volume, &transfer, &camera, &settings);
    let error = |interslice, sheet_thickness| {
        let settings = Settings { interslice, ..thick(&settings, sheet_thickness) };
        rms_covered(&render(&volume, &transfer, &camera, &settings), &expected)
    };
    let (parabola, half) = (error(Interslice::Parabola, 1.0), error(Interslice::Mean, 0.5));
    assert!(parabola <= half, "{parabola:e} > {half:e}");
    assert!(error(Interslice::Mean, 1.0) > 3.0 * parabola);
}

#[test]
fn post_shaded_light_follows_the_reference() {
    let (volume, transfer) = demo("shell", 32);
    for projection in PROJECTIONS {
        let settings = thick(&Settings { shading: Shading::Post, lighting: two_lights(), ..exact_quads() }, 0.5);
        let camera = camera(33.0, projection, &volume, 48);
        let expected = truth(&volume, &transfer, &camera, &settings);
        let got = render(&volume, &transfer, &camera, &settings);
        let error = rms_covered(&got, &expected);
        assert!(error < 6e-3, "{projection:?}: {error:e}");
        let unlit = rms_covered(&render(&volume, &transfer, &camera, &Settings { lighting: None, ..settings }), &got);
        assert!(unlit > 3.0 * error, "{projection:?}: {unlit:e} {error:e}");
    }
}

#[test]
fn maximum_intensity_follows_the_reference() {
    for name in ["shepp-logan", "vessels"] {
        let (volume, transfer) = demo(name, 32);
        for projection in PROJECTIONS {
            // A kernel without jumps: means over a sheet do not resolve the field on either side of a jump.
            let kernel = Kernel::KAISER_BESSEL;
            let settings = thick(&Settings { model: Model::Mip, kernel, ..exact_quads() }, 0.25);
            let camera = camera(33.0, projection, &volume, 40);
            let expected = truth(&volume, &transfer, &camera, &settings);
            let error = rms_covered(&render(&volume, &transfer, &camera, &settings), &expected);
            assert!(error < 0.012, "{name} {projection:?}: {error:e}");
        }
    }
}

#[test]
fn a_camera_inside_sees_scalars_in_front_of_it() {
    let (volume, transfer) = demo("marschner-lobb", 24);
    for distance in [0.1, 9.0] {
        let view = View { azimuth: 20.0, projection: PERSPECTIVE, distance: Some(distance), ..View::default() };
        let settings = thick(&Settings { shading: Shading::Post, ..exact_quads() }, 0.5);
        let camera = look(&view, &volume, [24; 2]);
        let expected = truth(&volume, &transfer, &camera, &settings);
        let error = rms_covered(&render(&volume, &transfer, &camera, &settings), &expected);
        assert!(error < 5e-3, "{distance}: {error:e}");
    }
}

#[test]
fn a_uniform_box_has_no_rim() {
    // Post-shaded, a box of one value is uniform up to its faces.
    let grid = Grid::axis_parallel([20, 16, 12], [1.0; 3]).unwrap();
    let volume = Volume::new(grid, Samples::U8(vec![100; 20 * 16 * 12])).unwrap();
    let white = [1.0; 3];
    let transfer = transfer(&[(90.0, white, 0.0), (95.0, white, 0.05), (110.0, white, 0.05)], Some(1.0));
    for thickness in [0.5, 1.0, 4.0] {
        let settings = Settings { shading: Shading::Post, kernel: Kernel::KAISER_BESSEL, ..exact_quads() };
        let settings = thick(&settings, thickness);
        let view = View { view_height: Some(24.0), ..View::default() };
        let camera = look(&view, &volume, [60; 2]);
        let image = render(&volume, &transfer, &camera, &settings);
        // Straight through 16 voxels of depth.
        let expected = 1.0 - (1.0_f64 - 0.05).powi(16);
        for (index, pixel) in image.pixels().iter().enumerate() {
            let (sx, sy) = coordinates(index, &camera);
            let (x, z) = ((sx * 12.0).abs(), (sy * 12.0).abs());
            let inside = if x < 10.0 && z < 6.0 { expected } else { 0.0 };
            assert!((f64::from(pixel[3]) - inside).abs() < 1e-4, "{thickness}: {x} {z}: {}", pixel[3]);
        }
    }
}

#[test]
#[ignore = "slow: 16 lit pictures"]
fn termination_changes_no_channel_by_more_than_it_says() {
    let (volume, _) = demo("marschner-lobb", 40);
    let points = [(0.2, [0.1, 0.3, 1.0], 0.0), (0.4, [1.0, 0.8, 0.1], 0.6), (1.0, [1.0; 3], 0.9)];
    let transfer = transfer(&points, Some(1.0));
    for shading in [Shading::Pre, Shading::Post] {
        for projection in PROJECTIONS {
            let exact = Settings { shading, lighting: two_lights(), ..exact_quads() };
            let camera = camera(33.0, projection, &volume, 64);
            let scene = prepare(&volume, &transfer, &exact);
            let whole = draw(&scene, &camera, &exact);
            assert_eq!(by_quads(&whole).quads_terminated, 0);
            for termination in [1e-4, 1e-2, 0.1] {
                let settings = Settings { termination, ..exact.clone() };
                let got = draw(&scene, &camera, &settings);
                let stats = by_quads(&got);
                assert_eq!(stats.quads, by_quads(&whole).quads);
                assert!(10 * stats.quads_terminated > stats.quads, "{}", stats.quads_terminated);
                let (color, alpha) = errors(&got.image, &whole.image);
                let worst = color.max(alpha);
                // The bound, and the rounding of sums in another order.
                assert!(worst <= termination + 2e-6, "{shading:?} {projection:?} {termination}: {worst:e}");
            }
        }
    }
}

#[test]
#[ignore = "slow: two million splats"]
fn bricks_behind_opaque_pixels_are_hidden_as_a_whole() {
    let (volume, _) = demo("sphere", 192);
    let transfer = transfer(&[(0.2, [0.1, 0.3, 1.0], 0.0), (0.5, [1.0; 3], 0.99)], None);
    for projection in PROJECTIONS {
        let exact = thick(&Settings { antialiasing: false, ..exact_quads() }, 4.0);
        let camera = camera(33.0, projection, &volume, 80);
        let scene = prepare(&volume, &transfer, &exact);
        let whole = draw(&scene, &camera, &exact);
        let got = draw(&scene, &camera, &Settings { termination: 1e-2, ..exact });
        let ((color, alpha), stats) = (errors(&got.image, &whole.image), by_quads(&got));
        assert!(color.max(alpha) <= 1e-2 + 2e-6, "{projection:?}: {color:e} {alpha:e}");
        assert_eq!(by_quads(&whole).quads_terminated, 0);
        assert!(stats.quads_terminated * 2 > stats.quads, "{} of {}", stats.quads_terminated, stats.quads);
    }
}

#[test]
#[ignore = "slow: 12 pictures of grown kernels"]
fn minification_keeps_energy() {
    // So thin that alpha is optical depth: its sum times the area of a pixel is the mass of the volume. So far
    // from the faces, at which scalars end, that grown kernels stay inside.
    let at = |i: u32| f64::from(i) - 15.5;
    let samples = (0..32)
        .flat_map(|z| (0..32).flat_map(move |y| (0..32).map(move |x| DVec3::new(at(x), at(y), at(z)))))
        .map(|p| (-p.length_squared() / 20.0).exp() as f32)
        .collect();
    let volume = Volume::new(Grid::axis_parallel([32; 3], [1.0; 3]).unwrap(), Samples::F32(samples)).unwrap();
    let transfer = transfer(&[(0.0, [1.0; 3], 0.0), (1.0, [1.0; 3], 1e-4)], Some(1.0));
    for shading in [Shading::Pre, Shading::Post] {
        // Perspective magnifies the near half of a large kernel more than it shrinks the far half, by 3 (s sigma /
        // z)^2, which is little for such a distant eye.
        for projection in [ProjectionKind::Orthographic, ProjectionKind::Perspective { fov: 15.0 }] {
            let energy = |size: u32| {
                let settings = Settings { shading, ..exact_quads() };
                let view = View { azimuth: 33.0, projection, ..View::default() };
                let camera = look(&view, &volume, [size; 2]);
                let image = render(&volume, &transfer, &camera, &settings);
                image.pixels().iter().map(|p| f64::from(p[3])).sum::<f64>() / f64::from(size * size)
            };
            let large = energy(72);
            for size in [36, 16] {
                let ratio = energy(size) / large;
                assert!((ratio - 1.0).abs() < 0.01, "{shading:?} {projection:?} {size}: {ratio}");
            }
        }
    }
}

#[test]
fn axis_aligned_sheets_pop_and_image_aligned_ones_do_not() {
    let (volume, transfer) = demo("marschner-lobb", 24);
    // The largest change of a channel of any pixel across the angle at which the axis switches, against the true
    // change.
    let views = [44.99, 45.01].map(|azimuth| View { azimuth, ..View::default() });
    let cameras = views.map(|view| look(&view, &volume, [48; 2]));
    let expected = cameras.map(|camera| truth(&volume, &transfer, &camera, &exact_quads()));
    let excess = |sheets, accumulation| {
        let settings = with_quads(&exact_quads(), |q| (q.sheets, q.accumulation) = (sheets, accumulation));
        let got = cameras.map(|camera| render(&volume, &transfer, &camera, &settings));
        let changes = got[0].pixels().iter().zip(got[1].pixels()).flat_map(|(a, b)| (0..4).map(move |c| b[c] - a[c]));
        let true_changes =
            expected[0].pixels().iter().zip(expected[1].pixels()).flat_map(|(a, b)| (0..4).map(move |c| b[c] - a[c]));
        changes.zip(true_changes).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max)
    };
    let steady = excess(Sheets::Image, Accumulation::OpticalDepth);
    assert!(steady < 1e-3, "{steady:e}");
    for accumulation in [Accumulation::OpticalDepth, Accumulation::Additive] {
        let pop = excess(Sheets::Axis, accumulation);
        assert!(pop > 5.0 * steady, "{accumulation}: {pop:e} {steady:e}");
    }
}

#[test]
fn a_scene_of_another_kind_is_refused() {
    let (volume, transfer) = demo("sphere", 8);
    let pre = exact_quads();
    let camera = camera(0.0, ProjectionKind::Orthographic, &volume, 8);
    let settings = [
        pre.clone(),
        Settings { shading: Shading::Post, ..pre.clone() },
        Settings { model: Model::Mip, ..pre.clone() },
        Settings { lighting: two_lights(), ..pre },
    ];
    for (i, prepared) in settings.iter().enumerate() {
        let scene = prepare(&volume, &transfer, prepared);
        for (j, rendered) in settings.iter().enumerate() {
            let result = draw_on(&renderer(), &scene, &camera, rendered);
            // A lit scene also serves unlit pictures.
            let fits = i == j || (i, j) == (3, 0);
            assert_eq!(result.is_ok(), fits, "{i} {j}");
            if let Err(e) = result {
                assert!(e.to_string().contains("prepared"), "{e}");
            }
        }
    }
}

#[test]
fn footprint_tables_are_as_accurate_as_asked() {
    let (volume, transfer) = demo("vessels", 16);
    let camera = camera(0.0, ProjectionKind::Orthographic, &volume, 16);
    let drawn = [1e-2, 1e-6].map(|table_error| {
        let settings = with_quads(&exact_quads(), |q| q.table_error = Some(table_error));
        let rendered = draw(&prepare(&volume, &transfer, &settings), &camera, &settings);
        assert!(rendered.stats.footprint_error <= table_error, "{:e}", rendered.stats.footprint_error);
        let error = errors(&rendered.image, &truth(&volume, &transfer, &camera, &settings)).1;
        (by_quads(&rendered).footprint_table, error)
    });
    let [([rows, terms], _), ([fine_rows, fine_terms], error)] = drawn;
    assert!(rows * terms < fine_rows * fine_terms && error < 1e-3, "{drawn:?}");
}

#[test]
fn peak_normalisation_scales_scalars() {
    // Twelve times denser sums, through the same transfer function.
    let (volume, transfer) = demo("sphere", 16);
    let settings = Settings { shading: Shading::Post, normalization: Normalization::Peak, ..exact_quads() };
    let settings = thick(&settings, 0.25);
    let camera = camera(20.0, ProjectionKind::Orthographic, &volume, 24);
    let expected = truth(&volume, &transfer, &camera, &settings);
    let error = rms_covered(&render(&volume, &transfer, &camera, &settings), &expected);
    assert!(error < 0.01, "{error:e}");
}

#[test]
fn maximum_intensity_counts_as_post_shaded() {
    let (volume, transfer) = demo("sphere", 8);
    let settings = Settings { model: Model::Mip, ..exact_quads() };
    let camera = camera(20.0, ProjectionKind::Orthographic, &volume, 8);
    let scene = prepare(&volume, &transfer, &settings);
    assert_eq!(draw(&scene, &camera, &settings).stats.shading, Shading::Post);
}
