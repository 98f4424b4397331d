//! The hash of plans and of the files of bricks.

/// Returns the hash FNV-1a of words, the same on every machine.
pub(super) fn fnv1a(words: impl Iterator<Item = u64>) -> u64 {
    words.fold(0xcbf2_9ce4_8422_2325, |hash, word| (hash ^ word).wrapping_mul(0x0100_0000_01b3))
}
