//! The adapter that tests on a device run on, here and in `tests/suite`.

/// Returns a part of the adapter's name: `VOXSPLAT_TEST_ADAPTER`, or Mesa's software rasteriser.
///
/// Bounds and goldens were taken with a named driver, so tests do not run on whatever adapter is the best.
pub(crate) fn adapter() -> String {
    std::env::var("VOXSPLAT_TEST_ADAPTER").unwrap_or_else(|_| "llvmpipe".to_owned())
}
