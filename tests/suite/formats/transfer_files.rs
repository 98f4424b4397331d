//! Transfer functions in the files of other programs, compared with the results of these programs.

use std::path::{Path, PathBuf};

use serde_json::Value;
use voxsplat::transfer::maps::{self, ColorMap};
use voxsplat::transfer::{GradientPoint, Imported, TransferFunction, Window};
use voxsplat::volume::{Grid, Statistics};

use crate::support::demo;

fn folder() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("data/transfer")
}

fn import(name: &str) -> Imported {
    Imported::load(folder().join(name)).unwrap_or_else(|e| panic!("{name}: {e:#}"))
}

fn refused(text: &str, name: Option<&str>, reason: &str) {
    let said = Imported::parse(text, name).unwrap_err().to_string();
    assert!(said.contains(reason), "{text}: {said}");
}

#[test]
fn files_of_other_programs_have_the_colours_and_opacities_that_these_give_them() {
    let expected: Value =
        serde_json::from_str(&std::fs::read_to_string(folder().join("expected.json")).unwrap()).unwrap();
    for (name, expected) in expected.as_object().unwrap() {
        let imported = import(name);
        let flag = |key: &str| expected.get(key) == Some(&Value::Bool(true));
        assert_eq!((imported.fits, imported.mean_spacing), (flag("fits"), flag("mean")), "{name}");
        assert_eq!(imported.transfer.unit_distance(), expected.get("unit").and_then(Value::as_f64), "{name}");
        let material = expected.get("material").map(|m| serde_json::from_value::<[f64; 4]>(m.clone()).unwrap());
        assert_eq!(imported.material, material, "{name}");
        assert_eq!(imported.transfer.gradient_opacity().len(), if flag("gradient") { 3 } else { 0 }, "{name}");
        let rows: Vec<[Option<f64>; 5]> = serde_json::from_value(expected["rows"].clone()).unwrap();
        let mut most: f64 = 0.0;
        for row in &rows {
            let (color, opacity) = imported.transfer.sample(row[0].unwrap());
            (0..3).for_each(|c| most = most.max((color[c] - row[c + 1].unwrap()).abs()));
            row[4].iter().for_each(|expected| most = most.max((opacity - expected).abs()));
        }
        // Line segments differ from curves by at most 1e-3.
        assert!(most < 1.2e-3, "{name}: {most}");
    }
}

#[test]
fn several_functions_are_told_apart_by_name() {
    let said = Imported::load(folder().join("paraview.json")).unwrap_err().to_string();
    assert!(said.contains("holds 5 functions, choose one by FILE#NAME: Cool to Warm, Lab, HSV"), "{said}");
    let said = Imported::load(folder().join("presets.xml#CT-Wood")).unwrap_err().to_string();
    assert!(said.contains("none is \"CT-Wood\": CT-Bone, CT-Edges"), "{said}");
    let said = Imported::load(folder().join("slicer.vp#x")).unwrap_err().to_string();
    assert!(said.contains("one function, and none called \"x\""), "{said}");
    // A file whose name contains a # is found first.
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("a#b.vp");
    std::fs::copy(folder().join("slicer.vp"), &path).unwrap();
    assert_eq!(Imported::load(&path).unwrap(), import("slicer.vp"));
}

#[test]
fn what_no_program_writes_is_refused_with_its_reason() {
    refused(r#"{"RGBPoints": [0, 1, 2]}"#, None, "RGBPoints: 3 numbers, expected 4 for each point");
    refused(r#"{"RGBPoints": [0, 1, 2, "a"]}"#, None, "\"a\", expected a number");
    refused(r#"{"RGBPoints": [0, 0, 0, 0, 1, 1, 1, 1], "ColorSpace": "YUV"}"#, None, "colour space \"YUV\"");
    refused(r#"{"RGBPoints": [0, 0, 0, 0]}"#, None, "colours at two values");
    refused(r#"{"IndexedColors": [0, 1, 2]}"#, None, "for labels");
    refused("[]", None, "holds no transfer function");
    refused(r#"{"R": [0], "G": [0, 1], "B": [0]}"#, None, "unlike lengths");
    refused(r#"{"R": [0, 1], "G": [0, 1], "B": [0, 1], "I": [1, 0]}"#, None, "I does not ascend");
    refused(r#"{"colors": [[0, 1]]}"#, None, "rows of 3 or 4 numbers");
    refused(r#"{"colors": [[0, 1, 1], [1, 1, 1]], "controls": [0]}"#, None, "expected 2 ascending numbers");
    refused("1\n1\n0.9", None, "3 lines of numbers, expected the 9");
    refused("1\n1\n0.9\n0.1\n0.2\n10\n3 0 1\n4 0 1 255 1\n4 0 1 1 1", None, "2 numbers where 3 are announced");
    refused("1\n1\n0.9\n0.1\n0.2\n10\n2 0 nan\n4 0 1 255 1\n4 0 1 1 1", None, "\"nan\", expected a number");
    refused("<ColorMaps/>", None, "no transfer function");
    refused("<ColorMap><Point x='0'/></ColorMap>", None, "r=\"\", expected a number");
    refused("<ColorMap", None, "malformed XML");
    refused(r#"{"volumeProperties": [{}]}"#, None, "no components");
    refused("hello", None, "line 1: \"hello\", expected JSON, XML");
    refused(r#"{"colours": 3}"#, None, "unknown field `colours`");
}

#[test]
fn opacities_without_a_thickness_are_for_the_mean_spacing() {
    let grid = Grid::axis_parallel([2, 2, 2], [1.0, 2.0, 6.0]).unwrap();
    assert_eq!(import("slicer.vp").placed(&grid, None).unwrap().unit_distance(), Some(3.0));
    assert_eq!(import("slicer.vp.json").placed(&grid, None).unwrap().unit_distance(), Some(1.5));
    let map = import("napari.json");
    let refused = map.placed(&grid, None).unwrap_err().to_string();
    assert!(refused.starts_with("window: a colour map needs one"), "{refused}");
    let placed = map.placed(&grid, Some(&Window { level: 100.0, width: 20.0 })).unwrap();
    assert_eq!((placed.range(), placed.unit_distance()), ([90.0, 110.0], None));
}

#[test]
fn what_is_written_for_slicer_is_read_back() {
    let (volume, _) = demo("shepp-logan", 16);
    let transfer = TransferFunction::preset("viridis", &volume).unwrap();
    let grid = Grid::axis_parallel([4; 3], [0.5, 1.0, 1.5]).unwrap();
    let read = Imported::parse(&transfer.to_slicer_json(&grid), None).unwrap();
    assert_eq!((read.transfer.points(), read.transfer.unit_distance()), (transfer.points(), Some(0.5)));
    assert_eq!((read.fits, read.mean_spacing, read.material), (false, false, None));
    assert!(read.transfer.gradient_opacity().is_empty());
    let read = Imported::parse(&transfer.to_slicer_vp(&grid), None).unwrap();
    assert_eq!((read.transfer.points(), read.mean_spacing), (transfer.points(), true));
    // Magnitudes are per world unit here, and per mean spacing in the other program.
    let edges = [(4.0, 0.0), (40.0, 1.0)].map(|(magnitude, opacity)| GradientPoint { magnitude, opacity });
    let transfer = transfer.with_unit_distance(0.5).unwrap().with_gradient_opacity(edges.to_vec()).unwrap();
    let wide = Grid::axis_parallel([4; 3], [1.0, 2.0, 3.0]).unwrap();
    let read = Imported::parse(&transfer.to_slicer_json(&wide), None).unwrap();
    assert_eq!(read.transfer.gradient_opacity()[1].magnitude, 80.0);
    assert_eq!(read.placed(&wide, None).unwrap(), transfer);
}

#[test]
fn every_colour_map_has_its_published_ends() {
    for name in maps::names() {
        let transfer = maps::find(name).unwrap().transfer().unwrap();
        assert_eq!(
            (transfer.range(), transfer.sample(0.0).1, transfer.sample(1.0).1),
            ([0.0, 1.0], 0.0, 0.1),
            "{name}"
        );
        assert!(transfer.points().len() >= 17, "{name}");
    }
    assert!(maps::names().len() == 32 && maps::find("batlo").is_err());
    let ends = |name: &str| {
        let transfer = maps::find(name).unwrap().transfer().unwrap();
        [0.0, 1.0].map(|place| transfer.sample(place).0.map(|c| (c * 255.0).round() as u8))
    };
    assert_eq!(ends("batlow"), [[1, 25, 89], [250, 204, 250]]);
    assert_eq!(ends("ice"), [[4, 6, 19], [234, 253, 253]]);
    assert_eq!(ends("viridis"), [[68, 1, 84], [253, 231, 37]]);
    assert_eq!(ColorMap::load(folder().join("slicer.vp")).unwrap().transfer().unwrap().sample(0.0).0, [0.0; 3]);
}

#[test]
fn a_window_fits_the_foreground() {
    let statistics = Statistics::of(&demo("shepp-logan", 16).0).unwrap();
    let [low, high] = Window::of_foreground(&statistics).unwrap().ends().unwrap();
    assert!(statistics.min <= low && low < high && high <= statistics.max, "{low} {high}");
}
