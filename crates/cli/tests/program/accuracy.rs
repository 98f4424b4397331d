//! Pictures that keep an error, and the report of speed against error.

use std::path::Path;
use std::process::{Command, Output};

use voxsplat::image::Image;

use crate::adapter::adapter;

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
fn the_program_keeps_and_verifies_a_bound() {
    let dir = tempfile::tempdir().unwrap();
    let scene = "render demo:vessels:24 --size 48 --azimuth 30 --light headlight";
    let output = run(dir.path(), &format!("{scene} -o a.png --max-error 1e-2 --verify"));
    assert!(output.status.success(), "{}", said(&output));
    assert!(
        said(&output).contains(
            "note: using --sharpness 0.5 --tune termination=0.002 for --max-error 0.01, found with 1 picture: 99.9 %"
        ),
        "{}",
        said(&output)
    );
    assert!(said(&output).contains("verified: 99.9 %"), "{}", said(&output));
    // The file tells what it is.
    let bytes = std::fs::read(dir.path().join("a.png")).unwrap();
    let text = String::from_utf8_lossy(&bytes);
    for note in ["Software", "voxsplat 0.", "Settings", "Estimated error", "99.9 %"] {
        assert!(text.contains(note), "{note}");
    }
    // A bound that nothing keeps: the picture is written, and the exit code tells.
    let output = run(dir.path(), &format!("{scene} -o b.exr --shading post --max-error 1e-7 --verify"));
    assert_eq!(output.status.code(), Some(1));
    assert!(said(&output).contains("--max-error 0.0000001 is exceeded"), "{}", said(&output));
    assert!(Image::load(dir.path().join("b.exr")).is_ok());
    let output = run(dir.path(), &format!("{scene} -o c.png --verify --stats json"));
    let stats: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    assert!(stats["verified"]["error"].as_f64().unwrap() < 0.02);
}

#[test]
fn searches_skip_settings_that_cannot_be_drawn() {
    let dir = tempfile::tempdir().unwrap();
    let scene = "demo:sphere:32 --size 8";
    // Kernels have grown over what tiles takes at level 0, which both searches try.
    let refused = run(dir.path(), &format!("render {scene} -o a.png --painter tiles --level 0"));
    let reason = "tiles draws kernels that reach at most 4 voxels";
    assert!(refused.status.code() == Some(2) && said(&refused).contains(reason), "{}", said(&refused));
    let chosen = run(dir.path(), &format!("render {scene} -o a.png --max-error 1e-6 --tune sample=64"));
    assert!(chosen.status.success() && said(&chosen).contains("all of which exceed --max-error"), "{}", said(&chosen));
    let study = "--views 1 --repeats 1 --seconds 0 --tune sample=64 --model xray -o report";
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
    let command = "pareto demo:sphere:8 -o report --model xray --size 12 --views 2 --repeats 1 --tune sample=64 \
                   --seconds 0 --patience 1000000";
    let command = &format!("{command} --transfer {}", transfer.display());
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
    assert!(
        !page.contains("Not measured") && !page.contains("--resume") && numbers["unmeasured"] == serde_json::json!([])
    );
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

/// A budget that is used up at once: the most telling row is there, the rest is named, and the printed command adds it.
#[test]
fn a_study_whose_time_is_used_up_is_a_whole_report_and_goes_on() {
    let dir = tempfile::tempdir().unwrap();
    // No frame is slow, however busy the machine is.
    let study = "pareto demo:sphere:8 -o report --model xray --size 12 --views 2 --repeats 2 --tune sample=64 \
                 --patience 1000000";
    let output = run(dir.path(), &format!("{study} --seconds 1e-9"));
    assert!(output.status.success(), "{}", said(&output));
    let read = |name: &str| std::fs::read_to_string(dir.path().join("report").join(name)).unwrap();
    let numbers = || serde_json::from_str::<serde_json::Value>(&read("pareto.json")).unwrap();
    let count = |numbers: &serde_json::Value, list: &str| numbers[list].as_array().unwrap().len();
    let first = numbers();
    let measured = &first["measurements"][0];
    assert_eq!((count(&first, "measurements"), measured["name"].as_str()), (1, Some("cpu")), "{first}");
    assert_eq!((count(measured, "frames"), measured["views"].as_u64()), (1, Some(1)), "{first}");
    let all = count(&first, "unmeasured") + 1;
    assert!(all > 16, "{all}");
    let page = read("report.html");
    assert!(page.ends_with("</html>\n") && page.contains("<svg") && page.contains("data:image/png;base64,"));
    assert!(page.contains("<h2>Not measured</h2>") && page.contains("quads, f16"), "{page}");
    assert_eq!((read("pareto.csv").lines().count(), read("time-rms.svg").matches("</svg>").count()), (2, 1));
    let printed = String::from_utf8(output.stdout).unwrap();
    let missing = format!("{} of {all} settings are not measured, 1 are measured in fewer frames", all - 1);
    assert!(printed.contains(&missing), "{printed}");
    let rest = printed.lines().last().unwrap().split(": voxsplat ").nth(1).unwrap();
    assert!(rest.ends_with(" --resume --seconds 0") && page.contains(rest), "{rest}");

    let program = env!("CARGO_BIN_EXE_voxsplat");
    let output = Command::new(program).current_dir(dir.path()).args(rest.split_whitespace()).output().unwrap();
    assert!(output.status.success(), "{}", said(&output));
    let whole = numbers();
    assert_eq!((count(&whole, "measurements"), count(&whole, "unmeasured")), (all, 0));
    // All views, in both rounds.
    let rows = whole["measurements"].as_array().unwrap();
    let is_whole = |row: &&serde_json::Value| row["views"].as_u64() == Some(2) && count(row, "frames") >= 4;
    assert_eq!(rows.iter().filter(is_whole).count(), rows.iter().filter(|row| row["refused"].is_null()).count());
    assert!(!read("report.html").contains("Not measured"));
    let wrong = run(dir.path(), &format!("{study} --seconds -1"));
    assert!(
        wrong.status.code() == Some(2) && said(&wrong).contains("expected a number, 0 or over"),
        "{}",
        said(&wrong)
    );
}
