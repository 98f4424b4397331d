//! Round numbers, and numbers in a form that people read.

/// Returns 1, 2 and 5 times the powers of ten around a number over 0, ascending.
fn rounds(around: f64) -> impl DoubleEndedIterator<Item = f64> {
    let exponent = libm::log10(around).floor() as i32;
    let rounds = (exponent - 1..=exponent + 1).flat_map(|e| [1, 2, 5].map(|digit| (digit, e)));
    // As a decimal number is read, so that 1e-3 is 0.001 to the last bit.
    let values = rounds.map(|(digit, e)| format!("{digit}e{e}").parse().unwrap_or(0.0));
    values.collect::<Vec<f64>>().into_iter()
}

/// The relative difference that does not count: logarithms and quotients are rounded.
const SLACK: f64 = 1e-9;

/// Returns the largest round number that is no larger than `most`, which is over 0.
pub(super) fn round_below(most: f64) -> f64 {
    rounds(most).rev().find(|&value| value <= most * (1.0 + SLACK)).unwrap_or(most)
}

/// Returns a round step, and its multiples from `low` to a larger `high`: at least two, and no more than `most` if
/// possible.
pub(super) fn ticks([low, high]: [f64; 2], most: usize) -> (f64, Vec<f64>) {
    let multiples = |step: f64| {
        let first = (low / step - SLACK).ceil();
        let count = (high / step + SLACK).floor() - first;
        let values = (0..=count.clamp(-1.0, 1e3) as i32).map(|i| (first + f64::from(i)) * step);
        (step, values.collect::<Vec<f64>>())
    };
    let steps = rounds((high - low) / most as f64);
    let enough = steps.map(multiples).filter(|(_, values)| values.len() >= 2);
    let few = enough.reduce(|finer, coarser| if finer.1.len() > most { coarser } else { finer });
    few.unwrap_or((high - low, vec![low, high]))
}

/// Writes a multiple of a step with the digits that the step needs.
pub(super) fn label(value: f64, step: f64) -> String {
    let value = if value.abs() < step / 2.0 { 0.0 } else { value };
    let places = -libm::log10(step * (1.0 + 1e-12)).floor() as i32;
    let text = if value != 0.0 && (places > 4 || value.abs() >= 1e6) {
        let digits = (places + libm::log10(value.abs()).floor() as i32).clamp(0, 15) as usize;
        format!("{value:.digits$e}")
    } else {
        format!("{value:.*}", places.max(0) as usize)
    };
    text.replace('-', "−")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lengths_are_round() {
        for (most, expected) in [(1.0, 1.0), (1.99, 1.0), (2.0, 2.0), (4.9, 2.0), (5.0, 5.0), (9.99, 5.0), (10.0, 10.0)]
        {
            for scale in [1.0, 1e-3, 1e-90, 1e90, 1e6] {
                let found = round_below(most * scale);
                assert!((found / (expected * scale) - 1.0).abs() < 1e-9, "{most} {scale} {found}");
            }
        }
        assert_eq!(round_below(1e-3), 0.001);
    }

    #[test]
    fn ticks_are_round_and_few() {
        assert_eq!(ticks([0.0, 1.0], 6), (0.2, vec![0.0, 0.2, 0.4, 0.6000000000000001, 0.8, 1.0]));
        assert_eq!(ticks([150.0, 1200.0], 6).1, [200.0, 400.0, 600.0, 800.0, 1000.0, 1200.0]);
        assert_eq!(ticks([-1000.0, 3000.0], 5).1, [-1000.0, 0.0, 1000.0, 2000.0, 3000.0]);
        for scale in [1e-200, 1e-9, 1.0, 1e9, 1e200] {
            for most in 2..9 {
                let (step, found) = ticks([-0.37 * scale, 2.71 * scale], most);
                assert!((2..=most.max(4)).contains(&found.len()), "{scale} {most}: {step} {found:?}");
            }
        }
    }

    #[test]
    fn labels_have_the_digits_of_their_step() {
        assert_eq!(label(0.6000000000000001, 0.2), "0.6");
        assert_eq!(label(-1000.0, 500.0), "−1000");
        assert_eq!(label(0.0, 0.05), "0.00");
        assert_eq!(label(1e-17, 0.5), "0.0");
        assert_eq!(label(2.5e7, 5e6), "2.5e7");
        assert_eq!(label(-2e-7, 1e-7), "−2e−7");
        assert_eq!(label(0.001, 0.001), "0.001");
        assert_eq!(label(500.0, 500.0), "500");
    }
}
