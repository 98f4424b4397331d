//! Tables of labels of other programs, told apart by content.

use std::collections::BTreeMap;
use std::path::Path;

use voxsplat_volume::files;

use crate::error::{Error, Result};
use crate::transfer::color;

/// The largest table that is read, in bytes.
const MAX_BYTES: u64 = 64 << 20;

/// A row of a table: a label, its name, red, green and blue from 0 to 255 and, if stated, the opacity from 0 to 1.
type Row = (i64, String, [f64; 3], Option<f64>);

/// The name and the look of a label.
#[derive(Debug, Clone, PartialEq)]
pub struct Label {
    /// The name of the labelled structure.
    pub name: String,
    /// Red, green and blue of the label, in 0..1, in display space.
    pub color: [f64; 3],
    /// The opacity in 0..1 of a slab as thick as the smallest spacing; 0: invisible.
    pub opacity: f64,
}

/// Loads a table.
pub(super) fn load(path: &Path) -> Result<BTreeMap<i64, Label>> {
    let fault = |reason: String| Error::format(path, reason);
    parse(&files::read_text(path, MAX_BYTES)?).map_err(fault)
}

fn parse(text: &str) -> Result<BTreeMap<i64, Label>, String> {
    let text = text.trim_start_matches('\u{feff}');
    let lines = || text.lines().enumerate().filter(|(_, l)| !l.trim().is_empty() && !l.trim_start().starts_with('#'));
    let columns = lines().next().and_then(|(_, line)| TableColumns::of(line));
    let row = |line: &str| columns.as_ref().map_or_else(|| row(line), |columns| columns.row(line));
    let rows = lines().skip(usize::from(columns.is_some())).map(|(number, line)| {
        row(line).ok_or_else(|| {
            let expected = "a number, a name, and red, green, blue and opacity";
            let tip = columns.as_ref().map(|columns| columns.tip(line)).unwrap_or_default();
            format!("line {}: {:?}, expected {expected}{tip}", number + 1, line.trim())
        })
    });
    let rows = rows.collect::<Result<Vec<Row>, String>>()?;
    if rows.is_empty() {
        return Err("no label".to_owned());
    }
    // FreeSurfer states transparencies in place of opacities, and all are 0.
    let transparent = rows.iter().all(|(_, _, _, opacity)| opacity.is_none_or(|opacity| opacity == 0.0));
    let label = |(number, name, color, opacity): Row| {
        let stated = if transparent { None } else { opacity };
        let opacity = stated.unwrap_or(if number == 0 { 0.0 } else { 1.0 });
        let color = color.map(|channel| (channel / 255.0).clamp(0.0, 1.0));
        (number, Label { name, color, opacity: opacity.clamp(0.0, 1.0) })
    };
    Ok(rows.into_iter().map(label).collect())
}

/// Parses a row of a table without a line that names columns.
fn row(line: &str) -> Option<Row> {
    let line = line.trim();
    if let Some((numbers, name)) = line.split_once('"') {
        // ITK-SNAP: number, red, green, blue, opacity, visibility in slices and in meshes, name.
        let name = name.strip_suffix('"')?.to_owned();
        let label = numbers.split_whitespace().next()?.parse().ok()?;
        let values: Vec<f64> = numbers.split_whitespace().skip(1).map(|v| v.parse().ok()).collect::<Option<_>>()?;
        let &[red, green, blue, opacity, slices, meshes] = values.as_slice() else { return None };
        let shown = slices != 0.0 && meshes != 0.0;
        return Some((label, name, [red, green, blue], Some(if shown { opacity } else { 0.0 })));
    }
    // 3D Slicer and FreeSurfer: number, name, red, green, blue, and opacity or transparency from 0 to 255.
    let words: Vec<&str> = line.split_whitespace().collect();
    let label = words.first()?.parse().ok()?;
    let behind = words.get(2..)?.iter().rev().take_while(|word| word.parse::<f64>().is_ok()).count().min(4);
    if behind < 3 {
        return None;
    }
    let (name, values) = words[1..].split_at(words.len() - 1 - behind);
    let values: Vec<f64> = values.iter().filter_map(|v| v.parse().ok()).collect();
    let opacity = values.get(3).map(|opacity| opacity / 255.0);
    Some((label, name.join(" ").replace('_', " "), [values[0], values[1], values[2]], opacity))
}

/// The places of the columns of a table that names them: .csv of 3D Slicer, .tsv of BIDS.
struct TableColumns {
    separator: char,
    label: usize,
    name: usize,
    /// The column of #rrggbb or names, or three columns of red, green and blue from 0 to 255.
    color: Vec<usize>,
    opacity: Option<usize>,
}

impl TableColumns {
    fn of(line: &str) -> Option<Self> {
        let separator = if line.contains('\t') { '\t' } else { ',' };
        let names: Vec<String> = cells(line, separator).map(str::to_ascii_lowercase).collect();
        let at = |all: &[&str]| names.iter().position(|name| all.contains(&name.as_str()));
        let channels = || Some(vec![at(&["color_r", "r"])?, at(&["color_g", "g"])?, at(&["color_b", "b"])?]);
        let color = at(&["color", "colour"]).map(|hex| vec![hex]).or_else(channels)?;
        Some(Self {
            separator,
            label: at(&["labelvalue", "index", "label", "id"])?,
            name: at(&["name"])?,
            color,
            opacity: at(&["color_a", "a"]),
        })
    }

    fn row(&self, line: &str) -> Option<Row> {
        let cells: Vec<&str> = cells(line, self.separator).collect();
        let number = |at: usize| -> Option<f64> { cells.get(at)?.parse().ok() };
        let color = match self.color.as_slice() {
            &[red, green, blue] => [number(red)?, number(green)?, number(blue)?],
            text => color::parse(cells.get(*text.first()?)?)?.map(|channel| 255.0 * channel),
        };
        let opacity = self.opacity.and_then(number).map(|opacity| opacity / 255.0);
        Some((cells.get(self.label)?.parse().ok()?, (*cells.get(self.name)?).to_owned(), color, opacity))
    }

    /// Returns the remedy at the end of the error of a row.
    fn tip(&self, line: &str) -> String {
        let [text] = self.color.as_slice() else { return String::new() };
        cells(line, self.separator).nth(*text).map(color::tip).unwrap_or_default()
    }
}

fn cells(line: &str, separator: char) -> impl Iterator<Item = &str> {
    line.split(separator).map(|cell| cell.trim().trim_matches('"'))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tables_of_programs_are_read() {
        let snap = "# ITK-SnAP Label Description File\n    0     0    0    0        0  0  0    \"Clear Label\"\n  \
                    7   255    0  51      0.5  1  1    \"Left kidney\"\n  8  0 0 255  1 1 0 \"Hidden\"\n";
        let labels = parse(snap).unwrap();
        assert_eq!(labels[&7], Label { name: "Left kidney".to_owned(), color: [1.0, 0.0, 0.2], opacity: 0.5 });
        assert_eq!((labels[&0].opacity, labels[&8].opacity), (0.0, 0.0));
        let slicer = "# Color table file x\n# 2 values\n0 Background 0 0 0 0\n1 soft_tissue 128 174 128 255\n";
        let labels = parse(slicer).unwrap();
        assert_eq!((labels[&1].name.as_str(), labels[&1].opacity, labels[&0].opacity), ("soft tissue", 1.0, 0.0));
        let free =
            "#No. Label Name:   R   G   B   A\n\n0   Unknown  0   0   0   0\n17  Left-Hippocampus 220 216 20 0\n";
        let labels = parse(free).unwrap();
        assert_eq!(
            (labels[&17].name.as_str(), labels[&17].opacity, labels[&0].opacity),
            ("Left-Hippocampus", 1.0, 0.0)
        );
        let bids = "index\tname\tabbreviation\tcolor\n-3\tWhite matter\tWM\t#ff0000\n";
        assert_eq!(parse(bids).unwrap()[&-3].color, [1.0, 0.0, 0.0]);
        let named = "index,name,colour\n1,Gut,Salmon\n";
        assert_eq!(parse(named).unwrap()[&1].color, [250.0 / 255.0, 128.0 / 255.0, 114.0 / 255.0]);
        let misspelt = parse(&named.replace("Salmon", "samon")).unwrap_err();
        assert!(misspelt.ends_with("opacity; a similar colour exists: salmon"), "{misspelt}");
        let csv = "LabelValue,Name,Color_R,Color_G,Color_B,Color_A\n4294967295,\"Big, no\",0,255,0,51\n";
        assert!(parse(csv).unwrap_err().starts_with("line 2: "));
        let csv = "LabelValue,Name,Color_R,Color_G,Color_B,Color_A\n4294967295,Big,0,255,0,51\n";
        assert_eq!(parse(csv).unwrap()[&4_294_967_295].opacity, 0.2);
    }

    #[test]
    fn what_is_no_table_is_refused() {
        for text in ["", "# nothing", "1 name 2 3", "name 1 2 3 4", "1 2 3 4 \"no\"", "{\"points\": []}"] {
            let refused = parse(text).unwrap_err();
            assert!(refused == "no label" || refused.contains("expected a number, a name"), "{text:?}: {refused}");
        }
    }
}
