//! `voxsplat compare`.

use voxsplat::image::{self, Background, Comparison, Image};

use super::args::CompareArgs;
use super::failure::{Failure, fail};
use super::output;

/// The factor of the difference picture: it makes one step of 8 bits visible.
const GAIN: f64 = 10.0;

pub(crate) fn run(args: &CompareArgs) -> Result<(), Failure> {
    if let Some(path) = &args.difference {
        Image::check_output(path).map_err(|e| Failure::usage(format!("{e:#}")))?;
    }
    let (a, b) = (Image::load(&args.a)?, Image::load(&args.b)?);
    let comparison = image::compare(&a, &b, args.tolerance)?;
    if let Some(path) = &args.difference {
        image::difference_picture(&a, &b, GAIN)?.save(path, Background::default())?;
    }
    if args.json {
        output::print_json(&comparison)?;
    } else {
        output::print(&format!("{}\n", comparison.to_string().trim_end()))?;
    }
    if comparison.outliers == 0 {
        return Ok(());
    }
    let (a, b, tolerance) = (args.a.display(), args.b.display(), args.tolerance);
    let Comparison { outliers, max, .. } = comparison;
    fail(format!("{a} and {b} differ by more than {tolerance} in {outliers} pixels, at most by {max:.6}"))
}
