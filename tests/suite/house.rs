//! The structure of the crates: no files of a crate import each other in a circle, rooms import only lower rooms, no
//! room grows unnoticed, and few names belong to several types.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::Path;

use crate::root;

/// The place of a file among the modules of its crate; the root has no names.
type Module = Vec<String>;

/// The modules of a folder of sources with their text, without test files.
fn modules(folder: &Path, at: &[String], found: &mut BTreeMap<Module, String>) {
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        let name = path.file_stem().unwrap().to_str().unwrap().to_owned();
        let inner: Module = at.iter().cloned().chain([name.clone()]).collect();
        if path.is_dir() {
            if !name.starts_with("tests") {
                modules(&path, &inner, found);
            }
        } else if path.extension().is_some_and(|extension| extension == "rs")
            && !name.ends_with("_test")
            && !name.ends_with("tests")
        {
            let module = if ["mod", "lib", "main"].contains(&name.as_str()) { at.to_vec() } else { inner };
            found.insert(module, fs::read_to_string(&path).unwrap());
        }
    }
}

/// A source without comments, and without the tests at its end.
fn code(source: &str) -> String {
    let lines = source.lines().map(|line| line.split("//").next().unwrap_or_default());
    let code: String = lines.flat_map(|line| [line, "\n"]).collect();
    let mut end = code.len();
    for (at, _) in code.match_indices("#[cfg(test)]") {
        let words: Vec<&str> = code[at + "#[cfg(test)]".len()..].split_whitespace().take(3).collect();
        if matches!(words[..], ["mod", _, "{"]) {
            end = end.min(at);
        }
    }
    code[..end].to_owned()
}

/// The paths of a tree of names after `use`: `a::{b, c::{d, e}}`.
fn expanded(tree: &str) -> Vec<Module> {
    let names = |text: &str| -> Module {
        text.split("::").map(|name| name.split(" as ").next().unwrap_or_default().trim().to_owned()).collect()
    };
    let Some((head, rest)) = tree.split_once('{') else { return vec![names(tree)] };
    let head: Module = names(head).into_iter().filter(|name| !name.is_empty()).collect();
    let inside = rest.rsplit_once('}').map_or(rest, |(inside, _)| inside);
    let (mut depth, mut parts) = (0, vec![String::new()]);
    for c in inside.chars() {
        depth += i32::from(c == '{') - i32::from(c == '}');
        if c == ',' && depth == 0 {
            parts.push(String::new());
        } else {
            parts.last_mut().unwrap().push(c);
        }
    }
    let all = parts.iter().filter(|part| !part.trim().is_empty()).flat_map(|part| expanded(part));
    all.map(|tail| head.iter().cloned().chain(tail).collect()).collect()
}

/// The text of the path at the start of `code`: names, and a tree in braces at its end.
fn path(code: &str) -> &str {
    let mut depth = 0;
    for (at, c) in code.char_indices() {
        depth += i32::from(c == '{') - i32::from(c == '}');
        let goes_on = c.is_alphanumeric() || c == '_' || c == ':' || depth > 0;
        if c == '}' && depth == 0 {
            return &code[..=at];
        }
        if !goes_on {
            return &code[..at];
        }
    }
    code
}

/// The paths in a source, from the root of its crate: `crate::a::b`, and `super::b` in a module.
fn paths(module: &Module, source: &str) -> Vec<Module> {
    let code = code(source);
    let mut all = Vec::new();
    for keyword in ["crate::", "super::"] {
        for (at, _) in code.match_indices(keyword) {
            let before = code[..at].chars().next_back();
            if before.is_some_and(|c| c.is_alphanumeric() || c == '_' || c == ':') {
                continue;
            }
            let mut rest = &code[at..];
            let mut base = module.clone();
            if keyword == "crate::" {
                (rest, base) = (&rest[keyword.len()..], Module::new());
            }
            while let Some(above) = rest.strip_prefix("super::") {
                rest = above;
                base.pop();
            }
            all.extend(
                expanded(path(rest)).into_iter().map(|tail| base.iter().cloned().chain(tail).collect::<Module>()),
            );
        }
    }
    all
}

/// The modules that each module of a crate needs. Paths to the root do not count, because the root re-exports the other
/// modules.
fn arrows(modules: &BTreeMap<Module, String>) -> BTreeMap<Module, BTreeSet<Module>> {
    let known =
        |path: Module| (1..=path.len()).rev().map(|n| path[..n].to_vec()).find(|path| modules.contains_key(path));
    let needed = |(module, source): (&Module, &String)| {
        let others = paths(module, source).into_iter().filter_map(known).filter(|other| other != module);
        (module.clone(), others.collect())
    };
    modules.iter().map(needed).collect()
}

/// The arrows between the rooms of a crate: its folders and files at the top.
fn between_rooms(arrows: &BTreeMap<Module, BTreeSet<Module>>) -> BTreeMap<Module, BTreeSet<Module>> {
    let room = |module: &Module| module.iter().take(1).cloned().collect::<Module>();
    let mut rooms = BTreeMap::<Module, BTreeSet<Module>>::new();
    for (module, others) in arrows.iter().filter(|(module, _)| !module.is_empty()) {
        let others = others.iter().map(room).filter(|other| *other != room(module));
        rooms.entry(room(module)).or_default().extend(others);
    }
    rooms
}

/// The circles of modules: groups in which each module needs all others.
fn circles(arrows: &BTreeMap<Module, BTreeSet<Module>>) -> Vec<Vec<String>> {
    let reached = |from: &Module| {
        let (mut reached, mut next) = (BTreeSet::new(), vec![from.clone()]);
        while let Some(module) = next.pop() {
            for other in arrows.get(&module).into_iter().flatten() {
                if reached.insert(other.clone()) {
                    next.push(other.clone());
                }
            }
        }
        reached
    };
    let reached: BTreeMap<&Module, BTreeSet<Module>> = arrows.keys().map(|module| (module, reached(module))).collect();
    let mut circles = BTreeSet::new();
    for (module, others) in reached.iter().filter(|(module, others)| others.contains(**module)) {
        let group = others.iter().filter(|other| reached[other].contains(*module));
        circles.insert(group.map(|module| module.join("::")).collect::<Vec<_>>());
    }
    circles.into_iter().collect()
}

#[test]
fn no_crate_has_a_circle_of_files() {
    let root = root();
    let crates = fs::read_dir(root.join("crates")).unwrap().map(|entry| entry.unwrap().path());
    for folder in crates.chain([root.to_owned()]).map(|folder| folder.join("src")) {
        let mut found = BTreeMap::new();
        modules(&folder, &[], &mut found);
        assert!(found.len() > 3, "{}: {} files", folder.display(), found.len());
        assert_eq!(circles(&arrows(&found)), Vec::<Vec<String>>::new(), "{}", folder.display());
    }
}

#[test]
fn the_rooms_of_the_library_have_no_circle() {
    let mut found = BTreeMap::new();
    modules(&root().join("src"), &[], &mut found);
    let rooms = between_rooms(&arrows(&found));
    // 25 rooms on 2026-11-30 (vectors: those of the processor, for rays and for light): a new room has a reason.
    assert!((10..=25).contains(&rooms.len()), "{:?}", rooms.keys());
    assert_eq!(circles(&rooms), Vec::<Vec<String>>::new());
}

#[test]
fn rooms_need_only_those_below_them() {
    let mut found = BTreeMap::new();
    modules(&root().join("src"), &[], &mut found);
    let rows: [(&str, &[&str]); 4] = [
        ("host", &["wgpu::", "crate::gpu", "crate::prepare", "crate::painters", "crate::renderer"]),
        ("gpu", &["crate::prepare", "crate::painters", "crate::renderer"]),
        ("prepare", &["wgpu::", "crate::painters", "crate::renderer"]),
        ("painters", &["crate::renderer", "crate::accuracy", "crate::appearance"]),
    ];
    for (room, above) in rows {
        let files: Vec<_> =
            found.iter().filter(|(module, _)| module.first().is_some_and(|name| name == room)).collect();
        assert!(files.len() > 3, "{room}: {} files", files.len());
        for (module, source) in files {
            let named: Vec<_> = above.iter().filter(|name| code(source).contains(*name)).collect();
            assert!(named.is_empty(), "{}: {named:?}", module.join("::"));
        }
    }
}

/// The most lines of code of each room: without comments, blanks and tests. A room that shrinks takes its new number;
/// one that grows says why in the message of its commit.
const LINES: [(&str, usize); 29] = [
    ("accuracy", 360),
    ("appearance", 2332),
    ("bricks", 1290),
    ("camera", 762),
    ("crates/cli", 6401),
    ("crates/volume", 13286),
    ("engine", 151),
    ("error", 146),
    ("frame", 67),
    ("gpu", 5019),
    ("host", 4818),
    ("image", 2207),
    ("kernel", 984),
    ("layers", 1244),
    ("lib", 67),
    ("lighting", 2870),
    ("output", 137),
    ("painters", 3168),
    ("prepare", 2253),
    ("progress", 34),
    ("python", 1636),
    ("reference", 2290),
    ("renderer", 404),
    ("settings", 479),
    ("solids", 496),
    ("splats", 753),
    ("stats", 344),
    ("transfer", 2002),
    ("vectors", 20),
];
/// The same of all shaders, and the number of their files.
const SHADERS: [usize; 2] = [4378, 71];

/// The folders of the crates.
const CRATES: [&str; 4] = ["", "crates/cli", "crates/volume", "python"];

/// The lines of a source that have code.
fn lines(source: &str) -> usize {
    code(source).lines().filter(|line| !line.trim().is_empty()).count()
}

#[test]
fn rooms_do_not_grow() {
    let mut rooms: BTreeMap<String, usize> = BTreeMap::new();
    for crate_ in CRATES {
        let mut found = BTreeMap::new();
        modules(&root().join(crate_).join("src"), &[], &mut found);
        for (module, source) in found {
            let room = match (crate_, module.first()) {
                ("", Some(room)) => room.clone(),
                ("", None) => "lib".to_owned(),
                _ => crate_.to_owned(),
            };
            *rooms.entry(room).or_default() += lines(&source);
        }
    }
    let all: usize = rooms.values().sum();
    println!("{all} lines of Rust: {rooms:?}");
    let most: BTreeMap<&str, usize> = LINES.into_iter().collect();
    assert!(rooms.keys().map(String::as_str).eq(most.keys().copied()), "other rooms: {:?}", rooms.keys());
    let grown: Vec<_> = rooms.iter().filter(|(room, lines)| **lines > most[room.as_str()]).collect();
    assert!(grown.is_empty(), "rooms that have grown: {grown:?}");
    let mut shaders = Vec::new();
    texts(&root().join("shaders"), &mut shaders);
    let found = [shaders.iter().map(|text| lines(text)).sum(), shaders.len()];
    println!("lines and files of shaders: {found:?}");
    assert!(found[0] <= SHADERS[0] && found[1] <= SHADERS[1], "{found:?}");
}

/// The texts of all files of a folder.
fn texts(folder: &Path, found: &mut Vec<String>) {
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            texts(&path, found);
        } else {
            found.push(fs::read_to_string(path).unwrap());
        }
    }
}

/// The most names that several types have: a reader must guess which of the types such a name means.
const SHARED_NAMES: usize = 26;

/// The name of the type that a line without indentation defines.
fn defined(line: &str) -> Option<&str> {
    let line = match line.strip_prefix("pub(") {
        Some(rest) => rest.split_once(") ")?.1,
        None => line.strip_prefix("pub ").unwrap_or(line),
    };
    let name = ["struct ", "enum ", "trait "].iter().find_map(|keyword| line.strip_prefix(keyword))?;
    name.split(|c: char| !c.is_alphanumeric()).next()
}

#[test]
fn few_names_of_types_are_defined_twice() {
    let mut places = BTreeMap::<String, Vec<String>>::new();
    for crate_ in CRATES {
        let mut found = BTreeMap::new();
        modules(&root().join(crate_).join("src"), &[], &mut found);
        for (module, source) in &found {
            for name in source.lines().filter_map(defined) {
                let path: Vec<&str> = [crate_].into_iter().chain(module.iter().map(String::as_str)).collect();
                places.entry(name.to_owned()).or_default().push(path.join("::"));
            }
        }
    }
    places.retain(|_, places| places.len() > 1);
    println!("{} names of several types", places.len());
    assert!(places.len() <= SHARED_NAMES, "{} names have several types: {places:#?}", places.len());
}

#[test]
fn a_circle_is_found() {
    let files = |files: &[(&str, &str)]| -> BTreeMap<Module, String> {
        let module = |name: &str| name.split("::").filter(|name| !name.is_empty()).map(str::to_owned).collect();
        files.iter().map(|(name, source)| (module(name), (*source).to_owned())).collect()
    };
    let straight = [
        ("", "mod a; mod b; mod c;"),
        (
            "a",
            "use crate::b::{self, Thing, c::{D, E}};\n// use crate::c::Not;\n#[cfg(test)]\nmod t { use crate::c::T; }",
        ),
        ("b", "use super::c;"),
        ("b::c", "pub fn f() { super::super::c::g() }"),
        ("c", "use crate::Root;"),
    ];
    assert!(circles(&arrows(&files(&straight))).is_empty());
    let mut round = straight;
    round[4].1 = "fn g() { crate::a::f() }";
    assert_eq!(circles(&arrows(&files(&round))), [["a", "b", "b::c", "c"]]);
    // No file needs itself over others, but two rooms need each other.
    let rooms =
        files(&[("", ""), ("a::x", "use crate::b::x;"), ("a::y", ""), ("b::x", ""), ("b::y", "use crate::a::y;")]);
    assert!(circles(&arrows(&rooms)).is_empty());
    assert_eq!(circles(&between_rooms(&arrows(&rooms))), [["a", "b"]]);
}
