//! The description of tifffile: `{"shape": [12, 2, 20, 24], "axes": "ZCYX"}` at the first page of each array
//! (<https://github.com/cgohlke/tifffile>).

use serde_json::Value;

use super::described::Described;
use crate::formats::selection::{Axes, Role, sized};

/// Returns whether a description is of tifffile: a page with it begins a series.
pub(super) fn is_shaped(text: &str) -> bool {
    text.starts_with("{\"shape\":")
}

/// Describes the series of these pages, each of `samples` numbers. A description that contradicts the pages, as after
/// an edit of the file, is ignored.
pub(super) fn described(text: &str, pages: Vec<usize>, samples: u64) -> Described {
    let stated = serde_json::from_str::<Value>(text).ok().and_then(|stated| {
        let sizes: Vec<u64> = stated["shape"].as_array()?.iter().map(Value::as_u64).collect::<Option<_>>()?;
        let count = sizes.iter().try_fold(1, |all: u64, size| all.checked_mul(*size))?;
        let of_pages = count.checked_div(samples).filter(|n| n * samples == count)?;
        // Arrays that follow in one piece may share the directory of the first page.
        let together = pages.len() == 1 && of_pages > 1;
        if !together && of_pages != pages.len() as u64 {
            return None;
        }
        let axes = match stated["axes"].as_str().filter(|axes| axes.chars().count() == sizes.len()) {
            Some(letters) => named(letters, &sizes, of_pages)?,
            None => unnamed(&sizes, of_pages)?,
        };
        Some((axes, together))
    });
    match stated {
        Some((axes, together)) => Described { pages, axes, together, ..Described::default() },
        None => Described::sections(pages),
    }
}

/// Returns the axes of pages, the fastest first, by the letters of all axes. `None` if so many pages do not fill them.
fn named(letters: &str, sizes: &[u64], pages: u64) -> Option<Axes> {
    let mut left = pages;
    let mut all: Vec<(char, u64)> = letters.chars().zip(sizes.iter().copied()).collect();
    all.reverse();
    // Samples and pixels are in a page, and sections too if a page is a volume.
    all.retain(|(letter, _)| !"XYS".contains(*letter));
    if pages == 1 {
        all.clear();
    }
    let has_depth = all.iter().any(|(letter, _)| *letter == 'Z');
    let mut has_sections = has_depth;
    let role = |(letter, size): (char, u64)| {
        left = left.checked_div(size).filter(|rest| rest * size == left)?;
        let role = match letter {
            'Z' => Role::Space,
            'C' => Role::Channel,
            'T' => Role::Time,
            // Of axes without a meaning the fastest one has sections.
            _ if !has_sections => {
                has_sections = true;
                Role::Space
            }
            _ => Role::Time,
        };
        Some((role, sized(size)))
    };
    let axes = all.into_iter().map(role).collect::<Option<Axes>>()?;
    (left == 1).then_some(axes)
}

/// Returns the axes of pages by a shape without letters: sections, then channels if three axes are left, then time.
fn unnamed(sizes: &[u64], pages: u64) -> Option<Axes> {
    let mut count = 1;
    let beyond: Vec<u64> = sizes
        .iter()
        .copied()
        .take_while(|size| {
            let is_beyond = count != pages;
            count = if is_beyond { count.saturating_mul(*size) } else { count };
            is_beyond
        })
        .collect();
    let roles: &[Role] = match beyond.len() {
        0 | 1 => &[Role::Space],
        2 => &[Role::Space, Role::Time],
        3 => &[Role::Space, Role::Channel, Role::Time],
        _ => return None,
    };
    (count == pages).then(|| roles.iter().copied().zip(beyond.into_iter().rev().map(sized)).collect())
}

#[cfg(test)]
mod tests {
    use super::*;
    use Role::{Channel as C, Space as S, Time as T};

    #[test]
    fn axes_of_pages_are_the_letters_that_no_page_has() {
        let axes = |text: &str, pages: usize, samples: u64| described(text, (0..pages).collect(), samples).axes;
        let of = |shape: &str, letters: &str| format!("{{\"shape\": {shape}, \"axes\": \"{letters}\"}}");
        assert_eq!(axes(&of("[2, 12, 20, 24]", "CZYX"), 24, 480), [(S, 12), (C, 2)]);
        assert_eq!(axes(&of("[12, 2, 20, 24]", "ZCYX"), 24, 480), [(C, 2), (S, 12)]);
        assert_eq!(axes(&of("[7, 20, 24]", "TYX"), 7, 480), [(T, 7)]);
        assert_eq!(axes(&of("[3, 7, 20, 24]", "QIYX"), 21, 480), [(S, 7), (T, 3)]);
        // The samples of a page, and a page that is a volume.
        assert_eq!(axes(&of("[7, 20, 24, 3]", "ZYXS"), 7, 1440), [(S, 7)]);
        assert_eq!(axes(&of("[7, 20, 24]", "ZYX"), 1, 3360), []);
        assert_eq!(axes("{\"shape\": [2, 12, 20, 24]}", 24, 480), [(S, 12), (T, 2)]);
        assert_eq!(axes("{\"shape\": [12, 20, 24]}", 12, 480), [(S, 12)]);
        // Of another number of pages.
        assert_eq!(axes(&of("[2, 12, 20, 24]", "CZYX"), 12, 480), [(S, 12)]);
        assert_eq!(axes("{\"shape\":", 12, 480), [(S, 12)]);
        let together = described(&of("[2, 12, 20, 24]", "TZYX"), vec![0], 480);
        assert!(together.together && together.axes == [(S, 12), (T, 2)]);
    }
}
