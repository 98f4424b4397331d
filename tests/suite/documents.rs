//! Statements of the documents that the repository can check.

use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};

use crate::root;

fn read(path: &str) -> String {
    fs::read_to_string(root().join(path)).unwrap()
}

/// The texts between a pair of quotes.
fn quoted(text: &str, quote: char) -> BTreeSet<String> {
    text.split(quote).skip(1).step_by(2).map(str::to_owned).collect()
}

/// The documents below a folder, without what builds and tools make.
fn documents_below(folder: &Path, found: &mut Vec<PathBuf>) {
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        let name = path.file_name().unwrap().to_str().unwrap();
        if path.is_dir() {
            if name != "target" && !name.starts_with('.') {
                documents_below(&path, found);
            }
        } else if name.ends_with(".md") {
            found.push(path);
        }
    }
}

/// All documents with their texts.
fn documents() -> Vec<(PathBuf, String)> {
    let mut found = Vec::new();
    for entry in fs::read_dir(root()).unwrap() {
        let path = entry.unwrap().path();
        if path.extension().is_some_and(|extension| extension == "md") {
            found.push(path);
        }
    }
    for folder in ["crates", "docs", "python", "src", "tests"] {
        documents_below(&root().join(folder), &mut found);
    }
    let texts = found.into_iter().map(|path| fs::read_to_string(&path).map(|text| (path, text)));
    texts.collect::<Result<_, _>>().unwrap()
}

/// The lines of a document with their numbers, without blocks of code.
fn prose(text: &str) -> Vec<(usize, &str)> {
    let mut is_code = false;
    let lines = text.lines().enumerate().filter(|(_, line)| {
        let is_fence = line.trim_start().starts_with("```");
        is_code ^= is_fence;
        !is_code && !is_fence
    });
    lines.map(|(at, line)| (at + 1, line)).collect()
}

/// The anchors of a document, as GitHub makes them of headings.
fn anchors(text: &str) -> BTreeSet<String> {
    let headings = prose(text).into_iter().filter(|(_, line)| line.starts_with('#'));
    let anchor = |heading: &str| -> String {
        let kept = heading.chars().filter(|c| c.is_alphanumeric() || [' ', '-', '_'].contains(c));
        kept.map(|c| if c == ' ' { '-' } else { c.to_ascii_lowercase() }).collect()
    };
    headings.map(|(_, line)| anchor(line.trim_start_matches('#').trim())).collect()
}

/// The address of files in documents that are read elsewhere too, such as the page of the Python package.
const REPOSITORY: &str = "https://github.com/voxsplat/voxsplat/blob/main/";

/// The targets of links and pictures in a line, without addresses of others.
fn targets(line: &str) -> Vec<&str> {
    let links = line.split("](").skip(1).filter_map(|rest| rest.split_once(')'));
    let pictures = line.split(" src=\"").skip(1).filter_map(|rest| rest.split_once('"'));
    let is_ours = |target: &&str| !target.contains(['<', '>', ' ', ':']) || target.starts_with(REPOSITORY);
    links.chain(pictures).map(|(target, _)| target).filter(is_ours).collect()
}

#[test]
fn the_default_features_are_the_ones_that_the_documentation_names() {
    for (manifest, source) in [("Cargo.toml", "src/lib.rs"), ("crates/volume/Cargo.toml", "crates/volume/src/lib.rs")] {
        let (manifest, source) = (read(manifest), read(source));
        let defaults = manifest.lines().find_map(|line| line.strip_prefix("default = ")).unwrap();
        let text: Vec<&str> = source.lines().filter_map(|line| line.strip_prefix("//! ")).collect();
        let text = text.join(" ");
        let named = text.split("Features, all on by default: ").nth(1).unwrap().split(". ").next().unwrap();
        assert_eq!(quoted(named, '`'), quoted(defaults, '"'));
    }
}

#[test]
fn rows_of_tables_stand_below_their_heads() {
    for (path, text) in documents() {
        let lines: Vec<&str> = text.lines().collect();
        for (number, line) in lines.iter().enumerate().filter(|(_, line)| line.starts_with('|')) {
            let begins = number == 0 || !lines[number - 1].starts_with('|');
            let has_rule = lines.get(number + 1).is_some_and(|next| next.starts_with("|-") || next.starts_with("|:"));
            assert!(!begins || has_rule, "{}: line {}: {line}", path.display(), number + 1);
        }
    }
}

#[test]
fn links_lead_to_files_and_headings() {
    let documents = documents();
    assert!(documents.len() > 60, "only {} documents", documents.len());
    let (mut links, mut lost) = (0, Vec::new());
    for (path, text) in &documents {
        for (number, line) in prose(text) {
            for target in targets(line) {
                let (file, anchor) = target.split_once('#').unwrap_or((target, ""));
                let led = match file.strip_prefix(REPOSITORY) {
                    Some(file) => root().join(file),
                    None if file.is_empty() => path.clone(),
                    None => path.parent().unwrap().join(file),
                };
                let is_there =
                    led.exists() && (anchor.is_empty() || anchors(&fs::read_to_string(&led).unwrap()).contains(anchor));
                links += 1;
                if !is_there {
                    lost.push(format!("{}:{number}: {target}", path.display()));
                }
            }
        }
    }
    assert!(links > 200, "only {links} links");
    assert!(lost.is_empty(), "links that lead nowhere: {lost:#?}");
}

#[test]
fn links_are_found() {
    let line = "[a](b.md#c-d), ![p](../p.png) and <img src=\"q.png\" width=\"3\">; `x[i](y z)`, [w](https://w.org)";
    assert_eq!(targets(&format!("[a]({REPOSITORY}b.md)")), [format!("{REPOSITORY}b.md")]);
    assert_eq!(targets(line), ["b.md#c-d", "../p.png", "q.png"]);
    let text = "# A, `b`: c\n\n```sh\n# no heading\n```\n\n## Not --this\n";
    assert_eq!(anchors(text), ["a-b-c", "not---this"].map(str::to_owned).into());
}

#[test]
fn the_first_documents_are_short() {
    for (document, most) in [("README.md", 5_000), ("ARCHITECTURE.md", 12_000)] {
        let text = read(document);
        assert!(text.len() <= most, "{document}: {} bytes, at most {most}", text.len());
    }
    assert!(!read("README.md").contains("docs/measurements/"), "current figures are in docs/RESULTS.md");
}

#[test]
fn the_contents_of_the_guide_name_every_chapter() {
    let (contents, site) = (read("docs/guide/index.md"), read(".ci/mkdocs.yml"));
    for entry in fs::read_dir(root().join("docs/guide")).unwrap() {
        let name = entry.unwrap().file_name().into_string().unwrap();
        let is_named = name == "index.md" || contents.contains(&format!("]({name})"));
        assert!(is_named && site.contains(&format!("guide/{name}\n")), "{name}");
    }
}
