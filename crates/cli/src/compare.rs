//! `voxsplat compare`.

use voxsplat::image::{self, Background, Image};

use super::failure::Failure;
use super::job::CompareJob;
use super::output;

/// The factor of the difference picture: it makes one step of 8 bits visible.
const GAIN: f64 = 10.0;

pub(crate) fn run(job: &CompareJob) -> Result<(), Failure> {
    let (a, b) = (Image::load(&job.a)?, Image::load(&job.b)?);
    let comparison = image::compare(&a, &b, job.tolerance)?;
    if let Some(path) = &job.difference {
        image::difference_picture(&a, &b, GAIN)?.save(path, Background::default())?;
    }
    if job.json {
        output::print_json(&comparison)?;
    } else {
        output::print(&format!("{}\n", comparison.to_string().trim_end()))?;
    }
    if comparison.outliers == 0 {
        return Ok(());
    }
    Err(Failure::Failed(format!(
        "{} and {} differ by more than {} in {} pixels, at most by {:.6}",
        job.a.display(),
        job.b.display(),
        job.tolerance,
        comparison.outliers,
        comparison.max
    )))
}
