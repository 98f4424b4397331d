//! The command `sheet`.

use std::fs;

use voxsplat::image::Image;

use crate::cli::{complaint, complaints, folder, stdout, voxsplat};

#[test]
fn a_sheet_has_a_picture_of_each_volume_and_names_the_broken_ones() {
    let dir = folder();
    let dir = dir.path();
    let scans = dir.join("scans");
    fs::create_dir(&scans).unwrap();
    fs::write(scans.join("notes.txt"), "no volume").unwrap();
    fs::write(scans.join(".hidden.nrrd"), "no volume").unwrap();
    let header = "NRRD0004\ntype: uint8\ndimension: 3\nsizes: 9 9 9\nencoding: raw\n\n";
    let ball: Vec<u8> = (0..729_u32).map(|i| if (i % 9).abs_diff(4) < 3 { 200 } else { 0 }).collect();
    for name in ["a.nrrd", "b10.nrrd", "b9.nrrd"] {
        fs::write(scans.join(name), [header.as_bytes(), &ball].concat()).unwrap();
    }
    fs::write(scans.join("c.raw"), &ball).unwrap();
    fs::write(scans.join("c.nhdr"), header.replace("\n\n", "\ndata file: c.raw\n\n")).unwrap();
    let good = voxsplat(dir, "sheet scans -o sheet.png --size 96 --each small --json");
    assert!(good.status.success(), "{}", String::from_utf8_lossy(&good.stderr));
    let result: serde_json::Value = serde_json::from_str(&stdout(&good)).unwrap();
    let drawn: Vec<&str> = result["volumes"].as_array().unwrap().iter().map(|name| name.as_str().unwrap()).collect();
    // Samples beside a header are part of its volume.
    assert_eq!(drawn, ["scans/a.nrrd", "scans/b9.nrrd", "scans/b10.nrrd", "scans/c.nhdr"]);
    let small = Image::load(dir.join("small/b9.nrrd.png")).unwrap();
    assert_eq!([small.width(), small.height()], [96, 96]);
    assert!(small.pixels().iter().any(|pixel| pixel[0] > 0.1));
    let sheet = Image::load(dir.join("sheet.png")).unwrap();
    assert!(sheet.width() >= 2 * 96 && sheet.height() > 96);
    // A file alone gives its picture.
    assert!(voxsplat(dir, "sheet scans/b9.nrrd -o one.png --size 96").status.success());
    assert!(Image::load(dir.join("one.png")).unwrap() == small);
    // A broken file is named and left out; the others are there.
    fs::write(scans.join("broken.nrrd"), header).unwrap();
    let bad = voxsplat(dir, "sheet scans -o again.png --size 96");
    let said = complaints(&bad).join("; ");
    assert_eq!(bad.status.code(), Some(1), "{said}");
    let all = drawn.len() + 1;
    assert!(said.contains("scans/broken.nrrd: ") && said.contains(&format!("1 of {all} volumes cannot be drawn")));
    assert!(Image::load(dir.join("again.png")).unwrap().width() >= 96, "{said}");
}

#[test]
fn a_sheet_without_volumes_is_refused() {
    let dir = folder();
    let dir = dir.path();
    fs::create_dir(dir.join("empty")).unwrap();
    for (line, code, expected) in [
        ("sheet empty -o a.png", 1, "empty: there is no volume in this folder"),
        ("sheet none -o a.png", 1, "none: "),
        ("sheet empty", 2, "--output FILE.png or --each DIR is missing"),
        ("sheet empty -o a.exr", 2, "--output: a contact sheet is a .png"),
        ("sheet empty -o a.png --stats", 2, "--stats is for a picture of one volume"),
        ("sheet empty -o a.png --labels b.nrrd", 2, "--labels is for a picture of one volume"),
    ] {
        let output = voxsplat(dir, line);
        let said = complaint(&output);
        assert!(said.contains(expected) && output.status.code() == Some(code), "{line}: {said}");
    }
    assert!(!dir.join("a.png").exists());
}
