//! Reconstruction of known signals: the figures of the harness `kernels`.

use glam::DVec3;
use voxsplat::kernel::Kernel;
use voxsplat::settings::Shading;
use voxsplat::volume::Volume;

use self::quality::{Errors, Method, Quality, Signal, field, measure, spread};

#[path = "../../../benches/kernels/quality.rs"]
mod quality;

fn splats(kernel: Kernel, sharpness: f64) -> Method {
    Method::Splats { kernel, sharpness, shading: Shading::Post }
}

#[test]
fn a_sharp_blob_beats_linear_interpolation_of_marschner_lobb() {
    let of = |method| measure(Signal::MarschnerLobb, 40, method).unwrap();
    let [linear, cubic, spline] = [Method::Trilinear, Method::CatmullRom, Method::BSpline].map(of);
    let [blurred, sharp] = [0.0, 1.0].map(|sharpness| of(splats(Kernel::KAISER_BESSEL, sharpness)));
    // Published for linear interpolation: 0.033.
    assert!((linear.field.rms - 0.0335).abs() < 5e-4, "{linear:?}");
    assert!(spline.field.rms < cubic.field.rms && cubic.field.rms < linear.field.rms);
    assert!(blurred.field.rms > 0.04 && sharp.field.rms < 0.021, "{blurred:?} {sharp:?}");
    assert!(sharp.rays.rms < 0.6 * linear.rays.rms, "{sharp:?}");
    assert!((blurred.noise - 0.395).abs() < 0.005 && (sharp.noise - 0.792).abs() < 0.01, "{blurred:?} {sharp:?}");
    assert!(sharp.blur.abs() < 0.03 && (blurred.blur - Kernel::KAISER_BESSEL.variance()).abs() < 1e-3);
    assert!((blurred.ripple - 5.4e-4).abs() < 5e-5, "{blurred:?}");
}

#[test]
fn figures_of_linear_interpolation_are_those_of_theory() {
    let Quality { ripple, blur, half_nyquist, noise, .. } = measure(Signal::Gaussians, 16, Method::Trilinear).unwrap();
    assert!(ripple < 1e-12 && (blur - 1.0 / 6.0).abs() < 1e-3, "{ripple} {blur}");
    // sinc^2(1/4), and the mean over a voxel of the sums of squared weights, (2/3)^3.
    assert!((half_nyquist - 0.8106).abs() < 1e-3, "{half_nyquist}");
    assert!((noise - (2.0_f64 / 3.0).powf(1.5)).abs() < 0.02, "{noise}");
    for signal in [Signal::MarschnerLobb, Signal::Gaussians, Signal::SheppLogan] {
        let Quality { field, rays, .. } = measure(signal, 16, Method::Trilinear).unwrap();
        assert!(0.0 < rays.rms && rays.rms < rays.max && rays.max < field.max, "{signal:?}: {field:?} {rays:?}");
    }
}

#[test]
fn white_noise_grows_as_stated() {
    let size = 24;
    let mut state = 1_u64;
    let samples: Vec<f64> = (0..size * size * size)
        .map(|_| {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (state >> 11) as f64 / (1_u64 << 53) as f64 - 0.5
        })
        .collect();
    let volume = Volume::from_slice([size; 3], [1.0; 3], &samples).unwrap();
    let kernels = [Kernel::default(), Kernel::KAISER_BESSEL];
    for method in kernels.into_iter().flat_map(|kernel| [0.0, 0.5, 1.0].map(|sharpness| splats(kernel, sharpness))) {
        let reconstruction = method.reconstruction().unwrap();
        let coefficients = method.coefficients(&volume).unwrap();
        let field: Vec<f64> = (0..20_000)
            .map(|index| {
                let at = DVec3::from_array(spread(index)) * 15.0 + 4.0;
                field(&reconstruction, &coefficients, i64::from(size), at)
            })
            .collect();
        // Uniform over a range of 1: a variance of 1/12.
        let measured = Errors::of(&field).rms * 12.0_f64.sqrt();
        let stated = reconstruction.noise();
        assert!((measured / stated - 1.0).abs() < 0.05, "{method}: {measured} {stated}");
    }
}

#[test]
fn what_cannot_be_measured_is_refused() {
    let error = measure(Signal::Gaussians, 4, Method::Trilinear).unwrap_err().to_string();
    assert!(error.starts_with("size: 4, expected 8 to 256"), "{error}");
    assert!(measure(Signal::Gaussians, 16, splats(Kernel::default(), 1.5)).is_err());
}
