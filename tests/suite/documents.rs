//! Statements of the documents that the repository can check.

use std::collections::BTreeSet;
use std::fs;

use crate::root;

fn read(path: &str) -> String {
    fs::read_to_string(root().join(path)).unwrap()
}

/// The texts between a pair of quotes.
fn quoted(text: &str, quote: char) -> BTreeSet<String> {
    text.split(quote).skip(1).step_by(2).map(str::to_owned).collect()
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
    let mut files: Vec<_> = ["README.md", "GUIDE.md", "ARCHITECTURE.md", "CONTRIBUTING.md", "python/README.md"]
        .map(|name| root().join(name))
        .to_vec();
    for folder in ["docs", "docs/measurements"] {
        let entries = fs::read_dir(root().join(folder)).unwrap();
        files.extend(
            entries.map(|entry| entry.unwrap().path()).filter(|path| path.extension().is_some_and(|e| e == "md")),
        );
    }
    for path in files {
        let text = fs::read_to_string(&path).unwrap();
        let lines: Vec<&str> = text.lines().collect();
        for (number, line) in lines.iter().enumerate().filter(|(_, line)| line.starts_with('|')) {
            let begins = number == 0 || !lines[number - 1].starts_with('|');
            let has_rule = lines.get(number + 1).is_some_and(|next| next.starts_with("|-") || next.starts_with("|:"));
            assert!(!begins || has_rule, "{}: line {}: {line}", path.display(), number + 1);
        }
    }
}
