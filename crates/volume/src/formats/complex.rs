//! Complex samples: one of the two numbers, or their absolute value or phase, is the value of a voxel.

use std::path::Path;

use rayon::prelude::*;

use super::LoadOptions;
use super::selection::Role;
use crate::error::{Error, Hint, Result, Subject, refuse};
use crate::memory::{reserved, samples_in};
use crate::names::named;
use crate::volume::{Number, Samples, Stored};

/// The number of a complex sample that is the value of a voxel.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ComplexPart {
    /// The absolute value, or magnitude.
    Abs,
    /// The real part.
    Real,
    /// The imaginary part.
    Imag,
    /// The phase, -π to π.
    Phase,
}

named!("complex", ComplexPart { Abs: "abs", Real: "real", Imag: "imag", Phase: "phase" });

/// Returns the role of the two numbers of a complex sample, which [`part`] reduces to one. An error if no part is
/// requested.
pub(super) fn role(path: &Path, options: &LoadOptions) -> Result<Role> {
    match options.complex {
        Some(_) => Ok(Role::Space),
        None => Err(path.error("its samples are complex numbers").hinted(Hint::ChooseComplexPart)),
    }
}

/// Returns the requested part of complex samples, whose real and imaginary parts follow one another.
pub(super) fn part(stored: Stored, path: &Path, options: &LoadOptions) -> Result<Stored> {
    let Some(part) = options.complex else { return Ok(stored) };
    let samples = match stored.into_samples()? {
        Samples::F32(pairs) => of_pairs(&pairs, path, |[re, im]: [f32; 2]| match part {
            ComplexPart::Abs => libm::hypotf(re, im),
            ComplexPart::Real => re,
            ComplexPart::Imag => im,
            ComplexPart::Phase => libm::atan2f(im, re),
        })?,
        Samples::F64(pairs) => of_pairs(&pairs, path, |[re, im]: [f64; 2]| match part {
            ComplexPart::Abs => libm::hypot(re, im),
            ComplexPart::Real => re,
            ComplexPart::Imag => im,
            ComplexPart::Phase => libm::atan2(im, re),
        })?,
        _ => refuse!(path, "has complex numbers of integers, which are not read"),
    };
    Ok(samples.into())
}

fn of_pairs<T: Number>(pairs: &[T], path: &Path, part: impl Fn([T; 2]) -> T + Sync) -> Result<Samples> {
    let mut numbers = reserved(pairs.len() as u64 / 2, || samples_in(path))?;
    pairs.par_chunks_exact(2).map(|pair| part([pair[0], pair[1]])).collect_into_vec(&mut numbers);
    Ok(Number::collected(numbers))
}
