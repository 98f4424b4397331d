//! Every reader, on randomly mutated files: each execution returns a value or an error of one line, without a panic and
//! in bounded memory.
//!
//! Execution n of a target is the same in every run. `VOXSPLAT_FUZZ_RUNS` is the number of executions of all targets
//! together; the long run has 1 000 000. `VOXSPLAT_FUZZ_FIRST` is the number of the first execution of each target, to
//! repeat a failed execution. `VOXSPLAT_FUZZ_TARGET` restricts the run to one target.

#[path = "../../../fuzz/targets.rs"]
#[allow(unreachable_pub, reason = "the file is shared with the crate of cargo-fuzz")]
pub(crate) mod targets;

use std::io::{Read, Write};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;
use std::process::Command;

use flate2::read::MultiGzDecoder;
use flate2::write::GzEncoder;
use flate2::{Compression, Crc};
use voxsplat::image::{Background, Image};

use targets::{Place, TARGETS};

use crate::formats::fixtures::path;
use crate::root;
use crate::support::own_name;

/// Executions in an ordinary run.
const RUNS: usize = 5_000;

/// The memory limit of a process of executions, in KiB. Its inputs have a few KiB each, and 2 MiB if unpacked.
const MEMORY: usize = 1_500_000;

/// The environment variable that marks the process with limited memory.
const LIMITED: &str = "VOXSPLAT_FUZZ_LIMITED";

/// Marsaglia's xorshift: the same changes in every run.
struct Random(u64);

impl Random {
    fn next(&mut self) -> u64 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        self.0
    }

    fn below(&mut self, n: usize) -> usize {
        // The low bits of neighbouring seeds are alike.
        (self.next() >> 20) as usize % n.max(1)
    }

    fn of<'a, T: ?Sized>(&mut self, choice: &[&'a T]) -> &'a T {
        choice[self.below(choice.len())]
    }
}

/// Text with a meaning in one of the headers.
const WORDS: [&[u8]; 34] = [
    b"0",
    b"1",
    b"-1",
    b"2",
    b"65535",
    b"65536",
    b"2147483648",
    b"4294967296",
    b"9223372036854775807",
    b"18446744073709551615",
    b"1e308",
    b"1e-310",
    b"nan",
    b"-inf",
    b"0.1",
    b" ",
    b"\n",
    b"\r\n",
    b"\t",
    b"\0",
    b":",
    b":=",
    b"=",
    b",",
    b"(",
    b")",
    b"{",
    b"}",
    b"[",
    b"\"",
    b"LIST",
    b"%d",
    b"none",
    b"\xff\x80",
];

/// Numbers that are likely ends of ranges.
const NUMBERS: [u64; 12] =
    [0, 1, 0x7f, 0x80, 0xff, 0x7fff, 0xffff, 0x7fff_ffff, 0xffff_ffff, 0x7f80_0000, 0x7ff0_0000_0000_0000, u64::MAX];

/// One change of a file.
fn change(bytes: &mut Vec<u8>, others: &[Vec<u8>], random: &mut Random) {
    // Most faults lie in the first bytes.
    let reach = if random.below(2) == 0 { bytes.len() } else { bytes.len().min(400) };
    let at = random.below(reach);
    let end = bytes.len().min(at + 1 + random.below(40));
    match random.below(10) {
        0 if at < bytes.len() => bytes[at] ^= 1 << random.below(8),
        1 if at < bytes.len() => bytes[at] = random.next() as u8,
        2 => drop(bytes.drain(at..end)),
        3 => drop(bytes.splice(at..at, random.of(&WORDS).iter().copied())),
        4 => bytes.truncate(at),
        5 => {
            let piece = bytes[at..end].to_vec();
            let to = random.below(reach);
            drop(bytes.splice(to..to, piece));
        }
        6 => {
            // The head of this file, the tail of another.
            let other = &others[random.below(others.len())];
            bytes.truncate(at);
            bytes.extend_from_slice(&other[random.below(other.len())..]);
        }
        7 => {
            // A number in text becomes another.
            let digits = |b: &u8| b.is_ascii_digit();
            if let Some(start) = bytes[at..].iter().position(digits).map(|n| at + n) {
                let length = bytes[start..].iter().take_while(|b| digits(b)).count();
                let number = random.of(&WORDS[..15]);
                drop(bytes.splice(start..start + length, number.iter().copied()));
            }
        }
        8 => {
            // A binary number becomes another, of either byte order.
            let (size, number) = (1 << random.below(4), NUMBERS[random.below(NUMBERS.len())]);
            let mut number = number.to_le_bytes()[..size].to_vec();
            if random.below(2) == 0 {
                number.reverse();
            }
            let at = at & !1;
            if let Some(place) = bytes.get_mut(at..at + size) {
                place.copy_from_slice(&number);
            }
        }
        _ => {
            // A line changes its place.
            let lines: Vec<&[u8]> = bytes.split_inclusive(|b| *b == b'\n').collect();
            let (from, to) = (random.below(lines.len()), random.below(lines.len()));
            let mut moved = lines.clone();
            let line = moved.remove(from.min(moved.len() - 1));
            moved.insert(to.min(moved.len()), line);
            *bytes = moved.concat();
        }
    }
}

fn gzip(bytes: &[u8]) -> Vec<u8> {
    let mut encoder = GzEncoder::new(Vec::new(), Compression::fast());
    encoder.write_all(bytes).unwrap();
    encoder.finish().unwrap()
}

/// Corrects the checksums of a PNG, so that changes get past them.
fn with_checksums(mut png: Vec<u8>) -> Vec<u8> {
    let mut at = 8;
    while let Some(length) = png.get(at..at + 4).map(|b| u32::from_be_bytes(b.try_into().unwrap()) as usize) {
        let end = at.saturating_add(8).saturating_add(length);
        let Some(chunk) = png.get(at + 4..end) else { break };
        let mut crc = Crc::new();
        crc.update(chunk);
        let Some(sum) = png.get_mut(end..end + 4) else { break };
        sum.copy_from_slice(&crc.sum().to_be_bytes());
        at = end + 4;
    }
    png
}

/// The input of one execution.
fn input(target: &str, seeds: &[Vec<u8>], random: &mut Random) -> Vec<u8> {
    let mut bytes = seeds[random.below(seeds.len())].clone();
    let unpacked = bytes.starts_with(&[0x1f, 0x8b]) && random.below(2) == 0;
    if unpacked {
        let mut inside = Vec::new();
        MultiGzDecoder::new(bytes.as_slice()).read_to_end(&mut inside).unwrap();
        bytes = inside;
    }
    for _ in 0..1 + random.below(5) {
        if bytes.is_empty() {
            break;
        }
        change(&mut bytes, seeds, random);
    }
    if unpacked || random.below(50) == 0 {
        bytes = gzip(&bytes);
        // Sometimes also a change of the compressed data itself.
        if random.below(8) == 0 {
            change(&mut bytes, seeds, random);
        }
    }
    if target == "png" && random.below(4) != 0 {
        bytes = with_checksums(bytes);
    }
    bytes
}

/// The files that executions of a target begin from.
fn seeds(target: &str, endings: &[&str]) -> Vec<Vec<u8>> {
    let mut files: Vec<_> = std::fs::read_dir(path("")).unwrap().map(|entry| entry.unwrap().path()).collect();
    files.sort();
    let fits = |file: &Path| endings.iter().any(|ending| file.to_str().unwrap().ends_with(ending));
    let read = |file: &Path| std::fs::read(file).unwrap();
    match target {
        "raw" => {
            let options = |kind: u8| [3, 4, 5, 1, kind, 0x10, 0, kind & 1, 128, 128, 128, 0, 0, 0, 0, 0];
            let samples = files.iter().filter(|file| fits(file)).map(|file| read(file));
            samples.enumerate().map(|(i, samples)| [&options(i as u8), samples.as_slice()].concat()).collect()
        }
        "data" => {
            let samples = files.iter().filter(|file| fits(file)).map(|file| read(file));
            let text = (0..60).map(|n| format!("{n} ")).collect::<String>().into_bytes();
            let all = samples.chain([text, b"00".repeat(62)]);
            all.enumerate().map(|(i, samples)| [&[i as u8], samples.as_slice()].concat()).collect()
        }
        "transfer" => {
            let root = root();
            let own = ["examples/surface.json", "benches/sparse.json"].map(|file| root.join(file));
            let folder = std::fs::read_dir(root.join("tests/data/transfer")).unwrap();
            let mut others: Vec<_> = folder.map(|entry| entry.unwrap().path()).collect();
            others.retain(|file| fits(file) && !file.ends_with("expected.json"));
            others.sort();
            own.iter().chain(&others).map(|file| read(file)).collect()
        }
        "ply" | "stl" | "obj" | "vtp" => {
            let folder = root().join("tests/data/meshes");
            let mut files: Vec<_> = std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()).collect();
            files.sort();
            files.iter().filter(|file| fits(file)).map(|file| read(file)).collect()
        }
        "png" | "exr" => {
            let folder = tempfile::tempdir().unwrap();
            let file = folder.path().join(format!("a.{target}"));
            let picture = |width: u32, height: u32, background: &str| {
                let pixels = (0..width * height).map(|i| [i as f32 / 99.0, 0.25, 0.0, 0.5]).collect();
                Image::new(width, height, pixels)
                    .unwrap()
                    .save(&file, background.parse::<Background>().unwrap())
                    .unwrap();
                read(&file)
            };
            vec![picture(1, 1, "transparent"), picture(7, 3, "transparent"), picture(9, 40, "white")]
        }
        _ => files.iter().filter(|file| fits(file)).map(|file| read(file)).collect(),
    }
}

fn number(variable: &str) -> Option<usize> {
    std::env::var(variable).ok().map(|text| text.parse().unwrap_or_else(|_| panic!("{variable}={text}")))
}

/// Runs this test again in a process with limited memory: an allocation that fails without an error aborts the process.
fn in_limited_memory(runs: usize) {
    let program = std::env::current_exe().unwrap();
    let mut command = Command::new("sh");
    command.arg("-c").arg(format!("ulimit -v {MEMORY}; exec \"$0\" \"$@\"")).arg(program);
    let name = own_name(module_path!(), "changed_files_end_in_a_value_or_in_one_line");
    let status = command
        .args(["--exact", &name, "--nocapture"])
        .env(LIMITED, "1")
        .env("VOXSPLAT_FUZZ_RUNS", runs.to_string())
        .status()
        .unwrap();
    assert!(status.success(), "{status}");
}

#[test]
fn changed_files_end_in_a_value_or_in_one_line() {
    if cfg!(target_os = "linux") && std::env::var_os(LIMITED).is_none() {
        return in_limited_memory(number("VOXSPLAT_FUZZ_RUNS").unwrap_or(RUNS));
    }
    // Readers work in parallel; with few samples the hand-over takes most of the time.
    rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap().install(execute);
}

#[cfg(target_os = "linux")]
#[test]
#[ignore = "slow: 40 000 files"]
fn many_changed_files_end_in_a_value_or_in_one_line() {
    in_limited_memory(8 * RUNS);
}

#[expect(clippy::print_stdout, reason = "the long run is read by who started it")]
fn execute() {
    let only = std::env::var("VOXSPLAT_FUZZ_TARGET").ok();
    let targets: Vec<_> = TARGETS.iter().filter(|(name, ..)| only.as_deref().is_none_or(|o| o == *name)).collect();
    let runs = number("VOXSPLAT_FUZZ_RUNS").unwrap_or(RUNS).div_ceil(targets.len());
    let first = number("VOXSPLAT_FUZZ_FIRST").unwrap_or(0);
    let folder = tempfile::tempdir().unwrap();
    let place = Place::new(folder.path(), Path::new(&path(""))).unwrap();
    for &(name, target, endings) in targets {
        let seeds = if name == "zarr" { place.zarr_seeds() } else { seeds(name, endings) };
        let accepted = seeds.iter().filter(|seed| target(&place, seed)).count();
        assert!(accepted > 0, "{name}: no seed is accepted");
        let mut accepted = 0;
        for n in first..first + runs {
            let mut random = Random(0x9E37_79B9_7F4A_7C15 ^ ((n as u64 + 1) << 20));
            let bytes = input(name, &seeds, &mut random);
            match catch_unwind(AssertUnwindSafe(|| target(&place, &bytes))) {
                Ok(read) => accepted += usize::from(read),
                Err(_) => panic!("{name}: execution {n} failed: VOXSPLAT_FUZZ_FIRST={n} VOXSPLAT_FUZZ_RUNS=1"),
            }
        }
        let refused = runs - accepted;
        println!("{name}: {accepted} accepted, {refused} refused");
        // Both outcomes occur, or the changes are too tame or too wild to find faults.
        assert!(
            runs < 1000 || (accepted > runs / 100 && refused > runs / 100),
            "{name}: {accepted} of {runs} accepted"
        );
    }
}
