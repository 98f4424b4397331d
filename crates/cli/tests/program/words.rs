//! What the program says: of options without effect, of wrong command lines, of numbers.

use std::path::Path;

use serde_json::{Map, Value, json};
use voxsplat::Volume;
use voxsplat::formats::{LoadOptions, MissingSlices, load};
use voxsplat::image::Image;

use crate::cli::{complaint, complaints, folder, refused, stdout, voxsplat};

/// The notes of a run, without the driver's lines.
fn notes(dir: &Path, line: &str) -> Vec<String> {
    let stderr = String::from_utf8(voxsplat(dir, line).stderr).unwrap();
    stderr.lines().filter_map(|line| line.strip_prefix("voxsplat: note: ")).map(str::to_owned).collect()
}

/// A scene of the options of a command line.
fn scene(options: &str) -> String {
    let mut scene = Map::from_iter([("volume".to_owned(), json!("a.nrrd"))]);
    let words: Vec<&str> = options.split_whitespace().collect();
    for (at, name) in words.iter().enumerate().filter(|(_, word)| word.starts_with("--")) {
        let value = words.get(at + 1).filter(|word| !word.starts_with("--"));
        scene.insert(name[2..].to_owned(), value.map_or(Value::Bool(true), |value| json!(value)));
    }
    Value::Object(scene).to_string()
}

#[test]
fn options_without_effect_are_noted_on_command_lines_and_in_scenes() {
    // The volume is none, so nothing is drawn; notes come before it is read.
    let dir = folder();
    std::fs::write(dir.path().join("a.nrrd"), "no volume").unwrap();
    for (options, option) in [
        ("--output a.png --margin 0.1 --view-height 5", "margin"),
        ("--output a.png --margin 0.1 --projection perspective --distance 5", "margin"),
        ("--output a.png --frame view --view-height 5 --target 1,2,3", "frame"),
        ("--output a.png --tune interslice=mean", "tune interslice"),
        ("--output a.png --model mip --tune interslice=mean", "tune interslice"),
        ("--output a.png --model mip --shading post", "shading"),
        ("--output a.png --model average --shading post", "shading"),
        ("--output a.png --model mip --tune termination=0.01", "tune termination"),
        ("--output a.png --model xray --tune termination=0.01", "tune termination"),
        ("--output a.png --reference --tune termination=0.01", "tune termination"),
        ("--output a.png --reference --painter quads", "painter"),
        ("--output a.png --reference --level 1", "level"),
        ("--output a.png --reference --adapter any", "adapter"),
        ("--output a.png --model xray --tune sheet-thickness=2", "tune sheet-thickness"),
        ("--output a.exr --background white", "background"),
        ("--output a.png --series 2", "series"),
        ("--output a.png --missing-slices interpolate", "missing-slices"),
        ("--output a.png --tune sample=100", "tune sample"),
    ] {
        let expected = format!("--{option} has no effect ");
        let said = notes(dir.path(), &format!("render a.nrrd {options}"));
        assert!(matches!(&said[..], [note] if note.starts_with(&expected)), "{options}: {said:?}");
        assert!(notes(dir.path(), &format!("render --quiet a.nrrd {options}")).is_empty(), "{options}");
        std::fs::write(dir.path().join("s.json"), scene(options)).unwrap();
        assert_eq!(notes(dir.path(), "render s.json"), said, "{options}");
    }
    std::fs::write(dir.path().join("k.json"), r#"[{"frame": 0, "zoom": 2}, {"frame": 9, "azimuth": 1}]"#).unwrap();
    let keys = "--key-frames k.json --azimuth 3 --elevation 4 --roll 5 --zoom 6";
    let said = notes(dir.path(), &format!("turntable a.nrrd -o a.gif {keys}"));
    let expected = ["azimuth", "zoom"].map(|name| format!("--{name} has no effect because key frames set it"));
    assert_eq!(said, expected);
    let frames = notes(dir.path(), "turntable a.nrrd -o {frame}.png --rate 3");
    assert!(frames[0].starts_with("--rate has no effect "), "{frames:?}");
    let study = notes(dir.path(), "pareto a.nrrd -o report --margin 0.1 --view-height 3");
    assert!(study[0].starts_with("--margin has no effect "), "{study:?}");
    for options in [
        "--margin 0.1",
        "--tune termination=0.01",
        "--tune sample=100 --verify",
        "--tune interslice=mean --shading post",
        "--background white --output b.png",
        "--tune sheet-thickness=2",
    ] {
        assert!(notes(dir.path(), &format!("render a.nrrd --output a.png {options}")).is_empty(), "{options}");
    }
    let described = notes(dir.path(), "info a.nrrd --series 2");
    assert!(described[0].starts_with("--series has no effect "), "{described:?}");
    // The frames of one file of DICOM are slices.
    let data = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/data/volumes");
    std::fs::copy(data.join("enhanced-i16.dcm"), dir.path().join("frames.dcm")).unwrap();
    assert!(notes(dir.path(), "info frames.dcm --missing-slices interpolate").is_empty());
    // Folders that hold no series.
    for (folder, file, to) in [
        ("sections", "section-8.tiff", "section-8.tiff"),
        ("slices", "ct-a.dcm", "ct-a.dcm"),
        ("v.zarr", "", ".zgroup"),
    ] {
        std::fs::create_dir(dir.path().join(folder)).unwrap();
        match file {
            "" => std::fs::write(dir.path().join(folder).join(to), "{}").unwrap(),
            file => drop(std::fs::copy(data.join(file), dir.path().join(folder).join(to)).unwrap()),
        }
        for option in ["--series 1", "--missing-slices interpolate"] {
            for command in ["info", "render -o a.png --size 8 --reference --transfer gray"] {
                let said = notes(dir.path(), &format!("{command} {folder} {option}"));
                let noted = said.iter().filter(|note| note.contains(" has no effect because only ")).count();
                assert_eq!(noted, usize::from(folder != "slices"), "{command} {folder} {option}: {said:?}");
            }
        }
    }
    assert_eq!(notes(dir.path(), "pareto demo:sphere:0 -o report --tune stream-over=3").len(), 1);
    // Whether there is a pyramid is known when the volume is read.
    let said = notes(dir.path(), "render demo:sphere:8 -o a.png --size 8 --reference --pyramid 2");
    assert_eq!(said[0], "--pyramid has no effect because the volume has one level");
    assert_eq!(notes(dir.path(), "info demo:sphere:8 --pyramid 2"), said[..1]);
}

#[test]
fn options_that_are_noted_change_no_pixel() {
    let dir = folder();
    let drawn = |options: &str| {
        let line =
            format!("render demo:vessels:16 --size 32 -o a.png {options} --adapter {}", crate::adapter::adapter());
        let output = voxsplat(dir.path(), &line);
        let said = String::from_utf8(output.stderr).unwrap();
        assert!(output.status.success(), "{options}: {said}");
        (Image::load(dir.path().join("a.png")).unwrap(), said.matches(" has no effect ").count())
    };
    for (base, option) in [
        ("--view-height 12", "--margin 0.3"),
        ("--projection perspective --distance 30", "--margin 0.3"),
        ("--view-height 12 --target 7,7,7", "--frame view"),
        ("", "--tune interslice=mean"),
        ("--model mip", "--tune interslice=mean"),
        ("--model minip --painter tiles", "--tune termination=0.5"),
        ("--model minip --painter quads", "--tune termination=0.5"),
        ("--model xray --painter tiles", "--tune termination=0.5"),
        ("--model xray --painter quads", "--tune termination=0.5"),
        ("--model average", "--shading post"),
        ("--model xray --painter quads", "--tune sheet-thickness=0.3"),
        ("", "--tune sample=100"),
    ] {
        let (without, with) = (drawn(base), drawn(&format!("{base} {option}")));
        assert_eq!((without.1, with.1), (0, 1), "{base} {option}");
        assert!(without.0 == with.0, "{base} {option}");
    }
    assert!(drawn("--shading post").0 != drawn("--shading post --tune interslice=mean").0);
}

/// Asserts that a command line is refused before anything is written, with a line for each part.
fn all_refused(line: &str, parts: &[&str]) {
    let dir = folder();
    let output = voxsplat(dir.path(), line);
    let said = complaints(&output);
    assert_eq!((output.status.code(), said.len()), (Some(2), parts.len()), "{line}: {said:#?}");
    for part in parts {
        assert_eq!(said.iter().filter(|said| said.contains(part)).count(), 1, "{line}: {part}: {said:#?}");
    }
    assert_eq!(std::fs::read_dir(dir.path()).unwrap().count(), 0, "{line} left a file");
}

#[test]
fn contradictions_are_refused_all_at_once() {
    for (options, reasons) in [
        ("--model mip --shading pre", &["--shading pre: projections of intensity"][..]),
        ("--projection perspective --fov 30 --view-height 5 --distance 9", &["--fov: --view-height and --distance"]),
        ("--shadows on --material 0,1,0,1", &["--shadows needs --light", "--material needs --light"]),
        ("--painter tiles --tune sheets=axis,precision=f16", &["--tune sheets is a knob of quads", "precision is a"]),
        ("--painter cpu --tune table-error=0.01", &["--tune table-error is a knob of quads, not of cpu"]),
        ("--label 1:on --window 1,2 --transfer gray", &["--label needs"]),
        ("--label all:x0.5 --label-table a --transfer gray", &["--label needs", "--label-table needs"]),
        ("--units length=mm,value=HU", &["--units length=.. needs --scale-bar"]),
        ("--light @1,2,3 --shadows on --light-size 5", &["--light-size: a light at a place is a point"]),
        ("--light 10,20 --light-size 5", &["--light-size shows in shadows alone"]),
        ("--light headlight --tune shadow-bias=2", &["--tune shadow-bias acts on shadows and occlusion only"]),
    ] {
        all_refused(&format!("render demo:sphere -o a.png {options}"), reasons);
    }
}

#[test]
fn errors_of_a_command_line_come_together_and_name_what_was_typed() {
    for (line, parts) in [
        ("render scna.nii.gz", &["cannot read scna.nii.gz: ", "--output FILE is missing"][..]),
        ("render scna.nii.gz --azimut 3", &["cannot read scna.nii.gz: ", "'--azimuth'"]),
        ("render scna.nii.gz -o a.png --azimuth left", &["cannot read scna.nii.gz: ", "expected a finite number"]),
        ("turntable scna.nii.gz", &["cannot read scna.nii.gz: ", "--output is missing"]),
        ("render a.nii --threshold 200", &["cannot read a.nii: ", "'--threshold' found: --window"]),
        ("render a.nii --slice 3", &["cannot read a.nii: ", "'--slice' found: voxsplat slice draws sections, --plane"]),
        ("render demo:sphere:8 -o a.png --clip voxels:0:9,:,:", &["--clip: voxels 0:9 along x"]),
        (
            "render demo:sphere:8 -o a.png --labels demo:sphere:8 --label all:x2",
            &["'all:x2' for '--label <WHICH:LOOK>'"],
        ),
        ("render demo:sphere:8 -o a.png --transfer labels --color-bar", &["--color-bar is for transfer functions"]),
        ("render -q demo:sphere:8 -o a.png --mask demo:marschner-lobb", &["--mask: value "]),
        ("turntable demo:sphere:8 -o x.mp4", &["voxsplat turntable demo:sphere:8 -o - | ffmpeg -i - "]),
        ("turntable demo:sphere:8 -o x.mp4", &["-pix_fmt yuv420p x.mp4"]),
        ("render scna.nii.gz --azimut 3 --size 0x --wobble", &["scna.nii.gz: ", "'--azimuth'", "0x", "'--wobble'"]),
    ] {
        all_refused(line, parts);
    }
    let dir = folder();
    let said = complaint(&voxsplat(dir.path(), "render demo:sphere --wobble"));
    assert!(!said.contains("tip"), "{said}");
}

#[test]
fn inputs_say_where_and_how_they_are_wrong() {
    let dir = folder();
    let keys = "turntable demo:sphere:8 -o a.gif --key-frames f.json";
    let transfer = "render demo:sphere:8 -o a.png --transfer f.json";
    let rivals = "pareto demo:sphere:8 -o report --rivals f.json";
    let labels = "render demo:sphere:8 -o a.png --reference --size 8 --light off --labels f.json";
    for (line, text, reason) in [
        (keys, r#"[{"frame": 1, "azimut": 3}]"#, "f.json: line 1 column 22: unknown field `azimut`"),
        (keys, r#"[{"frame": -1}]"#, "line 1 column 13: integer `-1`, expected a whole number, 0 or over"),
        (keys, r#"{"frame": 1}"#, "line 1 column 0: an object, expected a list"),
        (keys, "[]", "f.json: has no key frames"),
        (keys, "\n", "f.json: is empty"),
        (rivals, "{}", "line 1 column 0: an object, expected a list"),
        (rivals, "[\n{}]", "line 2 column 2: missing field `name`"),
        (
            "render f.json -o a.png",
            "[1]",
            "no scene, which is a JSON object: line 1 column 0: a list, expected an object",
        ),
        ("render f.json -o a.png", "{\"size\": 3\n\"zoom\": 2}", "line 2 column 1: expected `,` or `}`"),
        ("render f.json -o a.png", "", "f.json: is empty"),
        (transfer, "hello", "f.json: line 1: \"hello\", expected JSON, XML or a line with a number"),
        (transfer, "{\"points\": [", "line 1 column 12: the text ends within a list"),
        // What the file says stays as it is.
        (transfer, r#"{"points": [{"value": "a map, sequence"}]}"#, "string \"a map, sequence\", expected a number"),
        (labels, "hello", "f.json: is of no format that is read: DICOM, NRRD,"),
    ] {
        std::fs::write(dir.path().join("f.json"), text).unwrap();
        let output = voxsplat(dir.path(), line);
        let said = complaint(&output);
        assert!(said.contains(reason) && !said.contains("--dims"), "{line}: {said}");
        assert_eq!(output.status.code(), Some(1), "{line}: {said}");
    }
    // Bare samples of another size.
    std::fs::write(dir.path().join("a.raw"), (0..12).collect::<Vec<u8>>()).unwrap();
    let said = complaint(&voxsplat(dir.path(), "info a.raw --dims 3,3,3 --type i16"));
    assert_eq!(said, "a.raw: has 12 bytes, and 3 x 3 x 3 samples of i16 need 54");
    let said = notes(dir.path(), "render a.raw --dims 2,2,2 --type u8 -o a.png --reference --size 8 --transfer gray");
    assert!(said.iter().any(|note| note == "2 x 2 x 2 samples of u8 leave 4 bytes at the end of the file"), "{said:?}");
}

#[test]
fn numbers_have_few_digits_and_units_that_fit() {
    let dir = folder();
    let values = [2.865_797_863_180_417e-31_f64, 0.0, 1e-31, 2e-31].map(f64::to_le_bytes).concat();
    std::fs::write(dir.path().join("a.raw"), values).unwrap();
    let text = stdout(&voxsplat(dir.path(), "info a.raw --dims 2,2,1 --type f64"));
    assert!(text.contains("0 to 2.8658e-31") && !text.contains("0.00000"), "{text}");
    std::fs::write(dir.path().join("b.raw"), [7; 4913]).unwrap();
    let input = "b.raw --dims 17,17,17 --type u8 --spacing 10,10,10";
    let text = stdout(&voxsplat(dir.path(), &format!("info {input} --labels")));
    assert!(text.lines().any(|line| line.ends_with(" 4913000")) && !text.contains("e6"), "{text}");
}

#[test]
fn a_turntable_tells_totals_and_keeps_folders_private() {
    let dir = folder();
    let input = dir.path().join("private folder").join("ball.nrrd");
    std::fs::create_dir(input.parent().unwrap()).unwrap();
    std::fs::write(
        &input,
        b"NRRD0004\ntype: uint8\ndimension: 3\nsizes: 4 3 2\nspacings: 1 1 1\nencoding: raw\n\n"
            .iter()
            .copied()
            .chain(0..24)
            .collect::<Vec<u8>>(),
    )
    .unwrap();
    let mut command = std::process::Command::new(env!("CARGO_BIN_EXE_voxsplat"));
    command.current_dir(dir.path()).arg("turntable").arg(&input);
    command.args("--frames 3 --size 128 --reference --transfer gray --stats json --caption Ball -o".split(' '));
    let output = command.arg(dir.path().join("a.html")).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let totals: Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!((&totals["frames"], &totals["size"]), (&json!(3), &json!([128, 128])));
    assert!(totals["seconds"].as_f64() >= totals["seconds_per_frame"].as_f64());
    let page = std::fs::read_to_string(dir.path().join("a.html")).unwrap();
    assert!(page.contains("<title>ball.nrrd: Ball</title>"));
    assert!(page.contains("turntable ball.nrrd ") && page.contains("-o a.html"));
    assert!(!page.contains("private") && !page.contains(dir.path().to_str().unwrap()));
    let line = "turntable demo:sphere:8 --frames 2 --size 8 --reference -o {frame}.png --stats";
    let text = stdout(&voxsplat(dir.path(), line));
    assert!(text.starts_with("2 frames of 8 x 8 px in ") && text.lines().count() == 1, "{text}");
    refused("turntable demo:sphere:8 --frames 2 -o - --stats", 2, "--stats: standard output takes the film");
}

#[test]
fn missing_slices_are_named_by_their_place_and_interpolated_on_request() {
    let data = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/data/volumes");
    let dir = folder();
    let series = dir.path().join("series");
    std::fs::create_dir(&series).unwrap();
    // In the order of their positions: c, e, b, a, d.
    for name in ["ct-a.dcm", "ct-b.dcm", "ct-c.dcm", "ct-d.dcm", "ct-e.dcm"] {
        std::fs::copy(data.join(name), series.join(name)).unwrap();
    }
    let whole = load(&series, &LoadOptions::default()).unwrap();
    std::fs::remove_file(series.join("ct-b.dcm")).unwrap();
    let place = whole.grid().to_world().transform_point3(glam::DVec3::new(0.0, 0.0, 2.0));
    let said = complaint(&voxsplat(dir.path(), "info series"));
    let at = said.split(" at ").nth(1).and_then(|rest| rest.split(':').next()).unwrap();
    let at: Vec<f64> = at.split(',').map(|number| number.parse().unwrap()).collect();
    assert!(place.distance(glam::DVec3::from_slice(&at)) < 1e-3, "{said} {place}");
    assert!(said.contains("1 slice is missing between ct-e.dcm and ct-a.dcm, at "), "{said}");
    assert!(said.ends_with("interpolate them with --missing-slices interpolate"), "{said}");
    let text = stdout(&voxsplat(dir.path(), "info series --missing-slices interpolate"));
    assert!(text.contains("note ") && text.contains(": interpolated between their neighbours"), "{text}");

    let options = LoadOptions { missing_slices: MissingSlices::Interpolate, ..LoadOptions::default() };
    let filled = load(&series, &options).unwrap();
    assert_eq!(filled.grid().dims(), whole.grid().dims());
    let [x, y, _] = whole.grid().dims();
    let area = (x * y) as usize;
    let slice = |volume: &Volume, k: usize| -> Vec<f64> {
        let samples = volume.in_memory().unwrap();
        (k * area..(k + 1) * area).map(|index| samples.value(index)).collect()
    };
    for k in [0, 1, 3, 4] {
        assert_eq!(slice(&filled, k), slice(&whole, k), "{k}");
    }
    let [before, here, after] = [1, 2, 3].map(|k| slice(&filled, k));
    let near = |n: usize| (here[n] - (before[n] + after[n]) / 2.0).abs() <= 0.5;
    assert!((0..area).all(near) && here != before && here != after);
}

#[test]
fn options_that_hide_all_or_name_nothing_are_noted() {
    let dir = folder();
    let render = |options: &str| notes(dir.path(), &format!("render {options} -o a.png --size 16"));
    let has = |said: &[String], part: &str| said.iter().any(|note| note.contains(part));
    let clipped = render("demo:sphere:8 --clip box:100,101,100,101,100,101");
    assert!(has(&clipped, "the picture is empty because nothing in view is visible"), "{clipped:?}");
    assert!(!has(&render("demo:sphere:8"), "the picture is empty"));
    std::fs::write(dir.path().join("l_4x4x4_uint8.raw"), [1; 64]).unwrap();
    let labelled = |label: &str| render(&format!("l_4x4x4_uint8.raw --transfer labels --label {label}"));
    let absent = labelled("99:red");
    assert!(has(&absent, "the look of 99 has no effect because no voxel has such a label"), "{absent:?}");
    let unnamed = labelled("nosuch:0.5");
    assert!(has(&unnamed, "the look of \"nosuch\" has no effect because no label has this name"), "{unnamed:?}");
    assert!(!has(&labelled("1-3:red"), "has no effect"));
    std::fs::write(dir.path().join("grey.raw"), (0..512_u16).flat_map(u16::to_le_bytes).collect::<Vec<u8>>()).unwrap();
    let grey = notes(dir.path(), "info grey.raw --dims 8,8,8 --type uint16 --labels");
    assert!(has(&grey, "so many labels may be grey values"), "{grey:?}");
}

#[test]
fn near_misses_of_files_say_what_was_expected() {
    let dir = folder();
    let said = |line: &str| complaints(&voxsplat(dir.path(), line)).join("; ");
    std::fs::write(dir.path().join("ct_4_4_4.raw"), [1; 64]).unwrap();
    let named = said("info ct_4_4_4.raw --type uint8");
    assert!(named.contains("its name may mean 4 x 4 x 4 samples"), "{named}");
    std::fs::write(dir.path().join("w_4x4x4_uint8.raw"), [1; 128]).unwrap();
    let wide = stdout(&voxsplat(dir.path(), "info w_4x4x4_uint8.raw"));
    assert!(wide.contains("leave 64 bytes at the end of the file: they fit samples of 2 bytes"), "{wide}");
    let uniform = said("render w_4x4x4_uint8.raw --transfer mri -o a.png");
    assert!(uniform.contains("all values are 1: give a file of control points"), "{uniform}");
    voxsplat(dir.path(), "plan demo:sphere:8 --grid 1x1x2 -o plan.json");
    voxsplat(dir.path(), "render demo:sphere:8 --size 8 -o a.png");
    let merged = said("merge plan.json a.png -o b.png");
    assert!(merged.contains("a.png: no partial picture: expected OpenEXR that voxsplat brick wrote"), "{merged}");
}

#[test]
fn an_empty_picture_has_no_error_to_verify() {
    let dir = folder();
    std::fs::write(dir.path().join("a.raw"), (0..64).collect::<Vec<u8>>()).unwrap();
    let clear = json!({"points": [{"value": 0, "color": "#ffffff", "opacity": 0}]});
    std::fs::write(dir.path().join("t.json"), clear.to_string()).unwrap();
    let line = "render a.raw --dims 4,4,4 --type u8 -o a.png --size 8 --transfer t.json --verify --adapter";
    let output = voxsplat(dir.path(), &format!("{line} {}", crate::adapter::adapter()));
    let said = String::from_utf8(output.stderr).unwrap();
    assert!(said.contains("verified: no traced pixel shows anything") && !said.contains("-0.0"), "{said}");
}

#[test]
fn old_spellings_are_refused_with_the_new_ones() {
    let old = [
        ("colour-map", "viridis", "--transfer map:NAME"),
        ("color-map", "viridis", "--transfer map:NAME"),
        ("clip-box", "0,1,0,1,0,1", "--clip box:X0,X1,Y0,Y1,Z0,Z1"),
        ("crop", "1:2,:,:", "--clip voxels:I0:I1,J0:J1,K0:K1"),
        ("length-unit", "mm", "--units length=UNIT"),
        ("value-unit", "HU", "--units value=UNIT"),
        ("label-opacity", "0.5", "--label all:xF"),
        ("sheets", "axis", "--tune sheets=VALUE"),
        ("accumulate", "additive", "--tune accumulate=VALUE"),
        ("sheet-thickness", "2", "--tune sheet-thickness=VALUE"),
        ("precision", "f16", "--tune precision=VALUE"),
        ("table-error", "1e-3", "--tune table-error=VALUE"),
        ("interslice", "mean", "--tune interslice=VALUE"),
        ("normalization", "peak", "--tune normalization=VALUE"),
        ("termination", "0", "--tune termination=VALUE"),
        ("antialiasing", "off", "--tune antialiasing=VALUE"),
        ("shadow-bias", "2", "--tune shadow-bias=VALUE"),
        ("sample", "100", "--tune sample=VALUE"),
        ("stream-over", "3", "--tune stream-over=VALUE"),
        ("footprint-table", "64x8", "the option is removed; --tune table-error=E"),
        ("sheets-per-pass", "4", "the option is removed; the adapter's best number is used"),
    ];
    let dir = folder();
    for (name, value, new) in old {
        let expected = format!("unexpected argument '--{name}' found: {new}");
        refused(&format!("render demo:sphere:8 -o a.png --{name} {value}"), 2, &expected);
        let scene = json!({"volume": "demo:sphere:8", name: value});
        std::fs::write(dir.path().join("s.json"), scene.to_string()).unwrap();
        let output = voxsplat(dir.path(), "render s.json -o a.png");
        let said = complaint(&output);
        assert!(output.status.code() == Some(2) && said.contains(&expected), "{said}");
    }
}

#[test]
fn knobs_are_listed_and_their_errors_are_one_line_each() {
    let dir = folder();
    for line in ["render --tune help", "turntable a.nii --tune=help", "pareto a.nii -o b --tune help"] {
        let output = voxsplat(dir.path(), line);
        assert!(output.status.success() && output.stderr.is_empty(), "{line}");
        let text = stdout(&output);
        for part in ["--tune sheets=axis,accumulate=additive", "  sheets=image|axis\n", "sample=PIXELS"] {
            assert!(text.contains(part), "{line}: {text}");
        }
    }
    let line = "render demo:sphere:8 -o a.png --tune";
    refused(&format!("{line} sheet=axis"), 2, "no key \"sheet\", expected one of sheets, accumulate, ");
    refused(&format!("{line} sheets=box"), 2, "sheets: \"box\", expected image or axis");
    refused(&format!("{line} axis"), 2, "expected KEY=VALUE; --tune help lists the keys");
    refused(&format!("{line} termination=2"), 2, "--tune termination: ");
    all_refused(
        "render demo:sphere:8 -o a.png --tune sheet=axis --tune precision=f64",
        &["no key \"sheet\"", "precision: \"f64\", expected f16 or f32"],
    );
    refused("info demo:sphere:8 --tune help", 2, "unexpected argument '--tune'");
}

#[test]
fn knobs_of_the_command_line_go_with_the_ones_of_a_scene() {
    let dir = folder();
    let scene = json!({"volume": "demo:vessels:12", "size": 16, "frame": "volume",
        "tune": ["antialiasing=off", "normalization=peak"]});
    std::fs::write(dir.path().join("s.json"), scene.to_string()).unwrap();
    let drawn = |line: &str| {
        let output = voxsplat(dir.path(), &format!("render {line} --reference -o a.png"));
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        Image::load(dir.path().join("a.png")).unwrap()
    };
    let plain = "demo:vessels:12 --size 16 --frame volume --tune";
    let both = drawn("s.json --tune normalization=unit");
    assert!(both == drawn(&format!("{plain} antialiasing=off")) && both != drawn("s.json"));
    assert!(drawn("s.json") == drawn(&format!("{plain} normalization=peak,antialiasing=off")));
}

#[test]
fn short_help_lists_few_options_and_long_help_all() {
    let dir = folder();
    let count = |flag: &str| {
        let text = stdout(&voxsplat(dir.path(), &format!("render {flag}")));
        // Descriptions are indented by ten.
        let is_option = |line: &&str| line.trim_start().starts_with('-') && !line.starts_with("          ");
        let options: Vec<&str> = text.lines().filter(is_option).collect();
        assert!(options.iter().any(|line| line.contains("--output <FILE>")), "{text}");
        options.len() - 2
    };
    let (brief, all) = (count("-h"), count("--help"));
    assert!((15..=25).contains(&brief), "-h lists {brief} options");
    // The last ones are --overlay, --mesh and --depth: no other option draws a second volume of values, or a surface.
    // --json is an option of every command, as --quiet is. No other option than --complex chooses a number of complex
    // samples. --classification and --normals change how voxels are classified and lit. --iso draws surfaces,
    // --plane sections.
    // --fetch-limit is for urls: no other option bounds a size.
    assert!((50..=77).contains(&all), "--help lists {all} options");
}

/// The help of every command, short and long, at a width of the terminal.
fn help(dir: &Path, columns: Option<&str>) -> Vec<String> {
    let run = |line: &str| {
        let mut command = std::process::Command::new(env!("CARGO_BIN_EXE_voxsplat"));
        command.current_dir(dir).args(line.split_whitespace()).env_remove("COLUMNS");
        let output = command.envs(columns.map(|columns| ("COLUMNS", columns))).output().unwrap();
        String::from_utf8(output.stdout).unwrap()
    };
    let program = run("--help");
    let commands = program.split("Commands:\n").nth(1).unwrap().lines().take_while(|line| !line.is_empty());
    let names: Vec<&str> = commands.filter_map(|line| line.split_whitespace().next()).collect();
    let lines = names.iter().flat_map(|name| [format!("{name} --help"), format!("{name} -h")]);
    lines.map(|line| run(&line)).chain([program.clone()]).collect()
}

#[test]
fn help_is_wrapped_once() {
    let dir = folder();
    for (columns, width) in [(None, 100), (Some("80"), 80), (Some("100"), 100), (Some("120"), 100)] {
        for text in help(dir.path(), columns) {
            let lines: Vec<&str> = text.lines().collect();
            for pair in lines.windows(2) {
                let indent = |line: &str| line.len() - line.trim_start().len();
                let [line, next] = [pair[0], pair[1]];
                assert!(line.chars().count() <= width || line.contains("voxsplat "), "{columns:?}: {line}");
                // The first word of the next line of a paragraph did not fit.
                let is_text = |line: &str| indent(line) == 0 && line.contains(' ') && !line.ends_with(':');
                let word = next.split(' ').next().unwrap_or_default();
                let had_room = line.chars().count() + 1 + word.chars().count() <= width;
                assert!(!(is_text(line) && is_text(next) && had_room), "{columns:?}: {line:?} {next:?}");
            }
        }
    }
}

#[test]
fn the_program_has_one_name() {
    let dir = folder();
    for line in ["--version", "man", "man render", "man compare", "render --help"] {
        let text = stdout(&voxsplat(dir.path(), line));
        assert!(text.contains("voxsplat") && !text.replace('\\', "").contains("voxsplat-cli"), "{line}: {text}");
    }
    let version = concat!("voxsplat ", env!("CARGO_PKG_VERSION"), "\n");
    assert_eq!(stdout(&voxsplat(dir.path(), "--version")), version);
}

#[test]
fn shells_complete_values_and_files_for_paths_alone() {
    let dir = folder();
    let script = |shell: &str| stdout(&voxsplat(dir.path(), &format!("completions {shell}")));
    let bash = script("bash");
    for (option, values) in [
        ("transfer", "ct-bone "),
        ("light", "\"off headlight studio studio:eye\""),
        ("kernel", "\"gaussian kaiser-bessel\""),
        ("model", "\"composite xray mip minip average\""),
        ("type", "\"u8 i8 "),
        ("azimuth", "=(\"${cur}\")"),
        ("output", "compgen -f"),
        ("labels", "compgen -f"),
    ] {
        let place = bash.find(&format!("                --{option})\n")).unwrap_or_else(|| panic!("--{option}"));
        let case = &bash[place..place + bash[place..].find(";;").unwrap()];
        assert!(case.contains(values), "{option}: {case}");
    }
    // A transfer function may be a file too.
    let zsh = script("zsh");
    let line = zsh.lines().find(|line| line.starts_with("'--transfer=")).unwrap();
    assert!(line.contains("(ct-bone ") && line.contains("_files"), "{line}");
    let fish = script("fish");
    let line = fish.lines().find(|line| line.contains(" -l transfer ")).unwrap();
    assert!(line.contains(" -r -F -a \"ct-bone"), "{line}");
}

#[test]
fn shares_say_something() {
    let dir = folder();
    // Half of the lattice is empty, most of the rest is one value, and few voxels are brighter.
    let sample = |i: usize| match i % 100 {
        1 => 180,
        i if i % 2 == 0 => 0,
        _ => 100,
    };
    std::fs::write(dir.path().join("a.raw"), (0..20 * 20 * 20).map(sample).collect::<Vec<u8>>()).unwrap();
    let text = stdout(&voxsplat(dir.path(), "info a.raw --dims 20,20,20 --type u8"));
    assert!(text.contains("a quarter of the foreground has one value"), "{text}");
    assert!(!text.contains(" 0.0 %") && !text.contains("100.0 %"), "{text}");
}
