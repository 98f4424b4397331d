//! The quality of kernels, and of the usual interpolations, in the reconstruction of a known signal.
//!
//! ```text
//! cargo bench --bench kernels -- [--signal marschner-lobb|gaussians|shepp-logan] [--size N] [--kernel gaussian|blob]
//!     [--sharpness S] [--write]
//! ```
//!
//! Errors of the field are at points at least a voxel inside the outermost samples; errors of rays are errors of its
//! mean along rays through that box. Ripple is the largest minus the least value of a field of samples that are all 1.
//! Blur is a variance along an axis, voxels^2. Half Nyquist is the remaining share of waves four samples long. Noise
//! is the noise of the field over the noise of the samples.

#![allow(clippy::disallowed_methods, reason = "measurements allow more than the last bit")]
#![allow(clippy::print_stdout, reason = "printing its table is what this program is for")]

#[path = "../common/mod.rs"]
mod common;
mod quality;

use common::{Arguments, Outcome, Report};
use quality::{Method, Quality, Signal, measure};
use voxsplat::host::HostRenderer;
use voxsplat::kernel::Kernel;
use voxsplat::settings::Shading;

fn main() -> Outcome {
    let mut arguments = Arguments::of_process();
    let size: u32 = arguments.option("--size")?.unwrap_or(40);
    let signal = match arguments.option::<String>("--signal")?.as_deref() {
        None | Some("marschner-lobb") => Signal::MarschnerLobb,
        Some("gaussians") => Signal::Gaussians,
        Some("shepp-logan") => Signal::SheppLogan,
        Some(other) => return Err(format!("--signal: {other}").into()),
    };
    let kernels = match arguments.option::<String>("--kernel")?.as_deref() {
        None => vec![Kernel::default(), Kernel::KAISER_BESSEL],
        Some("gaussian") => vec![Kernel::default()],
        Some("blob") => vec![Kernel::KAISER_BESSEL],
        Some(other) => return Err(format!("--kernel: {other}").into()),
    };
    let sharpness: Option<f64> = arguments.option("--sharpness")?;
    arguments.positional()?;
    let sharpness = sharpness.map_or_else(|| vec![0.0, 0.5, 1.0], |sharpness| vec![sharpness]);
    let mut methods = vec![Method::Trilinear, Method::CatmullRom, Method::BSpline];
    for (kernel, &sharpness) in kernels.iter().flat_map(|kernel| sharpness.iter().map(move |s| (*kernel, s))) {
        // Without sharpness both shadings have the same kernel and the same samples. Pre-shaded, a Gaussian alone
        // becomes narrower.
        let pre = kernel == Kernel::default() || sharpness == 0.0;
        methods.extend(pre.then_some(Method::Splats { kernel, sharpness, shading: Shading::Pre }));
        let post = sharpness > 0.0;
        methods.extend(post.then_some(Method::Splats { kernel, sharpness, shading: Shading::Post }));
    }
    let mut report = Report::new("kernels", &arguments);
    report.line("| method | field rms | max | rays rms | max | ripple | blur | half Nyquist | noise |");
    report.line("|---|---|---|---|---|---|---|---|---|");
    for method in methods {
        let Quality { field, rays, ripple, blur, half_nyquist, noise } = measure(signal, size, method)?;
        let errors = [field.rms, field.max, rays.rms, rays.max, ripple, blur].map(|number| format!("{number:.5}"));
        report.line(format_args!("| {method} | {} | {half_nyquist:.3} | {noise:.3} |", errors.join(" | ")));
    }
    report.finish(&HostRenderer::adapter())
}
