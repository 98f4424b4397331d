//! Pictures in bricks by three commands.

use std::path::Path;
use std::process::{Command, Output};

use voxsplat::image::{Image, compare};

use crate::adapter::adapter;
use crate::cli::folder;

fn voxsplat(dir: &Path, arguments: &str) -> Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_voxsplat"));
    command.current_dir(dir).args(arguments.split_whitespace());
    let draws = arguments.starts_with("brick") || arguments.starts_with("render");
    if draws && !arguments.contains("cpu") {
        command.args(["--adapter", &adapter()]);
    }
    command.output().unwrap()
}

/// Runs a command that succeeds; returns its messages.
fn run(dir: &Path, arguments: &str) -> String {
    let output = voxsplat(dir, arguments);
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(output.status.success(), "{arguments}: {said}");
    said
}

/// Runs a command that fails with this code and one line that holds some words.
fn refused(dir: &Path, arguments: &str, code: i32, words: &str) {
    let output = voxsplat(dir, arguments);
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(code), "{arguments}: {said}");
    assert!(said.contains(words) && said.trim_end().lines().count() == 1, "{arguments}: {said}");
}

const LOOK: &str = "demo:vessels:20 --azimuth 30 --light off --size 40 --tune termination=0";
const TILES: &str = "demo:vessels:20 --azimuth 30 --light off --size 40 --tune termination=0 --painter tiles";

#[test]
fn three_commands_make_the_picture_of_render() {
    let dir = folder();
    let dir = dir.path();
    let said = run(dir, &format!("plan {TILES} --grid 1x2x2 -o plan.json"));
    let planned = "planned 4 bricks, numbers 0 to 3, by --painter tiles at --level 0, of up to ";
    assert!(said.contains(planned), "{said}");
    (0..4).for_each(|n| drop(run(dir, &format!("brick plan.json {n} -o part-{n}.exr"))));
    run(dir, "merge plan.json part-3.exr part-1.exr part-0.exr part-2.exr -o merged.exr");
    run(dir, "merge plan.json part-0.exr part-1.exr part-2.exr part-3.exr -o merged.png --background white");
    // Plans have one size for every azimuth.
    run(dir, &format!("render {TILES} --level 0 --frame visible -o whole.exr"));
    let [merged, whole] = ["merged.exr", "whole.exr"].map(|name| Image::load(dir.join(name)).unwrap());
    let apart = compare(&merged, &whole, 0.0).unwrap().max_channel;
    assert!(apart.iter().all(|&channel| channel < 1e-5), "{apart:?}");
    assert_eq!(Image::load(dir.join("merged.png")).unwrap().pixels()[0], [1.0; 4]);

    // Bricks in a row leave one partial picture.
    run(dir, "brick plan.json 1-3 -o row.exr");
    run(dir, "merge plan.json row.exr part-0.exr -o rows.exr");
    let apart = compare(&Image::load(dir.join("rows.exr")).unwrap(), &whole, 0.0).unwrap().max_channel;
    assert!(apart.iter().all(|&channel| channel < 1e-5), "{apart:?}");
    refused(dir, "merge plan.json row.exr part-0.exr part-2.exr -o a.png", 2, "parts: brick 2 is there twice");
    refused(dir, "brick plan.json 3-4 -o part-4.exr", 2, "N: 4, expected 0 to 3");
    refused(dir, "brick plan.json 3-1 -o part-4.exr", 2, "N or FIRST-LAST, bricks counted from 0");

    refused(dir, "brick plan.json 0 -o part.png", 2, "--output: part.png: expected the extension .exr");
    refused(
        dir,
        &format!("plan {TILES} --grid 1x2x2 -o plan.png"),
        2,
        "--output: plan.png: expected the extension .json",
    );
    refused(dir, "brick plan.json 4 -o part-4.exr", 2, "N: 4, expected 0 to 3");
    refused(dir, "merge plan.json part-0.exr part-1.exr part-3.exr -o a.png", 2, "parts: brick 2 is missing");
    refused(dir, "merge plan.json part-0.exr part-0.exr -o a.png", 2, "parts: brick 0 is there twice");
    refused(dir, "merge plan.json whole.exr -o a.png", 1, "whole.exr: no partial picture: it names no plan");
    let whole = std::fs::read(dir.join("part-0.exr")).unwrap();
    std::fs::write(dir.join("part-0.exr"), &whole[..whole.len() / 2]).unwrap();
    refused(dir, "merge plan.json part-0.exr -o a.png", 1, "part-0.exr: ");
    run(dir, &format!("plan {TILES} --grid 1x2x2 -o other.json --zoom 1.1"));
    refused(dir, "merge other.json part-1.exr -o a.png", 1, "part-1.exr: brick 1 belongs to another plan");
    assert!(!dir.join("a.png").exists() && !dir.join("part-4.exr").exists());
}

#[test]
fn the_processor_draws_bricks() {
    let dir = folder();
    let dir = dir.path();
    let look = format!("{LOOK} --shading post --painter cpu");
    let said = run(dir, &format!("plan {look} --grid 1x2x2 -o cpu.json"));
    assert!(said.contains("by --painter cpu at --level auto"), "{said}");
    run(dir, "brick cpu.json 0-1 -o cpu-0.exr");
    run(dir, "brick cpu.json 2-3 -o cpu-1.exr");
    run(dir, "merge cpu.json cpu-0.exr cpu-1.exr -o merged.exr");
    run(dir, &format!("render {look} --frame visible -o whole.exr"));
    let [merged, whole] = ["merged.exr", "whole.exr"].map(|name| Image::load(dir.join(name)).unwrap());
    let apart = compare(&merged, &whole, 0.0).unwrap().max_channel;
    assert!(whole.pixels().iter().any(|pixel| pixel[3] > 0.5) && apart.iter().all(|&c| c < 1e-5), "{apart:?}");
    refused(dir, "brick cpu.json 0 -o a.exr --adapter nosuch", 2, "--adapter: the plan is for the processor");
    let small = "demo:nautilus:40 --light off --azimuth 30 --size 90 --zoom 0.05 --painter cpu";
    let reason = "--grid: so small a picture has cells of level 2, and these bricks begin between cells of level";
    refused(dir, &format!("plan {small} -q --grid 3x1x1 -o a.json"), 2, reason);
    let mean = "demo:vessels:20 --shading post --light off --tune interslice=mean --painter cpu";
    refused(dir, &format!("plan {mean} -q --grid 1x1x2 -o a.json"), 2, "cpu classifies between samples");
}

#[test]
fn labels_are_drawn_in_bricks() {
    let dir = folder();
    let dir = dir.path();
    let header = "NRRD0004\ntype: uint8\ndimension: 3\nsizes: 16 16 16\nencoding: raw\nspacings: 1 1 1\n\n";
    let labels: Vec<u8> = (0..16 * 16 * 16_u32).map(|i| (i % 16 / 6 + i / 256 / 6) as u8).collect();
    std::fs::write(dir.join("labels.nrrd"), [header.as_bytes(), &labels].concat()).unwrap();
    let look = "labels.nrrd --transfer labels --light off --azimuth 30 --size 32 --tune termination=0 --painter tiles";
    run(dir, &format!("plan {look} --grid 2x1x1 -o plan.json"));
    (0..2).for_each(|n| drop(run(dir, &format!("brick plan.json {n} -o {n}.exr"))));
    run(dir, "merge plan.json 0.exr 1.exr -o merged.exr");
    run(dir, &format!("render {look} --frame visible -o whole.exr"));
    let [merged, whole] = ["merged.exr", "whole.exr"].map(|name| Image::load(dir.join(name)).unwrap());
    let apart = compare(&merged, &whole, 0.0).unwrap().max_channel;
    assert!(whole.pixels().iter().any(|pixel| pixel[3] > 0.5) && apart.iter().all(|&c| c < 1e-5), "{apart:?}");
}

#[test]
fn shadows_fall_from_brick_to_brick() {
    let dir = folder();
    let dir = dir.path();
    let look = "demo:vessels:80 --light studio --azimuth 30 --size 100 --tune termination=0 --painter cpu";
    let said = run(dir, &format!("plan {look} --grid 4x1x1 -o cpu.json"));
    assert!(said.contains("swept the light: keep cpu.light-0.exr and the others, "), "{said}");
    (0..4).for_each(|n| drop(run(dir, &format!("brick cpu.json {n} -o {n}.exr"))));
    run(dir, "merge cpu.json 0.exr 1.exr 2.exr 3.exr -o merged.exr");
    run(dir, &format!("render {look} --frame visible -o whole.exr"));
    run(dir, &format!("render {look} --shadows off --frame visible -o bright.exr"));
    let [merged, whole, bright] =
        ["merged.exr", "whole.exr", "bright.exr"].map(|name| Image::load(dir.join(name)).unwrap());
    let apart = |a: &Image| compare(a, &whole, 0.0).unwrap().max_channel;
    assert!(apart(&merged).iter().all(|&c| c < 1e-5), "{:?}", apart(&merged));
    assert!(apart(&bright).iter().any(|&c| c > 0.1), "{:?}", apart(&bright));
    // The light of another brick, and none.
    std::fs::copy(dir.join("cpu.light-1.exr"), dir.join("cpu.light-0.exr")).unwrap();
    let foreign = "cpu.light-0.exr: it enters brick 1 of this plan, expected brick 0 of this plan";
    refused(dir, "brick cpu.json 0 -o a.exr", 1, foreign);
    std::fs::remove_file(dir.join("cpu.light-0.exr")).unwrap();
    let missing = "cpu.light-0.exr: missing: voxsplat plan wrote it beside the plan, copy it there";
    refused(dir, "brick cpu.json 0-1 -o a.exr", 1, missing);
    let light = "--output: cpu.light-1.exr: it is the light that enters the brick";
    refused(dir, "brick cpu.json 1 -o cpu.light-1.exr", 2, light);
    assert!(!dir.join("a.exr").exists());
}

#[test]
fn pictures_that_bricks_cannot_make_are_refused() {
    let dir = folder();
    let dir = dir.path();
    let plan = |options: &str| format!("plan demo:vessels:20 -q --grid 1x1x2 -o plan.json {options}");
    let shadows = "--shadows: a device draws bricks without them: expected off, or --painter cpu";
    refused(dir, &plan("--light 40,30 --shadows on --painter tiles"), 2, shadows);
    refused(dir, &plan("--light studio --painter quads"), 2, shadows);
    let exact = "--shadows: bricks have no exact ones: expected on, off or a strength";
    refused(dir, &plan("--light 40,30 --shadows exact --painter cpu"), 2, exact);
    let occlusion = plan("--light 40,30 --occlusion 4 --painter tiles");
    refused(dir, &occlusion, 2, "--occlusion: a device draws bricks without it: expected off, or --painter cpu");
    refused(dir, &plan("--light off --scale-bar"), 2, "--scale-bar: a picture in bricks has no figure");
    refused(dir, &plan("--light off --reference"), 2, "--reference is for a picture, not for a plan of bricks");
    refused(dir, &plan("--light off --level 2"), 2, "--level: 2: bricks begin between cells of level 1 at most");
    refused(dir, "plan demo:vessels:20 --grid 1x1 -o plan.json", 2, "expected XxYxZ, such as 2x2x4");
    refused(
        dir,
        "plan demo:vessels:20 -q --light off --grid 30x1x1 -o p.json",
        2,
        "--grid: 30 chunks along x, expected 1",
    );
    std::fs::write(dir.join("scene.json"), "{}").unwrap();
    refused(dir, "brick scene.json 0 -o a.exr", 1, "scene.json: no plan: line 1 column 2: ");
    // Light that plan chooses by itself has no shadows.
    let said = run(dir, "plan demo:shell:20 --grid 1x1x2 -o plan.json --light studio --shadows off --occlusion off");
    assert!(said.contains("planned 2 bricks"), "{said}");
}
