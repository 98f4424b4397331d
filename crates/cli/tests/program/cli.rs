//! The program itself, run in a temporary directory.

use std::io::Read;
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};

use glam::DVec3;
use tempfile::TempDir;
use voxsplat::camera::{Hull, ProjectionKind, View};
use voxsplat::clip::Clip;
use voxsplat::image::{Background, Image};
use voxsplat::lighting::{Light, Lighting};
use voxsplat::settings::{Settings, Shading};

use crate::adapter::adapter;
use crate::support::{demo, look, picture, with_quads, with_tiles};

/// Runs the program in `dir`; arguments are parted by blanks.
pub(crate) fn voxsplat(dir: &Path, arguments: &str) -> Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_voxsplat"));
    command.current_dir(dir).args(arguments.split_whitespace()).output().unwrap()
}

/// Renders on the adapter of the tests; says what went wrong if anything did.
fn rendered(dir: &Path, arguments: &str) -> Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_voxsplat"));
    let command = command.current_dir(dir).arg("render").args(arguments.split_whitespace());
    let output = command.args(["--adapter", &adapter()]).output().unwrap();
    assert!(output.status.success(), "{arguments}: {}", String::from_utf8_lossy(&output.stderr));
    output
}

/// A file of the tests of readers.
pub(crate) fn volume_file(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/data/volumes").join(name)
}

pub(crate) fn folder() -> TempDir {
    tempfile::tempdir().unwrap()
}

pub(crate) fn stdout(output: &Output) -> String {
    String::from_utf8(output.stdout.clone()).unwrap()
}

/// The one line that the program said, without its name; other lines are the driver's.
pub(crate) fn complaint(output: &Output) -> String {
    let mut own = complaints(output);
    assert_eq!(own.len(), 1, "expected one line: {own:#?}");
    own.remove(0)
}

/// The errors of a run, each one line.
pub(crate) fn complaints(output: &Output) -> Vec<String> {
    let stderr = String::from_utf8(output.stderr.clone()).unwrap();
    assert!(output.stdout.is_empty() && !stderr.contains("panicked"), "{stderr}");
    stderr.lines().filter_map(|line| line.strip_prefix("voxsplat: ")).map(str::to_owned).collect()
}

pub(crate) fn refused(arguments: &str, code: i32, reason: &str) {
    let dir = folder();
    let output = voxsplat(dir.path(), arguments);
    let said = complaint(&output);
    assert_eq!(output.status.code(), Some(code), "{arguments}: {said}");
    assert!(said.contains(reason), "{arguments}: {said}");
    assert_eq!(std::fs::read_dir(dir.path()).unwrap().count(), 0, "{arguments} left a file");
}

/// 4 x 3 x 2 samples of u8 from 0 to 23 in `ramp.raw`.
pub(crate) fn ramp(dir: &Path) -> String {
    std::fs::write(dir.join("ramp.raw"), (0..24).collect::<Vec<u8>>()).unwrap();
    "ramp.raw --dims 4,3,2 --type u8".to_owned()
}

#[test]
fn wrong_arguments_are_one_line_and_exit_2() {
    refused("paint", 2, "unrecognized subcommand 'paint'");
    refused("", 2, "a command is missing, expected render, slice, sheet, turntable, ");
    refused("render", 2, "not provided");
    refused("render demo:sphere", 2, "--output");
    refused("render demo:sphere -o a.png --azimut 3", 2, "'--azimuth'");
    refused("render demo:sphere -o a.png --azimuth left", 2, "expected a finite number");
    refused("render demo:sphere -o a.png --azimuth nan", 2, "expected a finite number");
    refused("render demo:sphere -o a.png --size 0", 2, "--size: 0x0");
    refused("render demo:sphere -o a.png --size 9x99999", 2, "--size: 9x99999");
    refused("render demo:sphere -o a.png --size big", 2, "WIDTHxHEIGHT");
    refused("render demo:sphere -o a.png --zoom -1", 2, "over 0");
    refused("render demo:sphere -o a.png --fov 30", 2, "--projection perspective");
    refused("render demo:sphere -o a.png --projection perspective --fov 180", 2, "fov is 180");
    refused("render demo:sphere -o a.png --direction 0,0,-1", 2, "parallel to up");
    refused("render demo:sphere -o a.png --direction 0,0,0", 2, "length over 0");
    refused("render demo:sphere -o a.png --direction 1,0,0 --azimuth 3", 2, "cannot be used with");
    refused("render demo:sphere -o a.png --kernel box", 2, "kaiser-bessel");
    refused("render demo:sphere -o a.png --kernel gaussian:0,2", 2, "sigma is 0");
    refused("render demo:sphere -o a.png --sharpness 1.5", 2, "--sharpness: 1.5, expected 0 to 1");
    refused("render demo:sphere -o a.png --sharpness -1", 2, "--sharpness: -1, expected 0 to 1");
    refused("render demo:sphere -o a.png --sharpness 1 --kernel kaiser-bessel", 2, "or post-shading");
    refused("render demo:sphere -o a.png --tune sheet-thickness=100", 2, "--tune sheet-thickness: 100");
    refused("render demo:sphere -o a.png --tune table-error=1", 2, "--tune table-error: 1");
    refused("render demo:sphere -o a.png --tune precision=f64", 2, "expected f16 or f32");
    refused("render demo:sphere -o a.png --painter rays", 2, "quads");
    refused("render demo:sphere -o a.png --background beige-ish", 2, "transparent");
    refused("render demo:sphere -o a.png --background beeige", 2, "a similar colour exists: beige");
    refused("render demo:sphere -o a.png --transfer ct-wood", 2, "ct-bone");
    refused("render demo:sphere -o a.png --spacing 1,0,1", 2, "lengths over 0");
    refused("render demo:sphere -o a.png --dims 1,2", 2, "whole numbers");
    refused("render demo:sphere -o a.png --type u12", 2, "u16");
    refused("compare a.png b.png --tolerance -1", 2, "0 or over");
    refused("render demo:sphere -o a.png --margin 0.5", 2, "margin is 0.5, expected 0 to under 0.5");
    refused("render demo:sphere -o a.exr --axes", 2, "--axes is drawn on a .png");
    refused("render demo:sphere -o a.png --axes --size 64", 2, "--size: 64x64 pixels, expected sides of 128");
    refused("render demo:sphere -o a.png --color-bar --model xray", 2, "--color-bar: an X-ray is white");
    refused("render demo:sphere -o a.png --model xray --response depth", 2, "a .png holds 0 to 1");
    refused("render demo:sphere -o a.png --model xray --response film:0,3", 2, "an exposure of 0");
    refused("render demo:sphere -o a.png --response film", 2, "only an X-ray");
    refused("pareto demo:sphere -o a --model xray --response depth", 2, "no picture for a report");
    refused("render demo:sphere -o a.png --depth-coded", 2, "expected mip or minip");
    refused(
        "render demo:sphere -o a.png --model mip --depth-coded --colour-bar",
        2,
        "with --depth-coded colours show depths",
    );
    refused("render demo:sphere -o a.png --title 骨", 2, "--title: the font has no '骨'");
    refused("render demo:sphere -o a.png --units length=mm", 2, "--scale-bar");
    refused("render demo:sphere -o a.png --clip 0,0,0", 2, "a direction NX,NY,NZ over 0");
    refused("render demo:sphere -o a.png --clip box:0,1,2", 2, "six numbers X0,X1");
    refused("render demo:sphere -o a.png --clip voxels:1:2", 2, "three ranges I0:I1");
    refused("render demo:sphere:8 -o a.png --clip voxels:0:9,:,:", 2, "voxels 0:9 along x, expected some of 0:8");
    refused("render demo:sphere:8 -o a.png --clip L", 2, "does not state the patient's sides");
    // What is quoted is cut, and what is expected is not.
    let long = "x".repeat(100_000);
    refused(&format!("render demo:sphere -o a.png --kernel {long}"), 2, " ... ");
    refused(&format!("render demo:sphere -o a.png --background {long}"), 2, "transparent");
}

#[test]
fn planes_boxes_and_voxels_cut_alike() {
    let dir = folder();
    let options = "--size 40 --azimuth 30 --painter quads --tune termination=0";
    let drawn = |name: &str, cut: &str| rendered(dir.path(), &format!("demo:vessels:16 -o {name}.exr {options} {cut}"));
    drawn("crop", "--clip voxels:8:,:,:");
    drawn("half", "--clip 1,0,0");
    drawn("whole", "--clip voxels::,0:16,:");
    drawn("uncut", "--frame view");
    let compared = |a: &str, b: &str| voxsplat(dir.path(), &format!("compare {a}.exr {b}.exr --tolerance 1e-6")).status;
    assert!(compared("crop", "half").success() && compared("whole", "uncut").success());
    assert!(!compared("crop", "uncut").success());
    // A scene keeps what is cut away.
    rendered(dir.path(), &format!("demo:vessels:16 -o a.exr {options} --clip voxels:8:,:,: --save-scene s.json"));
    rendered(dir.path(), "s.json -o again.exr");
    assert_eq!(std::fs::read(dir.path().join("a.exr")).unwrap(), std::fs::read(dir.path().join("again.exr")).unwrap());
}

#[test]
fn numbers_at_the_ends_of_their_range_are_named_as_they_are() {
    refused("render demo:sphere:8 -o a.png --direction 0,0,-1e200", 2, "parallel to up");
    refused("info demo:sphere:8 --spacing 1e-200,1,1", 1, "a spacing of 1e-200 is outside 1e-100 to 1e100");
    let dir = folder();
    std::fs::write(dir.path().join("a.raw"), [f32::INFINITY, f32::NAN, 1.0, 2.0].map(f32::to_le_bytes).concat())
        .unwrap();
    let input = "a.raw --dims 2,2,1 --type f32 --replace-nan";
    let said = complaint(&voxsplat(dir.path(), &format!("info {input} 1e39")));
    assert!(said.contains("--replace-nan: 1e39, expected a number that samples of type f32 hold"), "{said}");
    let text = stdout(&voxsplat(dir.path(), &format!("info {input} 0")));
    assert!(text.contains("0 to 2") && text.contains("0.75, standard deviation"), "{text}");

    let values = [f64::MIN, f64::MAX, 0.0, 1e308].map(f64::to_le_bytes).concat();
    std::fs::write(dir.path().join("b.raw"), values).unwrap();
    let text = stdout(&voxsplat(dir.path(), "info b.raw --dims 2,2,1 --type f64"));
    assert!(text.contains("mean         2.5e307, standard deviation 1.3"), "{text}");
    assert!(!text.contains("NaN") && !text.contains("inf"), "{text}");
}

#[test]
fn any_length_of_a_direction_is_the_same_direction() {
    let dir = folder();
    let input = ramp(dir.path());
    let render = |length: &str| {
        let options = format!("--direction {length},0,0 --up 0,0,{length} --reference --size 4 --transfer gray");
        let output = voxsplat(dir.path(), &format!("render {input} -o {length}.exr {options}"));
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        Image::load(dir.path().join(format!("{length}.exr"))).unwrap()
    };
    let picture = render("1");
    assert_eq!(render("1e200"), picture);
    assert_eq!(render("1e-200"), picture);
}

#[test]
fn a_constant_volume_gets_no_command_that_fails() {
    let dir = folder();
    std::fs::write(dir.path().join("a.raw"), [7; 8]).unwrap();
    let input = "a.raw --dims 2,2,2 --type u8";
    let text = stdout(&voxsplat(dir.path(), &format!("info {input}")));
    assert!(text.contains("no preset fits: all values are 7") && text.contains("--transfer FILE.json"), "{text}");
    assert!(!text.contains("voxsplat render"), "{text}");
    let json = stdout(&voxsplat(dir.path(), &format!("info {input} --json")));
    let value: serde_json::Value = serde_json::from_str(&json).unwrap();
    assert!(value["command"].is_null() && value["preset"].is_null(), "{json}");
}

#[test]
fn outputs_are_refused_before_the_work() {
    // The volume does not exist: had it been looked for, the message would be another. Its name is no file's, which
    // would be a line of its own.
    refused("render missing -o a.jpg", 2, ".png or .exr");
    refused("render missing -o no/such/a.png", 2, "no directory");
    refused("render missing -o a.png/", 2, "ends as a directory does");
    refused("compare missing.png missing.png --difference a.jpg", 2, ".png or .exr");
}

#[test]
fn failures_are_one_line_and_exit_1() {
    refused("render missing.nrrd -o a.png", 1, "cannot read missing.nrrd");
    refused("render demo:nothing -o a.png", 1, "there is no demo:nothing");
    refused("render demo:sphere -o a.png --transfer missing.json", 1, "cannot read missing.json");
    refused("info missing.nrrd", 1, "cannot read missing.nrrd");
    refused("info .", 1, "directory");
    refused("render demo:sphere:8 -o a.png --type u8", 2, "--type: it is for files of bare samples");
    refused("compare missing.png missing.png", 2, "cannot read missing.png");
    refused("render demo:sphere:16 -o a.png --adapter no-such-adapter", 1, "no-such-adapter");
}

#[test]
fn a_bad_transfer_file_is_named_with_its_line() {
    let dir = folder();
    let text = "{\"points\": [\n {\"value\": 0, \"color\": \"#000000\", \"opacity\": 2}]}";
    std::fs::write(dir.path().join("t.json"), text).unwrap();
    let output = voxsplat(dir.path(), "render demo:sphere -o a.png --transfer t.json");
    assert_eq!(output.status.code(), Some(1));
    let said = complaint(&output);
    assert!(said.starts_with("t.json: point 1 (line 2): "), "{said}");
}

#[test]
fn help_and_version_go_to_stdout() {
    let dir = folder();
    for arguments in ["--help", "render --help", "info --help", "compare --help", "devices --help", "--version"] {
        let output = voxsplat(dir.path(), arguments);
        assert_eq!(output.status.code(), Some(0), "{arguments}");
        assert!(output.stderr.is_empty() && !output.stdout.is_empty(), "{arguments}");
    }
    let help = stdout(&voxsplat(dir.path(), "render --help"));
    for part in ["Examples:", "Input:", "Output:", "View:", "Model:", "--tune", "degrees", "ct-soft-tissue", "batlowK"]
    {
        assert!(help.contains(part), "{part}");
    }
}

#[test]
fn info_tells_what_a_raw_file_holds_and_how_to_render_it() {
    let dir = folder();
    let input = ramp(dir.path());
    let text = stdout(&voxsplat(dir.path(), &format!("info {input} --spacing 1,1,2.5")));
    for part in [
        "4 x 3 x 2 = 24 voxels",
        "u8, 24 bytes",
        "1 x 1 x 2.5",
        "4 x 3 x 5 world units",
        "not stated",
        "0 to 23",
        "11.5, standard deviation 6.9222",
        "voxsplat render ramp.raw --dims 4,3,2 --type u8 --spacing 1,1,2.5 --transfer ",
        "-o ramp.png",
    ] {
        assert!(text.contains(part), "{part}: {text}");
    }
}

#[test]
fn a_figure_is_drawn_on_request() {
    let dir = folder();
    let options = "demo:vessels:16 --size 128 --region 0,0,128,64 --margin 0.1 -o";
    rendered(dir.path(), &format!("{options} plain.png"));
    rendered(dir.path(), &format!("{options} figure.png --scale-bar --axes --color-bar --title A --units length=µm"));
    let load = |name: &str| Image::load(dir.path().join(name)).unwrap();
    let (plain, figure) = (load("plain.png"), load("figure.png"));
    let changed = plain.pixels().iter().zip(figure.pixels()).filter(|(a, b)| a != b).count();
    assert!((100..4000).contains(&changed), "{changed}");
    assert!(std::fs::read(dir.path().join("figure.png")).unwrap().windows(5).any(|bytes| bytes == b"Title"));
}

#[test]
fn info_in_json_is_one_object() {
    let dir = folder();
    let input = ramp(dir.path());
    let output = voxsplat(dir.path(), &format!("info {input} --json"));
    assert_eq!(output.status.code(), Some(0));
    let value: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(value["dims"], serde_json::json!([4, 3, 2]));
    assert_eq!(value["type"], "u8");
    assert_eq!(value["mean"], 11.5);
    assert_eq!(value["histogram"].as_array().unwrap().len(), 24);
    assert!(value["orientation"].is_null());
}

#[test]
fn info_lists_labels() {
    let dir = folder();
    let input = ramp(dir.path());
    std::fs::write(dir.path().join("l.txt"), "7 255 0 0 0.5 1 1 \"Left kidney\"\n").unwrap();
    let options = format!("info {input} --spacing 1,2,2.5 --labels --label-table l.txt");
    let text = stdout(&voxsplat(dir.path(), &options));
    let line = text.lines().find(|line| line.contains("Left kidney")).unwrap();
    assert_eq!(line.split_whitespace().collect::<Vec<_>>(), ["7", "#ff0000", "0.5", "1", "5", "Left", "kidney"]);
    assert_eq!(text.lines().count(), 25);
    let json = voxsplat(dir.path(), &format!("{options} --json"));
    let listed: serde_json::Value = serde_json::from_slice(&json.stdout).unwrap();
    let label = &listed["labels"][7];
    assert_eq!((&label["name"], &label["voxels"]), (&"Left kidney".into(), &1.into()));
}

#[test]
fn channels_are_drawn_together() {
    let dir = folder();
    let data = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/data/volumes");
    for name in ["several.ome.tif", "rgb.nii"] {
        std::fs::copy(data.join(name), dir.path().join(name)).unwrap();
    }
    let drawn = |options: &str| {
        let output = voxsplat(dir.path(), &format!("render {options} --reference --size 8 -o a.exr"));
        let said = String::from_utf8_lossy(&output.stderr).into_owned();
        assert!(output.status.success(), "{options}: {said}");
        (Image::load(dir.path().join("a.exr")).unwrap(), said)
    };
    let (lit, said) = drawn("several.ome.tif");
    assert!(
        said.contains("note: using --light studio because channels show surfaces (disable: --light off)"),
        "{said}"
    );
    let (both, said) = drawn("several.ome.tif --light off");
    assert!(lit != both);
    assert!(
        said.contains("--channel 0:#0000ff DAPI from ") && said.contains(", --channel 1:#00ff00 GFP from "),
        "{said}"
    );
    // Neither has any red, unless it is given some.
    assert!(both.pixels().iter().all(|p| p[0] == 0.0) && both.pixels().iter().any(|p| p[1] > 0.0 && p[2] > 0.0));
    assert!(drawn("several.ome.tif --channel 1:red --channel 0").0.pixels().iter().any(|p| p[0] > 0.0));
    assert!(drawn("several.ome.tif --channel 1 --light off").0 != both);
    let (colours, _) = drawn("rgb.nii --window 10,20");
    assert!(colours.pixels().iter().any(|p| p[3] > 0.01 && (p[0] - p[1]).abs() > 0.001));
    let refused = |options: &str, reason: &str| {
        let output = voxsplat(dir.path(), &format!("render {options} -o a.png"));
        let said = complaint(&output);
        assert!(output.status.code() == Some(2) && said.contains(reason), "{options}: {said}");
    };
    refused("several.ome.tif --channel 0 --channel 1 --transfer gray", "is for one channel");
    refused("several.ome.tif --channel 7", "has channel 0 to 1");
    let output = voxsplat(dir.path(), "render several.ome.tif -o a.png --colour-bar --reference --size 128");
    let said = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.code() == Some(2) && said.contains("not for several channels"), "{said}");
}

#[test]
fn the_order_of_axes_is_an_option_and_noted_if_it_looks_wrong() {
    let dir = folder();
    let data = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/data/volumes");
    for name in ["fortran-u8.npz", "stored-i16.npz", "no-form.nii"] {
        std::fs::copy(data.join(name), dir.path().join(name)).unwrap();
    }
    let drawn = |options: &str| {
        let options = format!("render fortran-u8.npz {options} --transfer grayscale --reference --size 8 -o a.exr");
        let output = voxsplat(dir.path(), &options);
        let said = String::from_utf8_lossy(&output.stderr).into_owned();
        assert!(output.status.success(), "{options}: {said}");
        (Image::load(dir.path().join("a.exr")).unwrap(), said)
    };
    let (default, said) = drawn("");
    let note = "note: using axis order zyx for the array of shape (5, 4, 3), but it is in Fortran order";
    assert!(said.contains(note), "{said}");
    let (zyx, said) = drawn("--axis-order zyx");
    assert!(zyx == default && !said.contains("axis order"), "{said}");
    assert!(drawn("--axis-order xyz").0 != default);
    let says = |options: &str, words: &str| {
        let said = complaint(&voxsplat(dir.path(), &format!("info {options}")));
        assert!(said.contains(words), "{options}: {said}");
    };
    says(
        "no-form.nii --axis-order xyz",
        "--axis-order: it is for files of bare samples and arrays of NumPy, and no-form",
    );
    says("stored-i16.npz --axis-order yxz", "zyx or xyz");
    says("stored-i16.npz:mr", "has no array \"mr\": there are spacing of (3,), ct of (5, 4, 3)");
    // The raw samples of the array, whose fastest axis is z.
    std::fs::write(dir.path().join("a.raw"), (0..24).collect::<Vec<u8>>()).unwrap();
    let lattice = |options: &str| stdout(&voxsplat(dir.path(), &format!("info a.raw --type u8 {options}")));
    assert!(lattice("--dims 4,3,2 --axis-order xyz").contains("4 x 3 x 2 = 24 voxels"));
    assert!(lattice("--dims 1,4,6").lines().all(|line| !line.starts_with("note")));
    std::fs::write(dir.path().join("a.raw"), vec![0; 32]).unwrap();
    assert!(
        lattice("--dims 2,4,4").contains("look like the shape (z, y, x) of an array, but dims are numbers along x")
    );
}

#[test]
fn info_tells_the_intent_of_values() {
    let dir = folder();
    let data = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/data/volumes");
    let mut nifti = std::fs::read(data.join("no-form.nii")).unwrap();
    nifti[56..60].copy_from_slice(&12_f32.to_le_bytes());
    for (code, intent) in [(3_i16, "t statistic with 12 degrees of freedom"), (1002, "labels"), (24, "-log10 p")] {
        nifti[68..70].copy_from_slice(&code.to_le_bytes());
        std::fs::write(dir.path().join("a.nii"), &nifti).unwrap();
        let text = stdout(&voxsplat(dir.path(), "info a.nii"));
        assert!(text.contains(&format!("\nintent       {intent}\n")), "{text}");
        let json = voxsplat(dir.path(), "info a.nii --json");
        let info: serde_json::Value = serde_json::from_slice(&json.stdout).unwrap();
        assert_eq!(info["intent"], intent);
    }
}

#[test]
fn options_of_labels_go_together() {
    let refused = |options: &str, reason: &str| refused(&format!("render demo:sphere:8 -o a.png {options}"), 2, reason);
    refused("--label 3:off", "--label needs --labels FILE or --transfer labels");
    refused("--transfer labels --label 3", "expected WHICH:LOOK");
    refused("--transfer labels --labels a.nrrd", "one of labels itself");
    refused("--transfer labels --window 1,2", "not for labels");
    refused("--transfer labels --colour-bar", "not for labels");
    refused("--transfer labels --shading post", "pre-shaded");
}

#[test]
fn the_command_that_info_gives_is_quoted_for_a_shell() {
    let dir = folder();
    std::fs::write(dir.path().join("my scan's.raw"), [0, 1, 2, 3, 4, 5, 6, 7]).unwrap();
    let mut command = Command::new(env!("CARGO_BIN_EXE_voxsplat"));
    let output = command.current_dir(dir.path()).args(["info", "my scan's.raw", "--dims", "2,2,2", "--type", "u8"]);
    let text = stdout(&output.output().unwrap());
    assert!(text.contains(r"voxsplat render 'my scan'\''s.raw' --dims 2,2,2 --type u8"), "{text}");
}

#[cfg(target_os = "linux")]
#[test]
fn a_volume_file_may_have_any_name() {
    use std::os::unix::ffi::OsStrExt;
    let dir = folder();
    let name = std::ffi::OsStr::from_bytes(b"sc\xffan.raw");
    std::fs::write(dir.path().join(name), [0, 1, 2, 3, 4, 5, 6, 7]).unwrap();
    let mut command = Command::new(env!("CARGO_BIN_EXE_voxsplat"));
    command.current_dir(dir.path()).arg("info").arg(name).args(["--dims", "2,2,2", "--type", "u8"]);
    let text = stdout(&command.output().unwrap());
    assert!(text.contains(r"voxsplat render $'sc\xffan.raw' --dims 2,2,2 --type u8"), "{text}");
}

#[test]
fn ways_out_are_told_in_flags() {
    let dir = folder();
    std::fs::write(dir.path().join("a.raw"), f32::NAN.to_le_bytes()).unwrap();
    for (options, way_out) in [
        ("", "for bare samples give --dims X,Y,Z and --type u8|i8|"),
        (" --type f32", "give --dims X,Y,Z too"),
        (" --dims 1,1,1", "give --type u8|i8|"),
        (" --dims 1,1,1 --type f32", "the first at (0, 0, 0): replace them with --replace-nan VALUE"),
    ] {
        let said = complaint(&voxsplat(dir.path(), &format!("info a.raw{options}")));
        assert!(said.contains(way_out), "{said}");
    }
    let said = complaint(&voxsplat(dir.path(), "info none.raw"));
    assert_eq!(said.matches("No such file").count(), if cfg!(unix) { 1 } else { 0 }, "{said}");
}

#[test]
fn choices_that_a_file_needs_are_told_in_flags() {
    let dir = folder();
    let numbers = (0..8).map(|n| if n == 3 { f32::NAN } else { n as f32 });
    let bytes: Vec<u8> = numbers.flat_map(f32::to_le_bytes).collect();
    std::fs::write(dir.path().join("gap_2x2x2_float32.raw"), &bytes).unwrap();
    let output = voxsplat(dir.path(), "render gap_2x2x2_float32.raw --reference --size 8 -o a.png");
    let said = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{said}");
    assert!(said.contains("note: using 2 x 2 x 2 samples of f32 because the name states them"), "{said}");
    assert!(said.contains("note: nothing is drawn of 1 of 8 samples because it is NaN or infinite"), "{said}");
    // Two parts of two complex numbers.
    let dict = "{'descr': '<c8', 'fortran_order': False, 'shape': (1, 1, 2), }";
    let parts = [3.0_f32, 4.0, 0.0, 1.0].map(f32::to_le_bytes).concat();
    let npy = [b"\x93NUMPY\x01\0".as_slice(), &(dict.len() as u16).to_le_bytes(), dict.as_bytes(), &parts];
    std::fs::write(dir.path().join("c.npy"), npy.concat()).unwrap();
    let said = complaint(&voxsplat(dir.path(), "info c.npy"));
    assert!(said.contains("complex numbers: choose a part with --complex abs, real, imag or phase"), "{said}");
    let text = stdout(&voxsplat(dir.path(), "info c.npy --complex abs --json"));
    let info: serde_json::Value = serde_json::from_str(&text).unwrap();
    assert_eq!((&info["min"], &info["max"]), (&1.0.into(), &5.0.into()));
    let images = concat!(env!("CARGO_MANIFEST_DIR"), "/../../tests/data/volumes/images.ome.tif");
    std::fs::copy(images, dir.path().join("images.ome.tif")).unwrap();
    let said = complaint(&voxsplat(dir.path(), "info images.ome.tif"));
    assert!(said.contains("2 is \"second\" of 2 x 4 x 3 u8: choose one with --series N"), "{said}");
    let output = voxsplat(dir.path(), "info images.ome.tif --series 2");
    assert!(output.status.success() && output.stderr.is_empty(), "{}", String::from_utf8_lossy(&output.stderr));
}

#[test]
fn a_closed_pipe_is_no_failure() {
    let film = "turntable demo:sphere:8 --reference --frames 3 --size 64 -o -";
    for line in [
        "info demo:sphere:64 --json".to_owned(),
        "render demo:sphere:8 --reference --size 64 -o -".to_owned(),
        film.to_owned(),
        format!("{film} --format gif"),
        format!("{film} --format apng"),
        format!("{film} --format html"),
    ] {
        let mut command = Command::new(env!("CARGO_BIN_EXE_voxsplat"));
        let command = command.args(line.split(' ')).stdout(Stdio::piped()).stderr(Stdio::piped());
        let mut child = command.spawn().unwrap();
        drop(child.stdout.take());
        let mut said = String::new();
        child.stderr.take().unwrap().read_to_string(&mut said).unwrap();
        assert!(child.wait().unwrap().success() && said.is_empty(), "{line}: {said}");
    }
}

#[test]
fn the_reference_renders_without_a_device() {
    let dir = folder();
    let input = ramp(dir.path());
    let arguments = format!("render {input} -o r.exr --reference --size 8 --azimuth -30 --transfer gray --stats json");
    let output = voxsplat(dir.path(), &arguments);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let value: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(value["painter"], "reference");
    let image = Image::load(dir.path().join("r.exr")).unwrap();
    assert_eq!((image.width(), image.height()), (8, 8));
    assert!(image.pixels().iter().any(|p| p[3] > 0.0));
}

#[test]
fn a_file_without_transfer_says_what_was_taken() {
    let dir = folder();
    let input = ramp(dir.path());
    let output = voxsplat(dir.path(), &format!("render {input} -o r.png --reference --size 8"));
    assert!(output.status.success());
    let said = String::from_utf8(output.stderr).unwrap();
    let notes: Vec<&str> = said.lines().collect();
    assert!(
        notes[0].starts_with("voxsplat: note: using --transfer mri, a guess from the histogram, because"),
        "{said}"
    );
    assert!(notes[1].starts_with("voxsplat: note: using --azimuth 30 --elevation 20 because"), "{said}");
    assert!(notes[2].starts_with("voxsplat: note: using --light studio because"), "{said}");
    assert!(notes[3].starts_with("voxsplat: note: using --sharpness 0.5 because") && notes.len() == 4, "{said}");
    let post = voxsplat(dir.path(), &format!("render {input} -o r.png --reference --size 8 --shading post"));
    assert!(String::from_utf8(post.stderr).unwrap().contains("using --sharpness 0.5 because"));
    let without = "--light off --azimuth 0 --sharpness 0";
    let output = voxsplat(dir.path(), &format!("render {input} -o r.png --reference --size 8 {without}"));
    assert!(complaint(&output).starts_with("note: using --transfer "));
    let own = voxsplat(dir.path(), "render demo:sphere:16 -o s.png --reference --size 8");
    assert!(own.status.success() && complaint(&own) == BUILT_IN, "{}", complaint(&own));
}

#[test]
fn a_unit_is_a_label_and_an_option_says_that_values_are_absolute() {
    let dir = folder();
    let input = ramp(dir.path());
    let points = |options: &str| -> (Vec<f64>, String) {
        let line = format!("render {input} -o a.png --save-transfer t.json --size 128 --reference {options}");
        let output = voxsplat(dir.path(), &line);
        let said = String::from_utf8(output.stderr).unwrap();
        assert!(output.status.success(), "{options}: {said}");
        let saved: serde_json::Value =
            serde_json::from_slice(&std::fs::read(dir.path().join("t.json")).unwrap()).unwrap();
        (saved["points"].as_array().unwrap().iter().map(|point| point["value"].as_f64().unwrap()).collect(), said)
    };
    for preset in ["ct-bone", "activation"] {
        let bar = format!("--transfer {preset} --colour-bar");
        let (fitted, said) = points(&bar);
        assert!(!said.contains("--transfer-values"), "{said}");
        for unit in ["HU", "z", "t"] {
            assert_eq!(points(&format!("{bar} --units value={unit}")).0, fitted, "{preset} in {unit}");
        }
        assert_eq!(points(&format!("{bar} --transfer-values fitted")).0, fitted);
        let absolute = points(&format!("{bar} --transfer-values absolute")).0;
        let expected = if preset == "ct-bone" { 150.0 } else { -3.0 };
        assert!(absolute != fitted && absolute.contains(&expected), "{preset}: {absolute:?}");
    }
    let said = points("--transfer mri --transfer-values absolute").1;
    assert!(said.contains("--transfer-values has no effect because preset mri has no absolute values"), "{said}");
    refused("render demo:sphere -o a.png --transfer map:vik --transfer-values fitted", 2, "is for presets");
}

#[test]
fn a_figure_says_that_the_frame_is_smaller_and_an_option_keeps_the_frame() {
    let dir = folder();
    let drawn = |options: &str| {
        let line = format!("render demo:sphere:16 -o a.png --size 160 --reference {options}");
        let output = voxsplat(dir.path(), &line);
        let said = String::from_utf8(output.stderr).unwrap();
        assert!(output.status.success(), "{options}: {said}");
        let said =
            said.lines().filter(|line| !line.ends_with(BUILT_IN)).map(|line| format!("{line}\n")).collect::<String>();
        (Image::load(dir.path().join("a.png")).unwrap(), said)
    };
    let (plain, said) = drawn("");
    assert!(said.is_empty(), "{said}");
    let (beside, said) = drawn("--title T --colour-bar");
    assert_eq!(said.matches("voxsplat: note: ").count(), 1, "{said}");
    assert!(
        said.contains("the title and the colour bar would lie over the volume (same frame: --frame view)"),
        "{said}"
    );
    // Left of the bar and below the title.
    let covered = |image: &Image| {
        let rows = image.pixels().chunks(160).skip(24);
        rows.map(|row| row[..100].iter().filter(|pixel| pixel[0] > 0.02).count()).sum::<usize>()
    };
    assert!(covered(&beside) + 500 < covered(&plain), "the volume is smaller");
    // Whatever sets the frame, texts change no pixel below them.
    for frame in ["--frame visible", "--frame view", "--frame volume", "--zoom 1.3", "--view-height 20"] {
        let [(without, _), (with, said)] = ["", "--title T"].map(|title| drawn(&format!("{frame} {title}")));
        assert!(said.is_empty(), "{frame}: {said}");
        assert!(without != with && without.pixels()[160 * 24..] == with.pixels()[160 * 24..], "{frame}");
    }
    assert!(drawn("--frame view").0 == plain);
    // Parts in corners need no space.
    assert!(drawn("--scale-bar --axes").1.is_empty());
}

#[test]
fn negative_numbers_are_values() {
    let dir = folder();
    let view = "--direction -1,-2,-.5 --roll -10 --target -1,0,1 --up -0.1,0,1";
    let output = voxsplat(dir.path(), &format!("render demo:sphere:16 -o s.png --reference --size 8 {view}"));
    assert!(output.status.success(), "{}", complaint(&output));
}

/// The note on a built-in volume, beside the choices.
const BUILT_IN: &str = "note: this volume is built in; try next: voxsplat render FILE -o picture.png";

/// Asserts that the program wrote the picture that the library makes of a sphere, to the last bit.
fn assert_sphere(dir: &Path, arguments: &str, view: &View, settings: &Settings, background: Background) {
    let output = rendered(dir, &format!("demo:sphere:24 --size 40x32 {arguments} -o program.png"));
    assert!(output.stdout.is_empty() && complaint(&output) == BUILT_IN, "{arguments}: {output:?}");
    let (volume, transfer) = demo("sphere", 24);
    let around = Hull::of_visible(&volume, &transfer, &Clip::default()).unwrap().map(Hull::from_one_side);
    let camera = look(&View { around, ..view.clone() }, &volume, [40, 32]);
    let image = picture(&volume, &transfer, &camera, settings).image;
    assert!(image.pixels().iter().any(|p| p[3] > 0.1));
    image.save(dir.join("library.png"), background).unwrap();
    let [program, library] = ["program.png", "library.png"].map(|name| Image::load(dir.join(name)).unwrap());
    assert!(program == library, "{arguments}");
}

#[test]
fn pictures_of_the_device_are_those_of_the_library() {
    let dir = folder();
    let black = Background::default();
    let front = View::default();
    let quads = with_quads(&Settings::default(), |_| ());
    assert_sphere(dir.path(), "--painter quads", &front, &quads, black);
    let tiles = with_tiles(&Settings::default());
    assert_sphere(dir.path(), "--painter tiles", &front, &tiles, black);
    let view = View {
        azimuth: -30.0,
        elevation: 20.0,
        roll: 10.0,
        zoom: 1.5,
        projection: ProjectionKind::Perspective { fov: 40.0 },
        ..View::default()
    };
    let arguments = "--painter quads --azimuth -30 --elevation 20 --roll 10 --zoom 1.5 --projection perspective \
                     --fov 40 --background transparent";
    assert_sphere(dir.path(), arguments, &view, &quads, Background::Transparent);
}

#[test]
fn pictures_frame_what_shows_unless_they_are_placed() {
    let dir = folder();
    // A lattice in which one corner shows.
    let mut samples = [0_u8; 16 * 16 * 16];
    samples[..4].fill(255);
    std::fs::write(dir.path().join("a.raw"), samples).unwrap();
    let covered = |options: &str| {
        let input = "a.raw --dims 16,16,16 --type u8 --transfer gray --azimuth 0 --size 32 -o a.exr";
        rendered(dir.path(), &format!("{input} {options}"));
        let image = Image::load(dir.path().join("a.exr")).unwrap();
        image.pixels().iter().filter(|p| p[3] > 0.01).count()
    };
    let (visible, volume) = (covered(""), covered("--frame volume"));
    assert!(visible > 4 * volume && volume > 0, "{visible} {volume}");
    assert_eq!(covered("--frame view"), visible);
    assert!(covered("--margin 0.3") < visible / 2);
    // The height of the volume's own frame.
    assert_eq!(covered("--view-height 16.666666666666668"), volume);
    assert!(covered("--view-height 16 --frame visible") > 0);
    let perspective = "--projection perspective --fov 40";
    assert!(covered(perspective) > 4 * covered(&format!("{perspective} --frame volume")));
}

#[test]
fn lights_and_material_reach_the_picture() {
    let dir = folder();
    // An eye at azimuth 90 is on the side of +x, and the front at azimuth 0 on that of -y.
    let lights = vec![Light::HEADLIGHT, Light::directional(DVec3::X)];
    let lighting =
        Lighting { ambient: 0.1, diffuse: 0.6, specular: 0.3, shininess: 8.0, lights, ..Lighting::default() };
    let settings = Settings { shading: Shading::Post, lighting: Some(lighting), ..Settings::default() };
    let settings = with_quads(&settings, |_| ());
    let arguments = "--painter quads --shading post --light headlight --light 90,0 --material 0.1,0.6,0.3,8 \
                     --frame volume";
    let output = rendered(dir.path(), &format!("demo:sphere:24 --size 40x32 {arguments} -o program.exr"));
    assert!(output.stdout.is_empty() && complaint(&output) == BUILT_IN, "{output:?}");
    let (volume, transfer) = demo("sphere", 24);
    let camera = look(&View::default(), &volume, [40, 32]);
    let program = Image::load(dir.path().join("program.exr")).unwrap();
    let library = picture(&volume, &transfer, &camera, &settings).image;
    // The direction of a light is made from degrees: an ulp of cos 90 is not nothing.
    let (color, alpha) = crate::support::errors(&program, &library);
    assert!(color < 1e-5 && alpha == 0.0, "{color:e} {alpha:e}");
    let unlit = picture(&volume, &transfer, &camera, &Settings { lighting: None, ..settings }).image;
    assert!(crate::support::errors(&unlit, &program).0 > 0.05);
}

#[test]
fn shadows_and_colours_of_lights_reach_the_picture() {
    let dir = folder();
    let side = Light { color: [1.5, 0.75, 0.0], size: 12.0, ..Light::directional(DVec3::X) };
    let lighting = Lighting { lights: vec![side], shadows: 0.6, occlusion: Some(5.0), ..Lighting::default() };
    let settings = Settings { lighting: Some(lighting), ..Settings::default() };
    let arguments = "--light 90,0:1.5,#ff8000 --shadows 0.6 --light-size 12 --occlusion 5 --frame volume \
                     --material 0.3,0.7,0.2,24 --sharpness 0 --azimuth 0";
    rendered(dir.path(), &format!("demo:vessels:32 --size 40x32 {arguments} -o program.exr"));
    let (volume, transfer) = demo("vessels", 32);
    let camera = look(&View::default(), &volume, [40, 32]);
    let program = Image::load(dir.path().join("program.exr")).unwrap();
    let library = picture(&volume, &transfer, &camera, &settings).image;
    // 0x80 is not quite a half.
    assert!(crate::support::errors(&program, &library).0 < 5e-3);
    let arguments = "--light studio --material 0.4,0.7,0.2,24 --sharpness 0 --azimuth 0 --frame volume -o studio.exr";
    rendered(dir.path(), &format!("demo:vessels:32 --size 40x32 {arguments}"));
    let view = View::default();
    let lighting = Some(Lighting::studio(view.forward().unwrap(), view.up));
    let library = picture(&volume, &transfer, &camera, &Settings { lighting, ..Settings::default() }).image;
    assert_eq!(Image::load(dir.path().join("studio.exr")).unwrap().pixels(), library.pixels());
}

#[test]
fn presets_that_show_surfaces_are_lit_unless_told_not_to() {
    let dir = folder();
    rendered(dir.path(), "demo:vessels:24 --size 32 --transfer ct-bone -o lit.png");
    rendered(dir.path(), "demo:vessels:24 --size 32 --transfer ct-bone --light studio -o studio.png");
    rendered(dir.path(), "demo:vessels:24 --size 32 --transfer ct-bone --light off -o off.png");
    rendered(dir.path(), "demo:vessels:24 --size 32 --transfer viridis -o field.png");
    rendered(dir.path(), "demo:vessels:24 --size 32 --transfer viridis --light off -o unlit.png");
    let pixels = |name: &str| image::open(dir.path().join(name)).unwrap().into_rgba8().into_raw();
    assert_eq!(pixels("lit.png"), pixels("studio.png"));
    rendered(dir.path(), "demo:vessels:24 --size 32 --transfer ct-bone --sharpness 0.5 -o sharp.png");
    rendered(dir.path(), "demo:vessels:24 --size 32 --transfer ct-bone --kernel gaussian -o blurred.png");
    assert_eq!(pixels("lit.png"), pixels("sharp.png"));
    assert_ne!(pixels("lit.png"), pixels("blurred.png"));
    assert_ne!(pixels("lit.png"), pixels("off.png"));
    assert_eq!(pixels("field.png"), pixels("unlit.png"));
}

#[test]
fn materials_are_those_of_the_preset_unless_they_are_given() {
    let dir = folder();
    let pixels = |options: &str| {
        rendered(
            dir.path(),
            &format!("demo:vessels:24 --size 32 --transfer ct-skin --light headlight {options} -o a.exr"),
        );
        Image::load(dir.path().join("a.exr")).unwrap().pixels().to_vec()
    };
    assert_eq!(pixels(""), pixels("--material 0.45,0.9,0.12,12"));
    assert_ne!(pixels(""), pixels("--material 0.3,0.7,0.2,24"));
}

#[test]
fn what_has_no_orientation_is_seen_from_an_oblique_side_unless_a_side_is_asked_for() {
    let dir = folder();
    let samples: Vec<u8> = (0..16 * 12 * 8_u32).map(|i| (i * 7 % 256) as u8).collect();
    std::fs::write(dir.path().join("a.raw"), samples).unwrap();
    let picture = |options: &str| {
        let output = rendered(dir.path(), &format!("a.raw --type u8 --transfer ct-skin --size 24 {options} -o a.exr"));
        let said = String::from_utf8(output.stderr).unwrap();
        (Image::load(dir.path().join("a.exr")).unwrap().pixels().to_vec(), said.contains("note: using --azimuth 30"))
    };
    let box_shaped = "--dims 16,12,8";
    let (oblique, noted) = picture(box_shaped);
    assert!(noted);
    let side = format!("{box_shaped} --azimuth 30 --elevation 20");
    assert_eq!(picture(&side), (oblique.clone(), false));
    // Lights of a studio stand about the view that is taken.
    assert_eq!(picture(&format!("{box_shaped} --light studio")), (oblique.clone(), true));
    for options in ["--azimuth 0", "--elevation 0", "--roll 10", "--up 0,0,1", "--direction 0,1,0"] {
        let (seen, noted) = picture(&format!("{box_shaped} {options}"));
        assert!(seen != oblique && !noted, "{options}");
    }
    assert!(!picture("--dims 48,32,1").1, "a slice shows nothing from the side");
}

#[test]
fn lights_that_cannot_be_are_refused() {
    for (arguments, reason) in [
        ("--shadows on", "--shadows needs --light, such as --light studio"),
        ("--occlusion 4", "--occlusion needs --light, such as --light studio"),
        ("--light-size 4", "--light-size needs --light, such as --light studio"),
        ("--light headlight --shadows on", "a headlight casts none"),
        ("--light 20,30 --light-size 4", "--light-size shows in shadows alone"),
        ("--light studio --light headlight", "expected no other light beside it"),
        ("--light 20", "expected off, studio, studio:eye, headlight, AZ,EL"),
        ("--light @1,2", "expected off, studio, studio:eye, headlight, AZ,EL"),
        ("--light @1,2,3 --shadows on --light-size 4", "a light at a place is a point"),
        ("--light 20,30:bright", "expected off, studio, studio:eye, headlight, AZ,EL"),
        ("--light 20,30:0.5,gould", "; a similar colour exists: gold"),
        ("--light 20,30 --occlusion far", "expected off or a radius in voxels"),
    ] {
        refused(&format!("render demo:sphere:8 -o out.png {arguments}"), 2, reason);
    }
}

#[test]
fn stats_of_the_device_are_a_table_or_one_object() {
    let dir = folder();
    for painter in ["quads", "tiles"] {
        let scene = format!("demo:vessels:24 -o v.png --size 40x32 --painter {painter}");
        let output = rendered(dir.path(), &format!("{scene} --stats json"));
        let value: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
        let name = value["adapter"]["name"].as_str().unwrap();
        assert!(name.to_lowercase().contains(&adapter().to_lowercase()), "{name}");
        assert_eq!((value["painter"]["name"].as_str(), value["voxels"].as_u64()), (Some(painter), Some(24 * 24 * 24)));
        assert_eq!(value["size"], serde_json::json!([40, 32]));
        let [kept, dropped] = ["splats_kept", "splats_dropped"].map(|key| value[key].as_u64().unwrap());
        assert!(kept > 0 && kept + dropped == 24 * 24 * 24, "{kept} {dropped}");
        // Stages in the order they ran: reading, device, picture, file.
        let stages: Vec<_> = value["stages"].as_array().unwrap().iter().map(|s| s["name"].as_str().unwrap()).collect();
        assert_eq!((stages.first(), stages.last()), (Some(&"load"), Some(&"encode")), "{stages:?}");
        assert!(value["stages"].as_array().unwrap().iter().all(|s| s["seconds"].as_f64().unwrap() >= 0.0));

        let table = stdout(&rendered(dir.path(), &format!("{scene} --stats")));
        let line = |label: &str| {
            let found = table.lines().find_map(|line| line.strip_prefix(label)).map(str::trim);
            found.unwrap_or_else(|| panic!("no {label}: {table}")).to_owned()
        };
        assert!(line("adapter").starts_with(name) && line("picture").starts_with("40 x 32 px"), "{table}");
        assert!(line("painter").starts_with(&format!("{painter}: ")) && line("encode").contains(" ms "), "{table}");
        // One row of those is for one painter only.
        assert_eq!((table.contains("\nrays "), table.contains("\nquads ")), (painter == "tiles", painter == "quads"));
        let grouped = |n: u64| if n < 1000 { n.to_string() } else { format!("{},{:03}", n / 1000, n % 1000) };
        let voxels = line("voxels");
        let mut columns = voxels.split_whitespace();
        assert_eq!((columns.next(), columns.next()), (Some(grouped(kept).as_str()), Some(grouped(dropped).as_str())));
    }
}

#[test]
fn devices_names_the_adapter_that_tests_run_on() {
    let dir = folder();
    let output = voxsplat(dir.path(), "devices");
    assert!(output.status.success() && output.stderr.is_empty(), "{output:?}");
    let table = stdout(&output);
    let own = table.lines().find(|line| line.to_lowercase().contains(&adapter().to_lowercase()));
    let columns = ["discrete", "integrated", "virtual", "other", "cpu"];
    assert!(own.is_some_and(|line| columns.iter().any(|kind| line.contains(kind))), "{table}");
    // Its index names it too.
    let index = own.and_then(|line| line.split_whitespace().next()).unwrap();
    let rendered = |adapter: &str| {
        let input = ramp(dir.path());
        voxsplat(dir.path(), &format!("render {input} -o {}.png --size 8 --stats --adapter {adapter}", &adapter[1..]))
    };
    let output = rendered(index);
    assert!(output.status.success(), "{output:?}");
    assert!(stdout(&output).to_lowercase().contains(&adapter().to_lowercase()), "{output:?}");
    let error = complaint(&rendered("#99"));
    assert!(error.contains("none is \"#99\"; there are: #0 "), "{error}");
}

#[test]
fn transfer_functions_of_other_programs_are_drawn_and_written() {
    let dir = folder();
    let input = ramp(dir.path());
    let data = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/data/transfer");
    let render = |name: &str, options: &str| {
        let output =
            voxsplat(dir.path(), &format!("render {input} -o {name}.exr --reference --size 4 --azimuth 0 {options}"));
        assert!(output.status.success(), "{options}: {}", String::from_utf8_lossy(&output.stderr));
        let said = String::from_utf8(output.stderr).unwrap();
        (Image::load(dir.path().join(format!("{name}.exr"))).unwrap(), said)
    };
    std::fs::copy(data.join("slicer.vp"), dir.path().join("a.vp")).unwrap();
    std::fs::copy(data.join("paraview.json"), dir.path().join("maps.json")).unwrap();
    let (picture, said) = render("a", "--transfer a.vp --save-transfer b.vp.json --window 12,24");
    assert!(said.contains("slabs 1 world units thick, the mean spacing"), "{said}");
    assert!(said.contains("--light headlight --material 0.1,0.9,0.2,10"), "{said}");
    assert!(picture.pixels().iter().any(|pixel| pixel[3] > 0.0));
    let (again, said) = render("b", "--transfer b.vp.json");
    assert_eq!((again, said.as_str()), (picture, ""));
    let (fitted, said) = render("c", "--transfer maps.json#Lab");
    assert!(said.contains("gentle ramp") && said.contains("using values from") && said.contains("--window"), "{said}");
    let (placed, said) = render("d", "--transfer map:maps.json#Lab --window 12,24");
    assert!(said.is_empty() && placed != fitted, "{said}");
    // A window alone is grey.
    assert_eq!(render("e", "--window 12,24").0, render("f", "--transfer map:gray --window 12,24").0);
    refused("render demo:sphere -o a.png --window 1,0", 2, "the width over 0");
    refused("render demo:sphere -o a.png --transfer map:batlov", 2, "batlow");
    refused("render demo:sphere -o a.png --transfer batlow", 2, "\"batlow\" is a colour map, give map:batlow");
    refused("render demo:sphere -o a.png --save-transfer a.txt", 2, "written as .json, .vp.json or .vp");
    refused("render demo:sphere -o a.png --transfer a.vp", 1, "cannot read a.vp");
    std::fs::write(dir.path().join("flat.raw"), [7; 8]).unwrap();
    let output = voxsplat(dir.path(), "render flat.raw --dims 2,2,2 --type u8 -o a.png --transfer map:vik");
    assert!(complaint(&output).contains("--window: a colour map needs one"), "{:?}", output.status);
}

/// A ball that moves along x and grows brighter, 12^3 samples of u8 at each of three points in time, in `ball.nrrd`;
/// compressed, as most series are.
fn moving_ball(dir: &Path) {
    let head = "NRRD0004\ntype: uchar\ndimension: 4\nsizes: 12 12 12 3\nkinds: domain domain domain time\n\
        encoding: gzip\n\n";
    let sample = |n: i32| {
        let [x, y, z, t] = [n % 12, n / 12 % 12, n / 144 % 12, n / 1728];
        let away = (x - 3 - 3 * t).pow(2) + (y - 6).pow(2) + (z - 6).pow(2);
        if away <= 5 { 100 + 40 * t as u8 } else { 0 }
    };
    let samples: Vec<u8> = (0..3 * 1728).map(sample).collect();
    let mut gzip = flate2::write::GzEncoder::new(head.as_bytes().to_vec(), flate2::Compression::fast());
    std::io::Write::write_all(&mut gzip, &samples).unwrap();
    std::fs::write(dir.join("ball.nrrd"), gzip.finish().unwrap()).unwrap();
}

#[test]
fn a_turntable_goes_through_points_in_time() {
    let dir = folder();
    moving_ball(dir.path());
    let turn = |options: &str| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_voxsplat"));
        command.current_dir(dir.path()).arg("turntable").args(options.split_whitespace());
        let output = command.args(["--adapter", &adapter()]).output().unwrap();
        assert!(output.status.success(), "{options}: {}", String::from_utf8_lossy(&output.stderr));
        String::from_utf8(output.stderr).unwrap()
    };
    let bytes = |name: &str| std::fs::read(dir.path().join(name)).unwrap();
    let said = turn("ball.nrrd --size 32 --time all --turn 0 --transfer gray --save-transfer t.json -o {frame}.png");
    let first = "time points 0 to 2: using the transfer function of the first";
    assert!(said.contains(&format!("note: {first}, and one framing for all (disable: --frame volume)")), "{said}");
    assert!(!dir.path().join("0003.png").exists());
    // The ball moves, and no more than the tails of its kernels reach an edge: all have one frame.
    let places = [0, 1, 2].map(|frame| {
        let image = Image::load(dir.path().join(format!("000{frame}.png"))).unwrap();
        let of = |x: u32, y: u32| f64::from(image.pixels()[(y * 32 + x) as usize][0]);
        let all: Vec<(u32, u32)> = (0..32).flat_map(|y| (0..32).map(move |x| (x, y))).collect();
        let most = |places: &mut dyn Iterator<Item = &(u32, u32)>| places.map(|&(x, y)| of(x, y)).fold(0.0, f64::max);
        let edge = most(&mut all.iter().filter(|(x, y)| [*x, *y].iter().any(|c| [0, 31].contains(c))));
        assert!(edge < 0.15 * most(&mut all.iter()), "frame {frame}: {edge} at an edge");
        let light: f64 = all.iter().map(|&(x, y)| of(x, y)).sum();
        all.iter().map(|&(x, y)| of(x, y) * f64::from(x)).sum::<f64>() / light
    });
    assert!(places[1] > places[0] + 4.0 && places[2] > places[1] + 4.0, "{places:?}");
    assert!((places[0] + places[2] - 31.0).abs() < 1.0, "{places:?} are not around the middle");
    // Each frame is the picture of its time by the first one's transfer function.
    let said = turn("ball.nrrd --size 32 --time 1-2 --turn 90 --transfer t.json --frame volume -o b{frame}.png");
    assert!(!said.contains("time points"), "{said}");
    for (frame, azimuth) in [(0, 0), (1, 45)] {
        let time = frame + 1;
        let line = format!("ball.nrrd --size 32 --time {time} --azimuth {azimuth} --elevation 0 --transfer t.json");
        rendered(dir.path(), &format!("{line} --frame volume -o a.png"));
        assert!(bytes("a.png") == bytes(&format!("b000{frame}.png")), "{frame}");
    }
    // Fewer and more frames than points in time, in parts.
    let all = [0, 1, 2].map(|frame| bytes(&format!("000{frame}.png")));
    for part in ["1/2", "2/2"] {
        let line = "ball.nrrd --size 32 --time all --frames 5 --turn 0 --transfer gray --resume -o c{frame}.png";
        turn(&format!("{line} --part {part}"));
    }
    for (frame, time) in [0, 0, 1, 1, 2].into_iter().enumerate() {
        assert!(bytes(&format!("c000{frame}.png")) == all[time], "{frame}");
    }
    assert!(
        turn("ball.nrrd --size 32 --time all --transfer gray --resume -o {frame}.png").contains("all frames are there")
    );
    turn("ball.nrrd --size 32 --time all --frames 2 --turn 0 --transfer gray -o d{frame}.png");
    // They frame what they show.
    turn("ball.nrrd --size 32 --time 0-1 --turn 0 --transfer gray -o f{frame}.png");
    assert!(bytes("d0000.png") == bytes("f0000.png") && bytes("d0001.png") == bytes("f0001.png"));
    assert!(bytes("d0000.png") != all[0]);
    // Films, and several channels with the windows of the first point in time.
    turn("ball.nrrd --size 32 --time all --turn 0 -o a.gif");
    assert!(bytes("a.gif").starts_with(b"GIF89a"));
    turn("ball.nrrd --size 32 --time all -o a.html");
    let page = String::from_utf8(bytes("a.html")).unwrap();
    assert_eq!(page.split("const frames = [\n").nth(1).unwrap().split("];").next().unwrap().lines().count(), 3);
    let channels = |name: &str| {
        std::fs::copy(volume_file(name), dir.path().join(name)).unwrap();
        turn(&format!("{name} --size 8 --time all --turn 0 -o e{{frame}}.png"));
        assert!(bytes("e0000.png") != bytes("e0001.png"));
        let line = format!("{name} --size 8 --time 0 --frame volume --azimuth 0 --elevation 0 -o a.png");
        String::from_utf8(rendered(dir.path(), &line).stderr).unwrap()
    };
    assert!(channels("five.nrrd").contains("--channel 0:#26e64d"));
}

#[test]
fn points_in_time_that_make_no_sense_are_refused() {
    refused("render demo:sphere:8 -o a.png --time all", 2, "--time all: several time points are for turntable");
    refused("render demo:sphere:8 -o a.png --time 0-3", 2, "--time 0-3: several time points are for turntable");
    refused("pareto demo:sphere:8 -o a --time 0-3", 2, "are for turntable");
    refused("info demo:sphere:8 --time all", 2, "are for turntable");
    refused("turntable demo:sphere:8 -o a.gif --time 3-1", 2, "expected N, FIRST-LAST or all");
    refused("turntable - -o a.gif --time all", 2, "standard input is read once");
    refused("turntable demo:sphere:8 -o a.gif --time all", 1, "demo:sphere:8 has one time point");
    let dir = folder();
    moving_ball(dir.path());
    let output = voxsplat(dir.path(), "turntable ball.nrrd -o a.gif --time 1-3");
    assert!(complaint(&output).contains("--time 1-3: ball.nrrd has the time points 0 to 2"), "{output:?}");
    assert_eq!(output.status.code(), Some(1));
    let output = rendered(dir.path(), "ball.nrrd -o a.png --size 8");
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(said.contains("using --time 0 of 0 to 2 (all of them: turntable --time all)"), "{said}");
}
