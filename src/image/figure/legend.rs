//! The legend: a patch of colour and a name for each of several media.

use glam::DVec2;

use super::NO_ROOM;
use super::canvas::Canvas;
use super::font::Font;
use super::path::Path;
use crate::error::{Error, Result};
use crate::layers::LegendEntry;

/// The size of letters, the distance of lines and the side of a patch, in sizes of the figure's letters.
const TEXT: f64 = 0.9;
const LINE: f64 = 1.35;
const PATCH: f64 = 0.9;
/// The distance from the left edge of a patch to its name, and from a name to the next column, in sizes of letters.
const INDENT: f64 = 1.4;
const GAP: f64 = 1.0;
/// The largest width of a name; longer names are cut.
const WIDEST: f64 = 14.0;
/// The sign at the end of a cut name.
const CUT: char = '…';

/// The columns of a legend, each with its names and its width, and the number of entries that do not fit.
struct Columns {
    columns: Vec<(Vec<String>, f64)>,
    left_out: usize,
}

/// Arranges names in a width and a height. Columns are filled one after the other, over at most half of the width if
/// there are several. If there is no room for all, the last line is left for the number of missing entries.
fn arranged(font: &Font, entries: &[LegendEntry], em: f64, [width, height]: [f64; 2]) -> Columns {
    let rows = (height / (LINE * em)).floor().max(0.0) as usize;
    let names: Vec<String> = entries.iter().map(|entry| cut(font, &entry.name, TEXT * em, WIDEST * em)).collect();
    let mut columns: Vec<(Vec<String>, f64)> = Vec::new();
    let (mut used, mut left_out) = (0.0, entries.len());
    for names in names.chunks(rows.max(1)) {
        let widest = names.iter().map(|name| font.width(name, TEXT * em)).fold(0.0, f64::max);
        let wide = INDENT * em + widest;
        // Several columns leave half of the picture free.
        let (gap, room) = if columns.is_empty() { (0.0, width) } else { (GAP * em, width / 2.0) };
        if rows == 0 || used + gap + wide > room {
            break;
        }
        used += gap + wide;
        left_out -= names.len();
        columns.push((names.to_vec(), wide));
    }
    if let Some((last, _)) = columns.last_mut().filter(|_| left_out > 0) {
        last.pop();
        left_out += 1;
    }
    Columns { columns, left_out }
}

/// Cuts a name to a width.
pub(super) fn cut(font: &Font, name: &str, size: f64, most: f64) -> String {
    if font.width(name, size) <= most {
        return name.to_owned();
    }
    let room = most - font.width(&CUT.to_string(), size);
    let fits = |end: &usize| font.width(&name[..*end], size) <= room;
    let end = name.char_indices().map(|(at, _)| at).take_while(fits).last().unwrap_or(0);
    format!("{}{CUT}", name[..end].trim_end())
}

/// Refuses names that cannot be written, and a legend without room for a line.
pub(super) fn check(font: &Font, entries: &[LegendEntry], em: f64, room: [f64; 2]) -> Result<()> {
    for LegendEntry { name, .. } in entries {
        if let Some(c) = font.lacks(name).or_else(|| name.chars().find(|c| c.is_control())) {
            let reason = format!("{name:?}: the font has no {c:?}: it has Latin, Greek and Cyrillic letters");
            return Err(Error::setting("legend", reason));
        }
    }
    if arranged(font, entries, em, room).left_out == entries.len() {
        return Err(Error::setting("legend", NO_ROOM));
    }
    Ok(())
}

/// Draws a legend in an area, from its upper left corner.
pub(super) fn draw(canvas: &mut Canvas, entries: &[LegendEntry], [least, most]: [DVec2; 2]) {
    let em = canvas.em;
    let Columns { columns, left_out } = arranged(&canvas.font, entries, em, (most - least).to_array());
    let mut left = least.x;
    let mut entries = entries.iter();
    let place = |row: usize| least.y + (row as f64 + 0.5) * LINE * em;
    let last = columns.len().saturating_sub(1);
    for (number, (names, wide)) in columns.into_iter().enumerate() {
        for (row, (name, entry)) in names.iter().zip(entries.by_ref()).enumerate() {
            let y = place(row);
            let side = (PATCH * em).round();
            // Whole pixels, so that the edges are sharp.
            let corner = DVec2::new(left.round(), (y - side / 2.0).round());
            let patch = Path::rectangle(corner, corner + side);
            canvas.halo(&patch);
            canvas.fill(&patch, entry.color.map(|channel| f64::from(channel) / 255.0), 1.0);
            canvas.write(name, TEXT * em, DVec2::new(left + INDENT * em, y), 0.0);
        }
        if number == last && left_out > 0 {
            canvas.write(&format!("and {left_out} more"), TEXT * em, DVec2::new(left, place(names.len())), 0.0);
        }
        left += wide + GAP * em;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn entries(count: usize) -> Vec<LegendEntry> {
        (0..count).map(|i| LegendEntry { name: format!("label {i}"), color: [9; 3] }).collect()
    }

    #[test]
    fn columns_are_filled_one_after_the_other() {
        let font = Font::new();
        let fits = |count: usize, room: [f64; 2]| {
            let Columns { columns, left_out } = arranged(&font, &entries(count), 10.0, room);
            (columns.iter().map(|(names, _)| names.len()).collect::<Vec<_>>(), left_out)
        };
        // Five lines of 13.5 pixels.
        assert_eq!(fits(4, [300.0, 70.0]), (vec![4], 0));
        assert_eq!(fits(5, [300.0, 70.0]), (vec![5], 0));
        assert_eq!(fits(7, [300.0, 70.0]), (vec![5, 2], 0));
        // The last line is for those that are missing.
        assert_eq!(fits(40, [230.0, 70.0]), (vec![5, 4], 31));
        assert_eq!(fits(40, [60.0, 70.0]), (vec![4], 36));
        assert_eq!((fits(2, [300.0, 13.0]).1, fits(2, [20.0, 70.0]).1), (2, 2));
        assert!(check(&font, &entries(2), 10.0, [20.0, 70.0]).unwrap_err().to_string().contains("no room"));
        assert!(check(&font, &entries(2), 10.0, [200.0, 70.0]).is_ok());
    }

    #[test]
    fn long_names_are_cut() {
        let font = Font::new();
        assert_eq!(cut(&font, "liver", 9.0, 140.0), "liver");
        let name = "Left superior parietal lobule of the cortex";
        let short = cut(&font, name, 9.0, 140.0);
        assert!(short.ends_with(CUT) && name.starts_with(short.trim_end_matches(CUT)) && short.chars().count() > 10);
        assert!(font.width(&short, 9.0) <= 140.0 && font.lacks(&short).is_none());
        let odd = [LegendEntry { name: "骨".to_owned(), color: [0; 3] }];
        let error = check(&font, &odd, 10.0, [200.0, 70.0]).unwrap_err();
        assert!(error.to_string().contains("\"骨\": the font has no '骨'"), "{error}");
    }
}
