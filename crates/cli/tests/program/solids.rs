//! Meshes and depth buffers by the program.

use std::fs;
use std::path::Path;
use std::process::Output;

use voxsplat::image::{DepthMap, Image};

use crate::adapter::adapter;
use crate::cli::{complaint, folder, voxsplat};

/// A square across the view from the front, through the middle of a built-in volume of 24 voxels, at its left half.
fn square(dir: &Path) {
    let corners = ["-99 0 -99", "0 0 -99", "0 0 99", "-99 0 99"];
    let text: String = corners.iter().map(|corner| format!("v {corner}\n")).collect();
    fs::write(dir.join("square.obj"), text + "f 1 2 3 4\n").unwrap();
}

const VOLUME: &str = "render demo:sphere:24 --size 32 --azimuth 0 --elevation 0 --light off --target 0,0,0 \
                      --view-height 30";

/// Runs a command on the adapter of the tests.
fn run(dir: &Path, arguments: &str) -> Output {
    voxsplat(dir, &format!("{arguments} --adapter {}", adapter()))
}

/// The picture, and the text on stderr.
fn drawn(dir: &Path, options: &str) -> (Image, String) {
    let output = run(dir, &format!("{VOLUME} {options} -o a.exr"));
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(output.status.success(), "{options}: {said}");
    (Image::load(dir.join("a.exr")).unwrap(), said)
}

#[test]
fn a_mesh_hides_matter_and_has_a_color() {
    let dir = folder();
    let dir = dir.path();
    square(dir);
    let (plain, _) = drawn(dir, "");
    let (with_mesh, said) = drawn(dir, "--mesh square.obj:blue");
    assert!(!said.contains("--mesh"), "{said}");
    let (left, right) = (16 * 32 + 8, 16 * 32 + 24);
    let pixel = with_mesh.pixels()[left];
    assert!(pixel[3] == 1.0 && pixel[2] > plain.pixels()[left][2] + 0.1, "{pixel:?}");
    assert_eq!(with_mesh.pixels()[right], plain.pixels()[right]);
    // Its own depths: of the mesh, and of matter that is dense enough.
    let (depths, image) = DepthMap::load(dir.join("a.exr")).unwrap();
    assert_eq!(image.unwrap(), with_mesh);
    assert!(depths.depths()[left].abs() < 1e-4 || depths.depths()[left] < 0.0, "{}", depths.depths()[left]);
    // These depths hide the matter of another picture.
    fs::copy(dir.join("a.exr"), dir.join("solids.exr")).unwrap();
    let (again, _) = drawn(dir, "--depth solids.exr");
    assert_eq!(again.pixels()[left][3], 1.0);
    let (far, said) = drawn(dir, "--mesh square.obj --clip 0,0,1");
    assert!(said.is_empty() || !said.contains("note: --mesh"), "{said}");
    assert_eq!(far.pixels()[2 * 32 + 2][3], 1.0, "clips do not cut meshes");
    fs::write(dir.join("far.obj"), "v 500 0 0\nv 501 0 0\nv 500 0 1\nf 1 2 3\n").unwrap();
    let (_, said) = drawn(dir, "--mesh far.obj");
    assert!(said.contains("note: --mesh far.obj: it lies beside the volume"), "{said}");
}

#[test]
fn scenes_and_turntables_have_meshes() {
    let dir = folder();
    let dir = dir.path();
    square(dir);
    let (picture, _) = drawn(dir, "--mesh square.obj:#00f --save-scene scene.json");
    let output = run(dir, "render scene.json -o again.exr");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    assert_eq!(Image::load(dir.join("again.exr")).unwrap(), picture);
    let turn = VOLUME.replace("render", "turntable").replace("--azimuth 0", "").replace("--target 0,0,0 ", "");
    let output = run(dir, &format!("{turn} --mesh square.obj:blue --frames 2 -o frame-{{frame}}.png"));
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let frame = fs::read_dir(dir).unwrap().map(|entry| entry.unwrap().path());
    let frames: Vec<_> = frame.filter(|path| path.to_string_lossy().contains("frame-")).collect();
    assert_eq!(frames.len(), 2);
    assert!(Image::load(&frames[0]).unwrap().pixels()[16 * 32 + 8][2] > 0.3);
}

#[test]
fn solids_that_cannot_be_drawn_are_refused_in_one_line() {
    let dir = folder();
    let dir = dir.path();
    square(dir);
    fs::write(dir.join("bad.ply"), "ply\nformat ascii 1.0\nelement vertex 9\nend_header\n").unwrap();
    assert!(run(dir, &format!("{} -o a.exr", VOLUME.replace("32", "16"))).status.success());
    fs::rename(dir.join("a.exr"), dir.join("small.exr")).unwrap();
    for (options, code, words) in [
        ("--mesh none.ply", 1, "none.ply"),
        ("--mesh bad.ply", 1, "bad.ply: its element vertex has no property"),
        ("--mesh square.obj:bleu", 2, "a similar colour exists: blue"),
        ("--mesh square.obj --reference", 2, "--mesh: the reference draws no solids"),
        ("--depth square.obj", 1, "square.obj"),
        ("--depth small.exr", 1, "16 x 16 pixels, expected 32 x 32 as the picture has: --size 16x16"),
    ] {
        let output = run(dir, &format!("{VOLUME} --quiet {options} -o b.png"));
        let said = complaint(&output);
        assert_eq!(output.status.code(), Some(code), "{options}: {said}");
        assert!(said.contains(words), "{options}: {said}");
        assert!(!dir.join("b.png").exists(), "{options}");
    }
}
