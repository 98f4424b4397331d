//! The vectors of the machine that the processor computes with.

use std::sync::LazyLock;

use pulp::{Simd, WithSimd};

/// Whether the machine has AVX2 and fused products, and no test requests portable code.
static HAS_AVX2: LazyLock<bool> = LazyLock::new(|| {
    let is_lowered = std::env::var_os("VOXSPLAT_TEST_VECTORS").is_some_and(|level| level == "portable");
    #[cfg(target_arch = "x86_64")]
    let has = pulp::x86::V3::try_new().is_some();
    #[cfg(not(target_arch = "x86_64"))]
    let has = false;
    has && !is_lowered
});

/// Names the vectors that this machine computes with.
pub(crate) fn vector_level() -> &'static str {
    if *HAS_AVX2 { "AVX2" } else { "portable" }
}

/// Runs a task compiled for the vectors of this machine.
pub(crate) fn dispatch<T: WithSimd>(task: T) -> T::Output {
    #[cfg(target_arch = "x86_64")]
    if *HAS_AVX2 && let Some(simd) = pulp::x86::V3::try_new() {
        return Simd::vectorize(simd, task);
    }
    Simd::vectorize(pulp::Scalar256b, task)
}
