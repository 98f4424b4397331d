//! Every command that the README, the guide and the documents for agents show in a block of `sh` does what it says: it
//! is run, on small volumes and small pictures, in a folder with files of the names that the commands take.

use std::fs;
use std::io::Write;
use std::path::Path;
use std::process::{Command, Stdio};

use flate2::Compression;
use flate2::write::GzEncoder;

use crate::adapter::adapter;
use crate::cli::{folder, volume_file};
use crate::segmentations::slice;

/// The words of a line as a shell parts them, as far as documents need it; nothing behind a `#`.
fn words(line: &str) -> Vec<String> {
    let (mut words, mut word, mut quoted) = (Vec::new(), None::<String>, false);
    for c in line.chars() {
        match c {
            '\'' => {
                quoted = !quoted;
                word.get_or_insert_default();
            }
            '#' if !quoted && word.is_none() => break,
            c if c.is_whitespace() && !quoted => words.extend(word.take()),
            c => word.get_or_insert_default().push(c),
        }
    }
    words.extend(word);
    words
}

/// The commands of this program in the blocks of `sh` of a document: their arguments. What a pipe or a redirection adds
/// belongs to others.
fn commands(document: &str) -> Vec<Vec<String>> {
    let blocks = document.split("```sh\n").skip(1).map(|rest| rest.split("```").next().unwrap_or_default());
    let lines = blocks.flat_map(|block| block.lines().map(str::to_owned).collect::<Vec<_>>());
    let commands = lines.flat_map(|line| {
        let words = words(&line);
        let commands = words.split(|word| word == "|").map(|command| {
            let end = command.iter().position(|word| word == ">").unwrap_or(command.len());
            command[..end].to_vec()
        });
        commands.collect::<Vec<_>>()
    });
    commands.filter(|words| words.first().is_some_and(|word| word == "voxsplat")).map(|w| w[1..].to_vec()).collect()
}

/// The same command for small volumes and small pictures. A figure has at least 128 pixels a side.
fn small(command: &[String]) -> Vec<String> {
    let mut small: Vec<String> = command.to_vec();
    for word in &mut small {
        if word.starts_with("demo:") && word.matches(':').count() == 2 {
            *word = format!("{}:16", word.rsplit_once(':').unwrap().0);
        }
    }
    let draws = matches!(small[0].as_str(), "render" | "turntable" | "slice" | "sheet");
    // A figure of slices has up to four panels.
    let side = if small[0] == "slice" { "512" } else { "128" };
    let value = |small: &[String], name: &str| small.iter().position(|word| word == name).map(|at| at + 1);
    if let Some(at) = value(&small, "--frames") {
        small[at] = "8".to_owned();
    }
    // What is compared has other pixels here than its document has in mind.
    if let Some(at) = value(&small, "--tolerance") {
        small[at] = "1".to_owned();
    }
    match small.iter().position(|word| word == "--size") {
        _ if small.iter().any(|word| word == "--region") => (),
        Some(at) => small[at + 1] = if draws { side } else { "16" }.to_owned(),
        None if draws => small.extend(["--size", side].map(str::to_owned)),
        None => (),
    }
    // The processor draws isosurfaces among overlays, without an adapter.
    let by_processor = ["--iso", "--overlay"].iter().all(|option| small.iter().any(|word| word == option));
    if draws && !by_processor {
        small.extend(["--adapter".to_owned(), adapter()]);
    }
    small
}

/// A ball with a bright core, as a scan would hold it: 24^3 samples of i16, 1 mm apart.
fn samples() -> Vec<u8> {
    let value = |i: i32| {
        let [x, y, z] = [i % 24, i / 24 % 24, i / 576].map(|p| f64::from(p) - 11.5);
        let r = (x * x + y * y + z * z).sqrt();
        (1200.0 / (1.0 + (r - 5.0).exp()) + 100.0 / (1.0 + (2.0 * (r - 10.0)).exp())) as i16
    };
    (0..24 * 24 * 24).flat_map(|i| value(i).to_le_bytes()).collect()
}

/// The files that commands take.
fn lay_out(dir: &Path) {
    let samples = samples();
    let header = "NRRD0004\ntype: int16\ndimension: 3\nspace: left-posterior-superior\nsizes: 24 24 24\n\
        space directions: (1,0,0) (0,1,0) (0,0,1)\nkinds: domain domain domain\nendian: little\nencoding: raw\n\n";
    for name in ["ct.nrrd", "cells.nrrd"] {
        fs::write(dir.join(name), [header.as_bytes(), &samples].concat()).unwrap();
    }
    let channels = "NRRD0004\ntype: int16\ndimension: 4\nsizes: 2 24 24 12\nkinds: vector domain domain domain\n\
        endian: little\nencoding: raw\n\n";
    fs::write(dir.join("embryo.nrrd"), [channels.as_bytes(), &samples].concat()).unwrap();
    let labels = samples.as_chunks::<2>().0.iter().map(|&bytes| (i16::from_le_bytes(bytes) + 450) / 500);
    let labels: Vec<u8> = labels.flat_map(i16::to_le_bytes).collect();
    fs::write(dir.join("organs.nrrd"), [header.as_bytes(), &labels].concat()).unwrap();
    fs::write(dir.join("organs.ctbl"), "# Color\n1 soft_tissue 200 120 90 128\n2 core 250 240 200 255\n").unwrap();
    let mut nifti = vec![0; 352];
    let mut put = |at: usize, bytes: &[u8]| nifti[at..at + bytes.len()].copy_from_slice(bytes);
    put(0, &348_i32.to_le_bytes());
    [3_i16, 24, 24, 24, 1, 1, 1, 1].iter().enumerate().for_each(|(i, n)| put(40 + 2 * i, &n.to_le_bytes()));
    put(70, &4_i16.to_le_bytes());
    put(72, &16_i16.to_le_bytes());
    (0..4).for_each(|i| put(76 + 4 * i, &1_f32.to_le_bytes()));
    put(108, &352_f32.to_le_bytes());
    // Where the samples are in the patient.
    put(254, &1_i16.to_le_bytes());
    (0..3).for_each(|row| put(280 + 20 * row, &1_f32.to_le_bytes()));
    put(344, b"n+1\0");
    // As one volume, and as four points in time.
    for (name, dim) in [("head.nii.gz", [3_i16, 24, 24, 24, 1]), ("heart.nii.gz", [4, 24, 24, 6, 4])] {
        dim.iter().enumerate().for_each(|(i, n)| nifti[40 + 2 * i..][..2].copy_from_slice(&n.to_le_bytes()));
        let mut gzip = GzEncoder::new(Vec::new(), Compression::fast());
        gzip.write_all(&nifti).unwrap();
        gzip.write_all(&samples).unwrap();
        fs::write(dir.join(name), gzip.finish().unwrap()).unwrap();
    }
    for name in ["t1", "zmap", "atlas", "ct", "pet"] {
        fs::copy(dir.join("head.nii.gz"), dir.join(format!("{name}.nii.gz"))).unwrap();
    }
    fs::create_dir(dir.join("scans")).unwrap();
    for name in ["head.nii.gz", "ct.nrrd"] {
        fs::copy(dir.join(name), dir.join("scans").join(name)).unwrap();
    }
    let key_frames = r#"[{"frame": 0, "azimuth": 0, "elevation": 10, "zoom": 1}, {"frame": 7, "azimuth": 90}]"#;
    fs::write(dir.join("path.json"), key_frames).unwrap();
    let presets = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/data/transfer/presets.xml");
    fs::copy(presets, dir.join("presets.xml")).unwrap();
    fs::create_dir(dir.join("ct")).unwrap();
    (0..8).for_each(|n| fs::write(dir.join(format!("ct/{n}.dcm")), slice(1, n)).unwrap());
    fs::copy(volume_file("seg-binary.dcm"), dir.join("seg.dcm")).unwrap();
    let mesh = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/data/meshes/binary.ply");
    for name in ["contacts.ply", "lead.stl"] {
        fs::copy(&mesh, dir.join(name)).unwrap();
    }
    run(
        dir,
        &["render", "demo:sphere:16", "-o", "other.exr", "--size", "128", "--adapter", &adapter()].map(str::to_owned),
    );
    fs::copy(dir.join("other.exr"), dir.join("blender.exr")).unwrap();
}

fn run(dir: &Path, arguments: &[String]) {
    let mut command = Command::new(env!("CARGO_BIN_EXE_voxsplat"));
    let output = command.current_dir(dir).args(arguments).stdin(Stdio::null()).output().unwrap();
    let said = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "voxsplat {}: {said}", arguments.join(" "));
}

/// Runs the commands of a document, of which there are at least `least`.
fn all_run(document: &str, least: usize) {
    let dir = folder();
    lay_out(dir.path());
    let commands = commands(document);
    assert!(commands.len() >= least, "only {} commands found", commands.len());
    for command in commands {
        run(dir.path(), &small(&command));
    }
}

/// The chapters of the guide, one after the other.
fn guide() -> String {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../docs/guide");
    let mut chapters: Vec<_> = fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()).collect();
    chapters.sort();
    chapters.iter().map(|chapter| fs::read_to_string(chapter).unwrap()).collect()
}

#[test]
#[ignore = "slow: 5 pictures"]
fn the_commands_of_the_readme_run() {
    all_run(include_str!("../../../../README.md"), 5);
}

#[test]
#[ignore = "slow: 15 pictures"]
fn the_commands_for_agents_run() {
    all_run(include_str!("../../../../python/voxsplat/SKILL.md"), 10);
    all_run(include_str!("../../../../docs/llms.txt"), 10);
}

#[test]
#[ignore = "slow: 50 pictures"]
fn the_commands_of_the_guide_run() {
    all_run(&guide(), 50);
}

#[test]
fn commands_are_found_in_documents() {
    let document = "```sh\nvoxsplat a 'b c' # d\n  zstd x | voxsplat render - -o - > y\ncargo z\n```\nvoxsplat no\n";
    assert_eq!(commands(document), [vec!["a", "b c"], vec!["render", "-", "-o", "-"]]);
}
