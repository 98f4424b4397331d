//! The program and the library make the same choices for a volume, and the same pixels.

use std::fs;
use std::path::Path;

use voxsplat::appearance::Choice;
use voxsplat::image::{Background, Image};
use voxsplat::program::{Values, load_channels};
use voxsplat::{Appearance, Frame, LoadOptions, load};

use crate::adapter::adapter;
use crate::cli::{folder, volume_file, voxsplat};
use crate::support::renderer;

/// A NRRD of 24^3 samples of i16.
fn nrrd(path: &Path, fields: &str, value: impl Fn(f64, [i32; 3]) -> i16) {
    let header =
        format!("NRRD0004\ntype: int16\ndimension: 3\nsizes: 24 24 24\n{fields}endian: little\nencoding: raw\n\n");
    let value = |i: i32| {
        let place = [i % 24, i / 24 % 24, i / 576];
        value(place.map(|p| (f64::from(p) - 11.5).powi(2)).iter().sum::<f64>().sqrt(), place)
    };
    let samples: Vec<u8> = (0..24 * 24 * 24).flat_map(|i| value(i).to_le_bytes()).collect();
    fs::write(path, [header.as_bytes(), &samples].concat()).unwrap();
}

#[test]
fn the_library_draws_channels_as_the_program_does() {
    let dir = folder();
    fs::copy(volume_file("several.ome.tif"), dir.path().join("several.ome.tif")).unwrap();
    let line = format!("render several.ome.tif -o program.png --size 48 --frame visible --adapter {}", adapter());
    let output = voxsplat(dir.path(), &line);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let source = dir.path().join("several.ome.tif");
    let loaded = load_channels(&source, &LoadOptions::default(), &[], Values::Open).unwrap();
    let look = Appearance::for_loaded(&source, &loaded).unwrap();
    assert!(look.choices.iter().any(|choice| choice.to_string() == "studio light because channels show surfaces"));
    let scene = renderer().prepare_layers(&look.layers, &look.settings).unwrap();
    let rendered = renderer().render(&scene, &Frame::new(&look.camera([48, 48]).unwrap(), &look.settings)).unwrap();
    rendered.image.save(dir.path().join("library.png"), Background::default()).unwrap();
    let [program, library] = ["program.png", "library.png"].map(|name| Image::load(dir.path().join(name)).unwrap());
    assert!(program == library && program.pixels().iter().any(|pixel| pixel[2] > 0.0));
}

/// The choices of the library for a volume, whose picture has the pixels of the program's.
fn choices(folder: &Path, source: &str) -> Vec<Choice> {
    let line = format!("render {source} -o program.png --size 48 --frame visible --adapter {}", adapter());
    let output = voxsplat(folder, &line);
    assert!(output.status.success(), "{source}: {}", String::from_utf8_lossy(&output.stderr));
    let named = if source.starts_with("demo:") { source.into() } else { folder.join(source) };
    let volume = load(&named, &LoadOptions::default()).unwrap();
    let look = Appearance::for_file(&named, &volume).unwrap();
    let scene = renderer().prepare_layers(&look.layers, &look.settings).unwrap();
    let rendered = renderer().render(&scene, &Frame::new(&look.camera([48, 48]).unwrap(), &look.settings)).unwrap();
    rendered.image.save(folder.join("library.png"), Background::default()).unwrap();
    let [program, library] =
        ["program.png", "library.png"].map(|name| Image::load(folder.join(name)).unwrap().pixels().to_vec());
    assert!(program.iter().any(|pixel| pixel[0] > 0.0) && program == library, "{source}");
    look.choices
}

#[test]
fn the_library_chooses_what_the_program_draws() {
    let dir = folder();
    let oriented = "space: left-posterior-superior\nspace directions: (1,0,0) (0,1,0) (0,0,1)\n\
                    kinds: domain domain domain\n";
    // Air, flesh and bone: Hounsfield units.
    let scan = |r: f64, _: [i32; 3]| {
        (-1000.0 + 1050.0 / (1.0 + (2.0 * (r - 10.0)).exp()) + 1200.0 / (1.0 + (r - 5.0).exp())) as i16
    };
    nrrd(&dir.path().join("scan.nrrd"), oriented, scan);
    nrrd(&dir.path().join("bare.nrrd"), "", scan);
    // A ball of four quarters.
    let quarter = |[x, y, _]: [i32; 3]| 1 + (x / 12 + 2 * (y / 12)) as i16;
    nrrd(&dir.path().join("labels.nrrd"), oriented, |r, place| if r > 9.0 { 0 } else { quarter(place) });
    let kinds = |source: &str| -> Vec<&str> {
        let name = |choice: &Choice| match choice {
            Choice::Preset { .. } => "preset",
            Choice::Labels { .. } => "labels",
            Choice::Side { .. } => "side",
            Choice::Light { .. } => "light",
            Choice::Sharpness(_) => "sharpness",
            _ => "another",
        };
        choices(dir.path(), source).iter().map(name).collect()
    };
    assert_eq!(kinds("scan.nrrd"), ["preset", "light", "sharpness"]);
    assert_eq!(kinds("bare.nrrd"), ["preset", "side", "light", "sharpness"]);
    assert_eq!(kinds("labels.nrrd"), ["labels", "light"]);
    let suggested = |name: &str| kinds(&format!("demo:{name}:24"));
    assert_eq!(suggested("nautilus"), ["side", "light", "sharpness"]);
    assert_eq!(suggested("vessels"), ["side", "light", "sharpness"]);
    assert_eq!(suggested("marschner-lobb"), ["side"]);
    assert_eq!(suggested("shepp-logan"), ["side"]);
    assert!(suggested("sphere").is_empty() && suggested("shell").is_empty());
}

/// A lattice of 24^3 samples in which a bar along y shows, which is thin from the front.
fn bar(dir: &Path) -> &'static str {
    let is_bar = |i: usize| (11..13).contains(&(i % 24)) && (2..22).contains(&(i / 24 % 24)) && i / 576 == 11;
    let samples: Vec<u8> = (0..24 * 24 * 24).map(|i| if is_bar(i) { 255 } else { 0 }).collect();
    fs::write(dir.join("bar.raw"), samples).unwrap();
    "bar.raw --dims 24,24,24 --type u8 --transfer gray --azimuth 0 --elevation 0"
}

#[test]
fn a_single_picture_fills_the_frame_and_a_series_has_one_size() {
    let dir = folder();
    let dir = dir.path();
    let bar = bar(dir);
    let run = |line: &str| {
        let output = voxsplat(dir, line);
        assert!(output.status.success(), "{line}: {}", String::from_utf8_lossy(&output.stderr));
    };
    let drawn = |line: &str, name: &str| {
        run(&format!("{line} --size 32 --reference"));
        Image::load(dir.join(name)).unwrap()
    };
    let covered = |image: &Image| image.pixels().iter().filter(|pixel| pixel[0] > 0.1).count();
    let alone = drawn(&format!("render {bar} -o a.png --save-scene s.json"), "a.png");
    let steady = drawn(&format!("render {bar} -o b.png --frame visible"), "b.png");
    assert!(covered(&alone) > 8 * covered(&steady), "{} {}", covered(&alone), covered(&steady));
    assert!(alone == drawn(&format!("render {bar} -o b.png --frame view"), "b.png"));
    // A saved scene draws the same picture, and keeps its steady frame as a turntable.
    assert!(alone == drawn("render s.json -o b.png", "b.png"));
    let film = "--frames 2 --turn 90 -o {frame}.png";
    for source in [bar, "s.json"] {
        assert!(steady == drawn(&format!("turntable {source} {film}"), "0000.png"), "{source}");
    }
    fs::write(dir.join("keys.json"), r#"[{"frame": 0, "azimuth": 0}, {"frame": 1, "azimuth": 90}]"#).unwrap();
    assert!(steady == drawn("turntable s.json --key-frames keys.json --frames 2 -o {frame}.png", "0000.png"));
    // A scene of several pictures is a series.
    let text = fs::read_to_string(dir.join("s.json")).unwrap();
    let scene = text.trim_end().trim_end_matches('}').trim_end();
    let outputs = |outputs: &str| format!("{scene}, \"outputs\": [{outputs}]}}");
    fs::write(dir.join("one.json"), outputs(r#"{"output": "c.png"}"#)).unwrap();
    fs::write(dir.join("two.json"), outputs(r#"{"output": "c.png"}, {"output": "d.png", "azimuth": 90}"#)).unwrap();
    assert!(alone == drawn("render one.json", "c.png") && steady == drawn("render two.json", "c.png"));
}

#[test]
fn the_first_picture_is_a_lit_nautilus_by_defaults_alone() {
    let readme = include_str!("../../../../README.md");
    let script = include_str!("../../../../examples/first-picture.sh");
    let first = readme.split("```sh\n").nth(1).and_then(|block| block.split_whitespace().nth(1));
    assert_eq!(first, Some("examples/first-picture.sh"));
    let line = script.lines().find_map(|line| line.strip_prefix("target/release/voxsplat ")).unwrap();
    assert_eq!(line, "render demo:nautilus -o \"$picture\"");
    // The same command on a small volume, in a small picture.
    let dir = folder();
    let line = line.replace("demo:nautilus", "demo:nautilus:96").replace("\"$picture\"", "a.png");
    let output = voxsplat(dir.path(), &format!("{line} --size 128 --adapter {}", adapter()));
    let said = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success() && said.contains("using --light studio because"), "{said}");
    assert!(said.ends_with("try next: voxsplat render FILE -o picture.png\n"), "{said}");
    let image = Image::load(dir.path().join("a.png")).unwrap();
    let bright = |pixel: &&[f32; 4]| pixel[0] > 0.5 && pixel[0] > pixel[2];
    let covered = image.pixels().iter().filter(|pixel| pixel[0] > 0.05).count();
    let warm = image.pixels().iter().filter(bright).count();
    // The shell fills more than a quarter of the picture, and a tenth of it is bright and warm.
    assert!(covered > 128 * 128 / 4 && warm > covered / 10, "{covered} {warm}");
}
