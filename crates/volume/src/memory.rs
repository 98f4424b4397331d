//! Fallible allocation, for sizes that come from files or settings: an error instead of an abort.

use std::path::Path;

use bytemuck::Zeroable;
use bytemuck::allocation::try_zeroed_vec;

use crate::error::{Error, Result};

/// An empty vector with room for `count` elements. `what` names them in the error.
pub fn reserved<T>(count: u64, what: impl FnOnce() -> String) -> Result<Vec<T>> {
    let mut elements = Vec::new();
    match usize::try_from(count).map(|count| elements.try_reserve_exact(count)) {
        Ok(Ok(())) => Ok(elements),
        _ => Err(refused::<T>(count, what)),
    }
}

/// A vector of `count` zeros. The system provides pages when they are written to, so the missing samples of a short
/// file cost no time.
pub fn zeroed<T: Zeroable>(count: u64, what: impl FnOnce() -> String) -> Result<Vec<T>> {
    let fits = |count: &usize| count.checked_mul(size_of::<T>()).is_some_and(|bytes| bytes <= isize::MAX as usize);
    let elements = usize::try_from(count).ok().filter(fits).and_then(|count| try_zeroed_vec(count).ok());
    elements.ok_or_else(|| refused::<T>(count, what))
}

fn refused<T>(count: u64, what: impl FnOnce() -> String) -> Error {
    Error::Memory { what: what(), bytes: count.saturating_mul(size_of::<T>() as u64) }
}

/// Refuses work for which there are no `bytes` of memory.
///
/// To be called before encoders and decoders of other crates, which abort if an allocation fails.
pub fn check(bytes: u64, what: impl FnOnce() -> String) -> Result<()> {
    reserved::<u8>(bytes, what).map(drop)
}

/// The purpose of memory for the samples of a file, for messages.
pub fn samples_in(path: &Path) -> String {
    format!("the samples of {}", path.display())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_cannot_be_had_is_an_error() {
        assert!(reserved::<u64>(1000, String::new).unwrap().capacity() >= 1000);
        assert_eq!(zeroed::<u16>(3, String::new).unwrap(), [0; 3]);
        for count in [u64::MAX, 1 << 62] {
            let error = reserved::<u64>(count, || "a test".to_owned()).unwrap_err();
            assert_eq!(error.to_string(), format!("no memory for a test: {} bytes", count.saturating_mul(8)));
            assert!(check(count, String::new).is_err() && zeroed::<u64>(count, String::new).is_err());
        }
    }
}
