//! Whole studies by clocks of a test, on a device.

use std::cell::Cell;
use std::path::Path;
use std::time::Duration;

use clap::FromArgMatches as _;
use serde_json::Value;

use crate::args;

/// Runs a study of a small sphere, each reading of whose clock is `step` seconds after the one before. Returns its
/// numbers.
fn study(directory: &Path, step: f64, more: &str) -> Value {
    let report = directory.join("report");
    let fixed = "voxsplat pareto demo:sphere:8 --model xray --size 12 --views 2 --repeats 2 --tune sample=64 -o";
    let words = fixed.split(' ').map(str::to_owned).chain([report.display().to_string()]);
    let matches = args::command().get_matches_from(words.chain(more.split(' ').map(str::to_owned)));
    let args::Command::Pareto(parsed) = args::Args::from_arg_matches(&matches).unwrap().command else {
        panic!("it is no study");
    };
    let program = args::built();
    let (name, matches) = matches.subcommand().unwrap();
    let now = Cell::new(0.0);
    let clock = || Duration::from_secs_f64(now.replace(now.get() + step));
    super::run(&parsed, (program.find_subcommand(name).unwrap(), matches), &clock).map_err(|f| f.messages).unwrap();
    serde_json::from_str(&std::fs::read_to_string(report.join("pareto.json")).unwrap()).unwrap()
}

/// Returns the number of views and of timed frames of each setting that a painter draws.
fn rows(numbers: &Value) -> Vec<(u64, usize)> {
    let measured = numbers["measurements"].as_array().unwrap();
    let drawn = measured.iter().filter(|row| row["refused"].is_null());
    drawn.map(|row| (row["views"].as_u64().unwrap(), row["frames"].as_array().unwrap().len())).collect()
}

#[test]
fn a_study_is_cut_by_its_clock_alone() {
    let dir = tempfile::tempdir().unwrap();
    // A clock that hardly moves: all views in both rounds.
    let whole = study(dir.path(), 1e-4, "--seconds 60");
    assert_eq!(whole["unmeasured"], serde_json::json!([]));
    let whole = rows(&whole);
    assert!(whole.len() > 16 && whole.iter().all(|row| *row == (2, 4)), "{whole:?}");
    // Each reading is an hour later: frames take longer than --patience, so each setting has one frame.
    let slow = rows(&study(dir.path(), 3600.0, "--seconds 0"));
    assert_eq!(slow, vec![(1, 1); whole.len()]);
    // The budget ends before the second row, and a resumed study completes it.
    let cut = study(dir.path(), 30.0, "--seconds 60 --patience 1000");
    assert_eq!((rows(&cut), cut["unmeasured"].as_array().unwrap().len() > 15), (vec![(1, 1)], true));
    assert_eq!(rows(&study(dir.path(), 30.0, "--seconds 0 --patience 1000 --resume")), whole);
}
