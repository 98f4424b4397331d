//! `voxsplat devices`.

use serde::Serialize;
use voxsplat::adapter::AdapterInfo;
use voxsplat::renderer::{Renderer, RendererOptions, adapters, silenced};

use super::failure::Failure;
use super::output;
use super::report::{self, Choices, NO_FILES};

/// The adapters, best first: `--adapter '#N'` chooses the one at place N.
#[derive(Serialize)]
struct Listed {
    adapters: Vec<AdapterInfo>,
}

pub(crate) fn run() -> Result<(), Failure> {
    let adapters = silenced(adapters);
    if adapters.is_empty() {
        // Opening one fails with the reason.
        silenced(|| Renderer::new(&RendererOptions::default()))?;
    }
    if output::is_json() {
        return report::print(Choices::default(), NO_FILES, Listed { adapters });
    }
    let width = adapters.iter().map(|a| a.name.chars().count()).max().unwrap_or(0);
    let line = |(index, a): (usize, &AdapterInfo)| {
        format!("#{index}  {:width$}  {:10}  {:7}  {}\n", a.name, a.kind, a.backend, a.driver)
    };
    output::print(&adapters.iter().enumerate().map(line).collect::<String>())
}
