//! Constants that are written down more than once: in shaders, and on the host.

use std::collections::BTreeMap;
use std::fs;

use crate::root;

/// Constants of shaders that share only their name with a constant elsewhere: the name, the file, and what it is.
const HOMONYMS: &[(&str, &str, &str)] = &[
    ("DENSITY", "shaders/common/response.wgsl", "the natural logarithm of 10 to the power of the host's"),
    ("FAINT", "shaders/common/sweep.wgsl", "the depth of a voxel; the host's is the least depth of a vector of voxels"),
    ("FAR", "shaders/common/rays.wgsl", "a distance along rays"),
    ("FAR", "shaders/common/samples.wgsl", "a sample"),
    ("FILM", "shaders/common/response.wgsl", "the number of a response"),
    ("LANES", "shaders/common/sweep.wgsl", "invocations of a workgroup; those of the host are floats of vectors"),
    ("PER_BRICK", "shaders/page_table.wgsl", "a quotient on the host, which constants_are_those_of_the_host compares"),
    ("RUN", "shaders/scan.wgsl", "numbers that an invocation adds up"),
    ("RUN", "shaders/terminate.wgsl", "splats that an invocation hides"),
    ("VALUES", "shaders/common/transfer.wgsl", "a row of a table"),
    ("WINDOW", "shaders/common/response.wgsl", "the number of a response"),
];

/// Files of the host that state the same model twice, so that one is the truth of the other.
const TWINS: &[[&str; 2]] = &[["src/reference/media.rs", "src/splats/layers.rs"]];

/// A constant: its name, the file, and its value as plain text.
type Constant = (String, String, String);

/// The files with this ending in a folder and the folders in it, with their text.
fn files(folder: &str, ending: &str, found: &mut BTreeMap<String, String>) {
    for entry in fs::read_dir(root().join(folder)).unwrap() {
        let path = entry.unwrap().path();
        let name = format!("{folder}/{}", path.file_name().unwrap().to_str().unwrap());
        if path.is_dir() {
            files(&name, ending, found);
        } else if name.ends_with(ending) {
            found.insert(name, fs::read_to_string(path).unwrap());
        }
    }
}

/// A value without the words by which the languages differ: numbers as f64, no types of vectors, no casts.
fn plain(value: &str) -> String {
    let value = value.replace(" as usize", "").replace("u32::MAX", "4294967295").replace('_', "");
    let parts = value.split(|c: char| !(c.is_alphanumeric() || c == '.')).filter(|part| !part.is_empty());
    let number = |part: &str| -> String {
        let digits = part.trim_end_matches(['u', 'f']);
        let whole = digits.strip_prefix("0x").and_then(|hex| u64::from_str_radix(hex, 16).ok());
        whole.map(|n| n as f64).or_else(|| digits.parse().ok()).map_or_else(|| part.to_owned(), |n: f64| n.to_string())
    };
    let parts: Vec<String> = parts.filter(|part| !part.starts_with("vec")).map(number).collect();
    // `1e-30` falls apart into two parts in both languages alike.
    parts.join(" ")
}

/// The constants of files, each in one line.
fn constants(files: &BTreeMap<String, String>) -> Vec<Constant> {
    let mut found = Vec::new();
    for (file, text) in files {
        for line in text.lines().map(str::trim_start) {
            let Some((_, rest)) =
                line.split_once("const ").filter(|(before, _)| before.is_empty() || before.starts_with("pub"))
            else {
                continue;
            };
            let Some((name, value)) = rest.trim_end().strip_suffix(';').and_then(|rest| rest.split_once(" = ")) else {
                continue;
            };
            let name = name.split(':').next().unwrap_or_default().to_owned();
            if name.chars().all(|c| c.is_ascii_uppercase() || c.is_ascii_digit() || c == '_') {
                found.push((name, file.clone(), plain(value)));
            }
        }
    }
    found
}

/// The constants of the shaders, and of the host.
fn all() -> [Vec<Constant>; 2] {
    [(&["shaders"][..], ".wgsl"), (&["src", "crates/volume/src"], ".rs")].map(|(folders, ending)| {
        let mut found = BTreeMap::new();
        folders.iter().for_each(|folder| files(folder, ending, &mut found));
        constants(&found)
    })
}

#[test]
fn a_constant_has_one_value_in_all_shaders_and_on_the_host() {
    let [shaders, host] = all();
    // FAINT was 7 in sweep.wgsl, and 5.5 in converging.wgsl and on the host.
    assert!(shaders.len() > 40 && host.len() > 200, "{} {}", shaders.len(), host.len());
    let mut homonyms = Vec::new();
    for (name, file, value) in &shaders {
        let namesakes = |of: &[Constant]| -> Vec<String> {
            of.iter().filter(|(other, at, _)| other == name && at != file).map(|(.., value)| value.clone()).collect()
        };
        let (in_shaders, on_host) = (namesakes(&shaders), namesakes(&host));
        let differs = in_shaders.iter().any(|other| other != value)
            || !on_host.is_empty()
                && !on_host.contains(value)
                && !in_shaders.iter().any(|other| on_host.contains(other));
        if differs {
            homonyms.push((name.as_str(), file.as_str()));
        }
        let is_known = HOMONYMS.iter().any(|(known, at, _)| known == name && at == file);
        assert!(!differs || is_known, "{file}: {name} is {value}, in shaders {in_shaders:?}, on the host {on_host:?}");
    }
    for (name, file, reason) in HOMONYMS {
        assert!(homonyms.contains(&(name, file)), "{file}: {name} is no homonym any more: {reason}");
    }
}

#[test]
fn the_reference_has_the_constants_of_its_twin() {
    let [_, host] = all();
    for [truth, twin] in TWINS {
        let of = |file: &str| -> BTreeMap<String, String> {
            host.iter().filter(|(_, at, _)| at == file).map(|(name, _, value)| (name.clone(), value.clone())).collect()
        };
        let (truth, twin) = (of(truth), of(twin));
        let shared = truth.iter().filter_map(|(name, value)| Some((name, value, twin.get(name)?)));
        let shared: Vec<_> = shared.collect();
        assert!(shared.len() >= 2, "{truth:?} {twin:?}");
        shared.iter().for_each(|(name, value, other)| assert_eq!(value, other, "{name}"));
    }
}
