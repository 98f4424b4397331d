//! A histogram in text.

/// The width of the histogram, in characters.
const COLUMNS: usize = 64;
/// The height of the histogram, in characters.
const ROWS: usize = 5;
/// The bars of 0 to 8 eighths of a character.
const BLOCKS: [char; 9] = [' ', '▁', '▂', '▃', '▄', '▅', '▆', '▇', '█'];

/// Draws counts as bars. Heights are logarithmic: a background of millions of voxels would flatten all other bars.
pub(crate) fn draw(counts: &[u64]) -> String {
    // Fewer counts than columns make wider bars.
    let columns: Vec<u64> = if counts.len() >= COLUMNS {
        (0..COLUMNS)
            .map(|c| counts[c * counts.len() / COLUMNS..(c + 1) * counts.len() / COLUMNS].iter().sum())
            .collect()
    } else {
        (0..COLUMNS).map(|c| counts.get(c * counts.len() / COLUMNS).copied().unwrap_or(0)).collect()
    };
    let height = |n: u64| libm::log1p(n as f64);
    let tallest = columns.iter().map(|&n| height(n)).fold(f64::MIN_POSITIVE, f64::max);
    let eighths: Vec<usize> = columns
        .iter()
        .map(|&n| if n == 0 { 0 } else { ((height(n) / tallest * (ROWS * 8) as f64).round() as usize).max(1) })
        .collect();
    (0..ROWS)
        .rev()
        .map(|row| {
            let line: String = eighths.iter().map(|&e| BLOCKS[e.saturating_sub(row * 8).min(8)]).collect();
            format!("  {}\n", line.trim_end())
        })
        .collect()
}

/// Returns a line of labels under the left and the right end of the bars.
pub(crate) fn axis(left: &str, right: &str) -> String {
    let width = COLUMNS.saturating_sub(left.chars().count());
    format!("  {left}{right:>width$}\n")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bars_fill_their_columns() {
        let drawn = draw(&[1_000_000, 0, 1]);
        assert_eq!(drawn.lines().count(), ROWS);
        let bottom = drawn.lines().last().unwrap();
        assert_eq!(bottom.chars().filter(|&c| c == '█').count(), 22);
        assert!(bottom.ends_with('▂'), "a single sample still shows: {bottom}");
        assert!(draw(&[]).trim().is_empty());
    }
}
