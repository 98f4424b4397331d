//! Pictures that keep an error, predictions, and the report of speed against error.

use std::path::Path;
use std::process::{Command, Output};

use voxsplat::accuracy::{Truth, choose};
use voxsplat::camera::ProjectionKind;
use voxsplat::error::Error;
use voxsplat::image::Image;
use voxsplat::layers::Layers;
use voxsplat::settings::{Level, Painter, Resolution, Settings, Shading};

use crate::adapter::adapter;
use crate::support::{PERSPECTIVE, RENDERER, camera, demo, draw, headlight, prepare, transfer, with_quads, with_tiles};

/// Runs the program in `dir` on the adapter of the tests.
fn run(dir: &Path, arguments: &str) -> Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_voxsplat"));
    let command = command.current_dir(dir).args(arguments.split_whitespace());
    command.args(["--adapter", &adapter()]).output().unwrap()
}

fn said(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).lines().filter_map(|l| l.strip_prefix("voxsplat: ")).collect()
}

#[test]
fn chosen_settings_keep_the_bound() {
    let (volume, transfer) = demo("vessels", 24);
    let camera = camera(33.0, PERSPECTIVE, &volume, 64);
    let lit = Settings { lighting: headlight(), ..Settings::default() };
    let post = Settings { shading: Shading::Post, ..lit.clone() };
    for (settings, bound) in [(&lit, 3e-2), (&lit, 3e-4), (&post, 1e-2)] {
        let chosen = choose(&RENDERER, &Layers::of(&volume, &transfer), &camera, settings, bound, 4096).unwrap();
        assert!(chosen.keeps && chosen.estimate.error <= bound, "{bound}: {:?}", chosen.estimate);
        // All pixels: the choice saw as many.
        let truth = Truth::trace(&Layers::of(&volume, &transfer), &camera, &chosen.settings, u32::MAX).unwrap();
        let all = truth.estimate(&chosen.rendered.image).unwrap();
        assert!(all.error <= bound, "{bound}: {all:?}");
        // What is drawn stays, and the picture is that of the settings.
        assert_eq!((chosen.settings.shading, &chosen.settings.lighting), (settings.shading, &settings.lighting));
        let again = draw(&prepare(&volume, &transfer, &chosen.settings), &camera, &chosen.settings);
        assert_eq!(again.image, chosen.rendered.image);
        assert_eq!(chosen.tried.last().unwrap().settings, chosen.settings);
    }
}

#[test]
fn a_loose_bound_costs_less_than_a_tight_one() {
    let (volume, transfer) = demo("vessels", 24);
    let camera = camera(33.0, PERSPECTIVE, &volume, 48);
    let settings = Settings { lighting: headlight(), ..Settings::default() };
    let of = |bound| choose(&RENDERER, &Layers::of(&volume, &transfer), &camera, &settings, bound, 1024).unwrap();
    let (loose, tight) = (of(3e-2), of(1e-4));
    assert_eq!(loose.tried.len(), 1, "the defaults keep it");
    assert!(
        tight.tried.len() > 1 && matches!(tight.settings.painter, Painter::Quads(quads) if quads.sheet_thickness < 1.0),
        "{:?}",
        tight.settings
    );
    assert!(tight.settings.termination < loose.settings.termination);
}

#[test]
fn a_bound_that_nothing_keeps_is_said_to_be_broken() {
    let (volume, transfer) = demo("shell", 16);
    let camera = camera(33.0, PERSPECTIVE, &volume, 32);
    let settings = Settings { shading: Shading::Post, ..Settings::default() };
    let chosen = choose(&RENDERER, &Layers::of(&volume, &transfer), &camera, &settings, 1e-7, 1024).unwrap();
    let least = chosen.tried.iter().map(|tried| tried.estimate.error).fold(f64::INFINITY, f64::min);
    assert!(!chosen.keeps && chosen.estimate.error == least && chosen.tried.len() >= 2);
    for bound in [0.0, f64::NAN, f64::INFINITY] {
        let refused = choose(&RENDERER, &Layers::of(&volume, &transfer), &camera, &settings, bound, 1024);
        assert!(matches!(refused, Err(Error::Setting { name: "max_error", .. })));
    }
}

#[test]
fn predictions_hold_and_name_their_causes() {
    let (volume, transfer) = demo("vessels", 24);
    let camera = camera(33.0, PERSPECTIVE, &volume, 64);
    let base = Settings { lighting: headlight(), termination: 0.0, ..Settings::default() };
    let truth = Truth::trace(&Layers::of(&volume, &transfer), &camera, &base, u32::MAX).unwrap();
    let scene = prepare(&volume, &transfer, &base);
    let mut predicted = Vec::new();
    for thickness in [0.5, 1.0, 2.0] {
        let settings = with_quads(&base, |quads| quads.sheet_thickness = thickness);
        let rendered = draw(&scene, &camera, &settings);
        let error = truth.estimate(&rendered.image).unwrap().error;
        assert!(rendered.stats.predicted.error() >= error, "{thickness}: {error} {:?}", rendered.stats.predicted);
        predicted.push(rendered.stats.predicted.order);
    }
    assert!(predicted[0] < predicted[1] && predicted[1] < predicted[2], "{predicted:?}");
    let early = draw(&scene, &camera, &Settings { termination: 0.01, ..base.clone() }).stats.predicted;
    assert_eq!(early.termination, 0.01);
    let coarse = draw(&scene, &camera, &Settings { level: Level::At(1), ..base }).stats;
    assert!(coarse.predicted.level > 0.0 && coarse.to_string().contains("predicted    error at most"));
}

/// A step of the transfer function turns jumps of kernels at their rims into another colour.
#[test]
fn steps_of_a_transfer_function_are_predicted() {
    let (volume, _) = demo("vessels", 24);
    let camera = camera(33.0, ProjectionKind::Orthographic, &volume, 48);
    let from = |low: f64| {
        let red = |value, opacity| (value, [1.0, 0.2, 0.1], opacity);
        transfer(&[red(low, 0.0), red(0.5, 0.3), red(254.0, 0.3)], Some(1.0))
    };
    let post = Settings { shading: Shading::Post, level: Level::At(0), ..Settings::default() };
    for settings in [with_quads(&post, |_| {}), with_tiles(&post, Resolution::Full)] {
        let [step, ramp] = [0.5, -100.0].map(|low| {
            let transfer = from(low);
            let truth = Truth::trace(&Layers::of(&volume, &transfer), &camera, &settings, u32::MAX).unwrap();
            let drawn = draw(&prepare(&volume, &transfer, &settings), &camera, &settings);
            let error = truth.estimate(&drawn.image).unwrap().error;
            (error, drawn.stats.predicted.interpolation)
        });
        assert!(step.0 > 0.1 && step.1 >= step.0, "{step:?}");
        assert!(ramp.0 < 0.1 && ramp.1 < step.1 / 2.0, "{ramp:?}");
    }
}

#[test]
fn the_program_keeps_and_verifies_a_bound() {
    let dir = tempfile::tempdir().unwrap();
    let scene = "render demo:vessels:24 --size 48 --azimuth 30 --light headlight";
    let output = run(dir.path(), &format!("{scene} -o a.png --max-error 1e-2 --verify"));
    assert!(output.status.success(), "{}", said(&output));
    assert!(said(&output).contains("note: --max-error 0.01 takes --termination 0.002: 99.9 %"), "{}", said(&output));
    assert!(said(&output).contains("verified: 99.9 %"), "{}", said(&output));
    // The file tells what it is.
    let bytes = std::fs::read(dir.path().join("a.png")).unwrap();
    let text = String::from_utf8_lossy(&bytes);
    for note in ["Software", "voxsplat 0.", "Settings", "Predicted error", "Estimated error", "99.9 %"] {
        assert!(text.contains(note), "{note}");
    }
    // A bound that nothing keeps: the picture is written, and the exit code tells.
    let output = run(dir.path(), &format!("{scene} -o b.exr --shading post --max-error 1e-7 --verify"));
    assert_eq!(output.status.code(), Some(1));
    assert!(said(&output).contains("--max-error 0.0000001 is broken"), "{}", said(&output));
    assert!(Image::load(dir.path().join("b.exr")).is_ok());
    let output = run(dir.path(), &format!("{scene} -o c.png --verify --stats json"));
    let stats: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    assert!(stats["verified"]["error"].as_f64().unwrap() < 0.02 && stats["predicted"]["order"].is_number());
}

#[test]
fn searches_skip_settings_that_cannot_be_drawn() {
    let dir = tempfile::tempdir().unwrap();
    let scene = "demo:sphere:32 --size 8";
    // Kernels have grown over what tiles takes at level 0, which both searches try.
    let refused = run(dir.path(), &format!("render {scene} -o a.png --painter tiles --resolution full --level 0"));
    let reason = "tiles draws kernels that reach at most 4 voxels";
    assert!(refused.status.code() == Some(2) && said(&refused).contains(reason), "{}", said(&refused));
    let chosen = run(dir.path(), &format!("render {scene} -o a.png --max-error 1e-6 --sample 64"));
    assert!(chosen.status.success() && said(&chosen).contains("ways to draw"), "{}", said(&chosen));
    let study = "--views 1 --repeats 1 --sample 64 --model xray -o report";
    let study = run(dir.path(), &format!("pareto {scene} {study}"));
    assert!(study.status.success(), "{}", said(&study));
    let numbers = std::fs::read_to_string(dir.path().join("report/pareto.json")).unwrap();
    let numbers: serde_json::Value = serde_json::from_str(&numbers).unwrap();
    let of = |measured: &serde_json::Value| measured["refused"].as_str().is_some_and(|text| text.contains(reason));
    let refused = numbers["measurements"].as_array().unwrap().iter().filter(|measured| of(measured)).count();
    assert!(refused > 0, "{numbers}");
}

#[test]
fn the_report_is_whole_and_goes_on_where_it_was_interrupted() {
    let dir = tempfile::tempdir().unwrap();
    let point = |value: f64| serde_json::json!({"value": value, "color": "#ffffff", "opacity": value / 2.0});
    let transfer = dir.path().join("t.json");
    std::fs::write(&transfer, serde_json::json!({"points": [point(0.0), point(1.0)]}).to_string()).unwrap();
    let command = "pareto demo:sphere:8 -o report --model xray --size 12 --views 2 --repeats 1 --sample 64 --transfer";
    let command = &format!("{command} {}", transfer.display());
    let output = run(dir.path(), command);
    assert!(output.status.success(), "{}", said(&output));
    let read = |name: &str| std::fs::read_to_string(dir.path().join("report").join(name)).unwrap();
    let numbers: serde_json::Value = serde_json::from_str(&read("pareto.json")).unwrap();
    let count = numbers["measurements"].as_array().unwrap().len();
    assert!(count > 16, "{count}");
    let csv = read("pareto.csv");
    assert_eq!(csv.lines().count(), count + 1);
    assert!(csv.contains("--model xray") && csv.contains("-o picture.png --painter tiles\""), "{csv}");
    let page = read("report.html");
    assert!(page.contains("<svg") && page.contains("data:image/png;base64,"));
    for text in [page.clone(), csv, read("pareto.json")] {
        assert!(text.contains("--transfer t.json") && !text.contains(dir.path().to_str().unwrap()), "{text}");
    }
    assert!(!page.contains("src=\"http") && !page.contains("href="), "it needs no other file");
    assert!(read("time-rms.svg").contains("</svg>") && read("time-p999.svg").contains("</svg>"));
    assert!(String::from_utf8_lossy(&output.stdout).contains("report: report/report.html"));

    let small = run(dir.path(), &format!("{command} --scale-bar"));
    assert!(small.status.code() == Some(2) && said(&small).contains("for a figure"), "{}", said(&small));
    let missing = run(dir.path(), "pareto missing.nrrd -o other");
    assert!(missing.status.code() == Some(1) && !dir.path().join("other").exists(), "{}", said(&missing));

    // What was measured is not measured again.
    let mut kept = numbers.clone();
    kept["measurements"].as_array_mut().unwrap().truncate(count - 1);
    std::fs::write(dir.path().join("report/pareto.json"), kept.to_string()).unwrap();
    assert!(run(dir.path(), &format!("{command} --resume")).status.success());
    let again: serde_json::Value = serde_json::from_str(&read("pareto.json")).unwrap();
    assert_eq!(again["measurements"][0], numbers["measurements"][0]);
    assert_eq!(again["measurements"].as_array().unwrap().len(), count);
    // Another command is not the one that was interrupted.
    let other = run(dir.path(), &format!("{command} --zoom 2 --resume"));
    assert!(other.status.code() == Some(1) && said(&other).contains("another command"), "{}", said(&other));
    // Nor are other data of the same name.
    std::fs::create_dir(dir.path().join("other")).unwrap();
    std::fs::write(
        dir.path().join("other/t.json"),
        serde_json::json!({"points": [point(0.0), point(0.5)]}).to_string(),
    )
    .unwrap();
    let other = command.replace(transfer.to_str().unwrap(), "other/t.json");
    let other = run(dir.path(), &format!("{other} --resume"));
    assert!(other.status.code() == Some(1) && said(&other).contains("of other data"), "{}", said(&other));
    let rivals = dir.path().join("rivals.json");
    std::fs::write(&rivals, r#"[{"name": "a ray caster", "seconds": 0.1, "rms": 0.01}]"#).unwrap();
    assert!(run(dir.path(), &format!("{command} --resume --rivals rivals.json")).status.success());
    assert!(read("time-rms.svg").contains("a ray caster") && !read("time-p999.svg").contains("a ray caster"));
    std::fs::write(&rivals, "[{}]").unwrap();
    let broken = run(dir.path(), &format!("{command} --resume --rivals rivals.json"));
    assert!(broken.status.code() == Some(1) && said(&broken).contains("rivals.json: line 1 column "));
}
