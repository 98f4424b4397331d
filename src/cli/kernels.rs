//! `voxsplat kernels`.

use voxsplat::kernel::Kernel;
use voxsplat::reconstruction::{Method, Quality, measure};
use voxsplat::settings::{Settings, Shading};

use super::args::KernelsArgs;
use super::{Failure, output};

pub(super) fn run(args: &KernelsArgs) -> Result<(), Failure> {
    let kernels = args.kernel.map_or_else(|| vec![Kernel::default(), Kernel::KAISER_BESSEL], |kernel| vec![kernel]);
    let asked = args.sharpness.map_or_else(|| vec![0.0, 0.5, 1.0], |sharpness| vec![sharpness]);
    let mut methods = vec![Method::Trilinear, Method::CatmullRom, Method::BSpline];
    for kernel in kernels {
        for &sharpness in &asked {
            // Without sharpness both shadings have the same kernel and the same samples.
            let shadings = if sharpness == 0.0 { vec![Shading::Pre] } else { vec![Shading::Pre, Shading::Post] };
            let valid = |&shading: &Shading| {
                shading == Shading::Post || Settings { kernel, sharpness, ..Settings::default() }.validate().is_ok()
            };
            methods.extend(shadings.into_iter().filter(valid).map(|shading| Method::Splats {
                kernel,
                sharpness,
                shading,
            }));
        }
    }
    let measured = methods.into_iter().map(|method| measure(args.signal, args.size, method));
    let measured = measured.collect::<Result<Vec<Quality>, _>>()?;
    if args.json {
        return output::print_json(&measured);
    }
    let width = measured.iter().map(|quality| quality.method.chars().count()).max().unwrap_or(0);
    let header = ["field rms", "max", "rays rms", "max", "ripple", "blur", "half Nyquist", "noise"];
    let mut text = format!("{:width$}", "");
    header.iter().for_each(|name| text += &format!("  {name:>9}"));
    for quality in &measured {
        let Quality { field, rays, ripple, blur, half_nyquist, noise, .. } = quality;
        text += &format!("\n{:width$}", quality.method);
        for number in [field.rms, field.max, rays.rms, rays.max, *ripple, *blur] {
            text += &format!("  {number:>9.5}");
        }
        text += &format!("  {half_nyquist:>12.3}  {noise:>9.3}");
    }
    output::print(&format!("{text}\n"))
}
