//! The option `--iso`.

use std::path::Path;

use voxsplat::image::Image;

use crate::cli::{complaint, folder, voxsplat};

/// Renders a picture of a built-in volume.
fn drawn(dir: &Path, name: &str, options: &str) -> Image {
    let line = format!("render demo:nautilus:40 -o {name} --size 64 --light headlight {options}");
    let output = voxsplat(dir, &line);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    Image::load(dir.join(name)).unwrap()
}

#[test]
fn isosurfaces_have_their_colours_and_are_kept_by_scenes() {
    let dir = folder();
    let dir = dir.path();
    let shell =
        drawn(dir, "shell.png", "--iso 100:#ff0000 --save-scene shell.json --save-transfer shell-transfer.json");
    let covered = |image: &Image| image.pixels().iter().filter(|p| p[3] > 0.5).count();
    assert!(covered(&shell) > 300, "{}", covered(&shell));
    assert!(shell.pixels().iter().all(|p| p[3] < 0.5 || (p[0] >= p[1] && (p[1] - p[2]).abs() < 0.02)), "red alone");
    // A faint surface lets the inner one through.
    let faint = drawn(dir, "faint.png", "--iso 100:#ff0000:0.2 --iso 120:#0000ff");
    assert!(faint.pixels().iter().any(|p| p[2] > p[0] + 0.2) && covered(&faint) > 100);
    // The scene gives the same picture.
    assert!(voxsplat(dir, "render shell.json -o again.png").status.success());
    let again = Image::load(dir.join("again.png")).unwrap();
    assert!(again == shell, "of the scene");
    let by_file = "--transfer shell-transfer.json --shading post --painter cpu --sharpness 0.5 --save-scene file.json";
    let of_file = drawn(dir, "file.png", by_file);
    let is_alike = of_file.pixels().iter().zip(shell.pixels()).all(|(p, q)| p[3] == q[3]);
    assert!(is_alike, "the surfaces of the transfer function, in another material");
    // Beside a transfer function, which a scene holds with the surfaces.
    let options = "--transfer shell-transfer.json --iso 120:blue --sharpness 0.5 --save-scene both.json";
    let both = drawn(dir, "both.png", options);
    assert!(voxsplat(dir, "render both.json -o both-again.png").status.success());
    assert!(Image::load(dir.join("both-again.png")).unwrap() == both, "of both");
}

#[test]
fn what_draws_no_isosurfaces_says_so() {
    let dir = folder();
    let dir = dir.path();
    for (options, expected) in [
        ("--iso high", "expected VALUE, VALUE:COLOUR or VALUE:COLOUR:OPACITY"),
        ("--iso 1:nocolour", "expected VALUE, VALUE:COLOUR"),
        ("--iso 1:red:0", "opacities over 0 to 1"),
        ("--iso 1 --shading pre", "--shading pre: --iso is post-shaded"),
        ("--iso 1 --model mip", "--iso: model mip has no surfaces"),
        ("--iso 1 --painter quads", "--painter: quads draws no isosurfaces: use tiles or cpu"),
        ("--iso 1 --transfer labels", "--iso is for values, not for labels"),
        ("--iso 1 --mask a.nrrd", "--mask shows voxels, and --iso surfaces between them: leave out either"),
        (
            "--iso 1 --labels a.nrrd --shading post",
            "--shading post: labels and overlays in --iso are drawn voxel by voxel",
        ),
        ("--isovalue 1", "--iso VALUE"),
    ] {
        let output = voxsplat(dir, &format!("render demo:nautilus:16 -o a.png {options}"));
        let said = complaint(&output);
        assert!(said.contains(expected) && output.status.code() == Some(2), "{options}: {said}");
    }
    assert!(!dir.join("a.png").exists());
}
