//! Results for scripts: exit codes and limits of `compare`, JSON of every command, one text for one trouble.

use std::fs;
use std::path::Path;
use std::process::{Command, Output};

use serde_json::{Deserializer, Value, json};
use voxsplat::image::{Background, Image};

use crate::adapter::adapter;
use crate::cli::{complaint, folder, ramp, refused, stdout, voxsplat};

/// Saves `a.exr`, and `b.exr` with one of 12 pixels changed by 0.1 in one channel.
fn two_pictures(dir: &Path) {
    let mut image = Image::new(4, 3, vec![[0.25, 0.5, 0.75, 1.0]; 12]).unwrap();
    image.save(dir.join("a.exr"), Background::Transparent).unwrap();
    image.pixels_mut()[7][1] += 0.1;
    image.save(dir.join("b.exr"), Background::Transparent).unwrap();
    Image::new(3, 3, vec![[0.0; 4]; 9]).unwrap().save(dir.join("small.exr"), Background::Transparent).unwrap();
}

#[test]
fn compare_has_the_exit_codes_of_diff() {
    let dir = folder();
    two_pictures(dir.path());
    let equal = voxsplat(dir.path(), "compare a.exr a.exr");
    assert!(equal.status.success() && equal.stderr.is_empty());
    let apart = voxsplat(dir.path(), "compare a.exr b.exr --tolerance 0.05 --json --difference d.png");
    assert_eq!(apart.status.code(), Some(1));
    let value: Value = serde_json::from_slice(&apart.stdout).unwrap();
    assert_eq!((&value["outliers"], &value["covered"]), (&1.into(), &12.into()));
    assert!((value["rms_covered"].as_f64().unwrap() - (0.1_f64.powi(2) / 48.0).sqrt()).abs() < 1e-6);
    let said = String::from_utf8(apart.stderr).unwrap();
    assert_eq!(said.lines().count(), 1);
    assert!(said.contains("differ by more than 0.05 in 1 pixels"), "{said}");
    let difference = Image::load(dir.path().join("d.png")).unwrap();
    assert!(difference.pixels()[7][1] > 0.99 && difference.pixels()[6][1] == 0.0);
    fs::write(dir.path().join("broken.png"), "no picture").unwrap();
    for (line, reason) in [
        ("a.exr none.exr", "cannot read none.exr"),
        ("a.exr small.exr", "4 x 3 and 3 x 3 pixels"),
        ("a.exr broken.png", "broken.png"),
        ("a.exr b.exr --tolerance 1 --difference none/d.png", "none/d.png"),
        ("a.exr b.exr --max-outliers 2", "a number from 0 to 1"),
    ] {
        let output = voxsplat(dir.path(), &format!("compare {line}"));
        let said = String::from_utf8(output.stderr).unwrap();
        assert!(output.status.code() == Some(2) && said.contains(reason), "{line}: {:?} {said}", output.status);
    }
}

#[test]
fn all_limits_of_a_comparison_must_hold() {
    let dir = folder();
    two_pictures(dir.path());
    // rms = sqrt(0.1^2 / 48) = 0.0144, psnr = 36.8 dB, one of 12 pixels is 0.083 of all.
    for (limits, exceeded) in [
        ("", &["by more than 0 in 1 pixels"][..]),
        ("--tolerance 0.2", &[]),
        ("--tolerance 0.05", &["by more than 0.05"]),
        ("--tolerance 0.05 --max-outliers 0.09", &[]),
        ("--tolerance 0.05 --max-outliers 0.08", &["over --max-outliers 0.08"]),
        ("--max-outliers 0.09", &[]),
        // Limits of the whole picture leave single pixels free, unless they are limited too.
        ("--max-rms 0.015", &[]),
        ("--max-rms 0.014", &["rms, over --max-rms 0.014"]),
        ("--min-psnr 36", &[]),
        ("--min-psnr 37", &["36.8 dB, under --min-psnr 37"]),
        ("--max-rms 0.015 --min-psnr 36 --tolerance 0.2", &[]),
        ("--max-rms 0.015 --tolerance 0.05", &["by more than 0.05"]),
        ("--max-rms 0.015 --min-psnr 37", &["--min-psnr 37"]),
        ("--max-rms 0.01 --min-psnr 40 --max-outliers 0", &["--max-outliers 0", "--max-rms 0.01", "--min-psnr 40"]),
    ] {
        let output = voxsplat(dir.path(), &format!("compare a.exr b.exr --json {limits}"));
        let said = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(i32::from(!exceeded.is_empty())), "{limits}: {said}");
        let value: Value = serde_json::from_slice(&output.stdout).unwrap();
        let found = value["exceeded"].as_array().unwrap();
        assert_eq!(found.len(), exceeded.len(), "{limits}: {found:?}");
        let fits = |(found, words): (&Value, &&str)| found.as_str().unwrap().contains(words);
        assert!(found.iter().zip(exceeded).all(fits), "{limits}: {found:?}");
        assert!(exceeded.iter().all(|words| said.contains(words)), "{limits}: {said}");
    }
    // NaN exceeds every limit.
    let image = Image::new(1, 1, vec![[f32::NAN; 4]]).unwrap();
    image.save(dir.path().join("nan.exr"), Background::Transparent).unwrap();
    for limits in ["--tolerance 9", "--max-rms 9", "--min-psnr -999"] {
        let output = voxsplat(dir.path(), &format!("compare nan.exr nan.exr {limits}"));
        assert_eq!(output.status.code(), Some(1), "{limits}");
    }
}

/// The objects that a command prints with `--json`.
fn objects(dir: &Path, line: &str) -> Vec<Value> {
    let output: Output = voxsplat(dir, &format!("{line} --json"));
    assert!(output.status.success(), "{line}: {}", String::from_utf8_lossy(&output.stderr));
    Deserializer::from_slice(&output.stdout).into_iter().map(Result::unwrap).collect()
}

#[test]
fn every_command_prints_its_result_as_json() {
    let dir = folder();
    let dir = dir.path();
    let input = ramp(dir);
    two_pictures(dir);
    let scene = json!({"volume": "demo:sphere:8", "size": 8, "reference": true,
        "outputs": [{"output": "one.png"}, {"output": "two.png", "azimuth": 90}]});
    fs::write(dir.join("s.json"), scene.to_string()).unwrap();
    let draws = format!("--adapter {}", adapter());
    let ball = "demo:nautilus:12 --size 16";
    let look = format!("{ball} --light 40,30 --light headlight --azimuth 50");
    let lines = [
        (format!("render {ball} -o a.png --save-scene b.json --save-transfer c.json {draws}"), 3),
        ("render s.json".to_owned(), 1),
        (format!("turntable {ball} --frames 2 -o {{frame}}.png {draws}"), 2),
        (format!("turntable {ball} --frames 2 -o film.gif --stats {draws}"), 1),
        (format!("plan {look} --grid 1x1x2 -o plan.json"), 1),
        ("brick plan.json 0-1 -o part.exr".to_owned(), 1),
        ("merge plan.json part.exr -o merged.png".to_owned(), 1),
        (format!("pareto demo:sphere:8 --size 16 --views 1 --repeats 1 --seconds 0.01 -o study {draws}"), 5),
        (format!("info {input}"), 0),
        (format!("info {input} --labels"), 0),
        ("compare a.exr a.exr --difference d.png".to_owned(), 1),
        ("devices".to_owned(), 0),
        ("completions bash".to_owned(), 0),
        ("man".to_owned(), 0),
        (format!("render {ball} -o e.png --max-error 0.1 --verify {draws}"), 1),
        (format!("slice demo:nautilus:12 -o slices.png --size 300 {draws}"), 1),
        ("sheet demo:nautilus:12 -o sheet.png --size 32".to_owned(), 1),
    ];
    let mut found = std::collections::BTreeMap::new();
    for (line, files) in &lines {
        for object in objects(dir, line) {
            assert_eq!(object["version"], env!("CARGO_PKG_VERSION"), "{line}");
            assert!(object["choices"].is_object(), "{line}: {object}");
            let outputs = object["outputs"].as_array().unwrap();
            assert_eq!(outputs.len(), *files, "{line}: {outputs:?}");
            assert!(outputs.iter().all(|path| dir.join(path.as_str().unwrap()).is_file()), "{line}: {outputs:?}");
            found.insert(line.as_str(), object);
        }
    }
    let of = |at: usize| &found[lines[at].0.as_str()];
    assert!(of(14)["estimate"]["error"].is_number() && of(14)["verified"]["error"].is_number(), "{}", of(14));
    let help = stdout(&voxsplat(dir, "--help"));
    let commands = help.split("Commands:\n").nth(1).unwrap().lines().take_while(|line| !line.is_empty());
    for command in commands.filter_map(|line| line.split_whitespace().next()) {
        assert!(lines.iter().any(|(line, _)| line.split(' ').next() == Some(command)), "{command}");
    }
    let nautilus = &of(0)["choices"];
    assert_eq!((&nautilus["light"], &nautilus["sharpness"]), (&json!(["studio"]), &json!(0.5)));
    assert_eq!((&nautilus["view"]["azimuth"], &nautilus["view"]["frame"]), (&json!(22.0), &json!("view")));
    assert!(["cpu", "tiles", "quads"].contains(&nautilus["painter"].as_str().unwrap()), "{nautilus}");
    assert_eq!((&of(1)["outputs"], &of(1)["choices"]["painter"]), (&json!(["two.png"]), &json!("reference")));
    assert_eq!(of(2)["choices"]["light"], json!(["studio:eye"]));
    assert_eq!((&of(3)["stats"]["frames"], &of(2)["stats"]), (&json!(2), &Value::Null));
    // Bricks and their picture have the choices of their plan.
    assert_eq!(of(4)["choices"]["light"], json!(["40,30", "headlight"]));
    assert_eq!(of(4)["choices"]["view"]["azimuth"], 50.0);
    assert!(of(5)["choices"] == of(4)["choices"] && of(6)["choices"] == of(4)["choices"]);
    assert_eq!((&of(5)["bricks"], &of(6)["bricks"]), (&json!([0, 1]), &json!(2)));
    assert!(of(7)["front"].as_array().is_some_and(|front| !front.is_empty()), "{}", of(7));
    assert_eq!((&of(8)["choices"]["preset"], &of(8)["dims"]), (&of(8)["preset"], &json!([4, 3, 2])));
    assert_eq!(of(9)["labels"].as_array().unwrap().len(), 24);
    assert_eq!(of(10)["exceeded"], json!([]));
    assert!(of(11)["adapters"][0]["name"].is_string() && of(13)["text"].as_str().unwrap().contains("voxsplat"));
    assert_eq!(objects(dir, "render s.json").len(), 2);
    refused("render demo:sphere:8 -o - --json", 2, "--json: standard output takes the picture");
    refused("turntable demo:sphere:8 -o - --json", 2, "--json: standard output takes the picture");
    // The statistics of before stay as they are.
    let line = "render demo:sphere:8 --size 8 -o a.png --reference --stats json";
    let [alone, within] = [line.to_owned(), format!("{line} --json")]
        .map(|line| serde_json::from_slice::<Value>(&voxsplat(dir, &line).stdout).unwrap());
    assert!(alone["painter"] == "reference" && alone["version"].is_null());
    assert_eq!(within["stats"]["voxels"], alone["voxels"]);
}

#[cfg(target_os = "linux")]
#[test]
fn one_trouble_with_devices_has_one_text() {
    let dir = folder();
    let said = |before: &str, line: &str| {
        let mut command = Command::new("sh");
        command.arg("-c").arg(format!("{before}; exec \"$0\" \"$@\"")).arg(env!("CARGO_BIN_EXE_voxsplat"));
        command.env("VK_DRIVER_FILES", "/none.json").env("VK_ICD_FILENAMES", "/none.json");
        let output = command.args(line.split(' ')).current_dir(dir.path()).output().unwrap();
        // The processor is listed, and draws.
        assert_eq!(output.status.code(), Some(i32::from(line != "devices")), "{before}; {line}: {output:?}");
        assert!(line != "devices" || String::from_utf8_lossy(&output.stdout).starts_with("cpu "), "{output:?}");
        let said = String::from_utf8_lossy(&output.stderr).into_owned();
        let of_us = said.lines().rfind(|line| line.contains("no graphics adapter: ")).unwrap_or_default();
        of_us.replacen("note: ", "", 1)
    };
    // With little memory the processor draws as little as a device.
    for (before, picture, words) in [
        (":", "render demo:sphere:8 --size 8 -o a.png --painter tiles", "apt-get install mesa-vulkan-drivers"),
        ("ulimit -v 300000", "render demo:sphere:8 --size 8 -o a.png", "no memory for a driver"),
    ] {
        let [listed, drawn] = ["devices", picture].map(|line| said(before, line));
        assert!(listed == drawn && listed.contains(words), "{before}: {listed} / {drawn}");
        assert_eq!(listed.contains("apt-get"), words.contains("apt-get"), "{listed}");
    }
}

#[cfg(target_os = "linux")]
#[test]
fn the_host_engine_needs_no_driver() {
    let dir = folder();
    let said = |line: &str| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_voxsplat"));
        command.env("VK_DRIVER_FILES", "/none.json").env("VK_ICD_FILENAMES", "/none.json");
        command.args(line.split(' ')).current_dir(dir.path()).output().unwrap()
    };
    let look = "demo:sphere:24 --size 24 --shading post --light off --painter cpu";
    let output = said(&format!("render {look} -o a.png --stats json"));
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let result: Value = serde_json::from_slice(&output.stdout).unwrap();
    assert!(result["painter"]["name"] == "cpu" && result["painter"]["samples"].as_u64() > Some(0), "{result}");
    for look in [look, &look.replace("--shading post --light off", "--light studio"), &format!("{look} --model mip")] {
        assert!(said(&format!("render {look} -o a.png")).status.success(), "{look}");
        let mut portable = Command::new(env!("CARGO_BIN_EXE_voxsplat"));
        portable.env("VOXSPLAT_TEST_VECTORS", "portable").args(format!("render {look} -o p.png").split(' '));
        assert!(portable.current_dir(dir.path()).output().unwrap().status.success());
        let [a, p] = ["a.png", "p.png"].map(|name| Image::load(dir.path().join(name)).unwrap());
        assert!(a == p, "{look}: other vectors give other bytes");
    }
    // Without a driver it draws by itself what no option asks a device for.
    let output = said("render demo:sphere:24 --size 24 -o d.png --json");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let result: Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(result["choices"]["painter"], "cpu");
    let output = said("render demo:sphere:24 --size 24 -o d.png --painter tiles");
    assert!(String::from_utf8_lossy(&output.stderr).contains("no graphics adapter"), "{output:?}");
    let turned = said(&format!("turntable {look} -o t.gif --frames 2"));
    assert!(turned.status.success(), "{}", String::from_utf8_lossy(&turned.stderr));
    fs::write(dir.path().join("a.obj"), "v -12 -12 0\nv 12 -12 0\nv 0 12 12\nf 1 2 3\n").unwrap();
    for options in ["-o b.exr --mesh a.obj", "-o b.png --max-error 0.1", "-o b.png --model mip --depth-coded"] {
        let output = said(&format!("render demo:sphere:24 --size 24 --painter cpu {options}"));
        assert!(output.status.success(), "{options}: {}", String::from_utf8_lossy(&output.stderr));
    }
    let [plain, with_mesh] = ["a.png", "m.png"].map(|name| {
        let mesh = if name == "m.png" { "--mesh a.obj" } else { "" };
        let line = format!("render demo:sphere:24 --size 24 -q -o {name} {mesh}");
        assert!(said(line.trim_end()).status.success());
        Image::load(dir.path().join(name)).unwrap()
    });
    assert!(plain != with_mesh, "the mesh does not show");
    let study = said("pareto demo:sphere:8 -o report --model xray --size 12 --views 1 --repeats 1 --tune sample=64");
    let note = String::from_utf8_lossy(&study.stderr);
    assert!(study.status.success() && note.contains("measuring --painter cpu alone"), "{note}");
    let output = said("render demo:sphere:24 --size 24 --painter cpu -o b.png --adapter any");
    assert!(complaint(&output).contains("--adapter: an adapter draws by quads or tiles"), "{output:?}");
}

#[cfg(target_os = "linux")]
#[test]
fn little_memory_is_no_missing_driver() {
    let dir = folder();
    // With less, it depends on the scheduler what fails first: the C library reserves 64 MiB of addresses for a thread.
    for kilobytes in [300_000, 500_000] {
        let mut command = Command::new("sh");
        command.arg("-c").arg(format!("ulimit -v {kilobytes}; exec \"$0\" \"$@\"")).arg(env!("CARGO_BIN_EXE_voxsplat"));
        command.args("render demo:sphere:8 --size 8 -o a.png --adapter".split(' ')).arg(adapter());
        let output = command.current_dir(dir.path()).output().unwrap();
        let said = complaint(&output);
        assert!(said.contains("no memory for a driver") && !said.contains("apt-get"), "{kilobytes}: {said}");
    }
}
