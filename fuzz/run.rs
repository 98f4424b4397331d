//! Runs a target of `targets.rs` in a folder of this process.

#[path = "targets.rs"]
mod targets;

use std::path::Path;
use std::sync::LazyLock;

use targets::{Place, TARGETS};

static PLACE: LazyLock<Place> = LazyLock::new(|| {
    let folder = std::env::temp_dir().join(format!("voxsplat-fuzz-{}", std::process::id()));
    std::fs::create_dir_all(&folder).expect("a temporary folder can be made");
    let fixtures = Path::new(env!("CARGO_MANIFEST_DIR")).join("../tests/data/volumes");
    Place::new(&folder, &fixtures).expect("the fixtures can be copied")
});

/// Gives bytes to the target of that name.
pub fn target(name: &str, bytes: &[u8]) {
    let (_, run, _) = TARGETS.iter().find(|(known, ..)| *known == name).expect("the target is in the table");
    run(&PLACE, bytes);
}
