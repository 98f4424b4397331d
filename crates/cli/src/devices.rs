//! The command `voxsplat devices`.

use serde::Serialize;
use voxsplat::adapter::AdapterInfo;
use voxsplat::host::HostRenderer;
use voxsplat::renderer::{Renderer, RendererOptions, adapters, silenced};

use super::failure::Failure;
use super::output;
use super::report::{self, Choices, NO_FILES};

/// The printed list of adapters, best first: `--adapter '#N'` chooses the one at place N. Then the processor, for
/// `--painter cpu`.
#[derive(Serialize)]
struct AdapterList {
    adapters: Vec<AdapterInfo>,
    cpu: AdapterInfo,
}

pub(crate) fn run() -> Result<(), Failure> {
    let adapters = silenced(adapters);
    // Opening one fails with the reason.
    if adapters.is_empty()
        && let Err(error) = silenced(|| Renderer::new(&RendererOptions::default()))
    {
        output::say(&format!("note: {error}"));
    }
    if output::is_json() {
        return report::print(Choices::default(), NO_FILES, AdapterList { adapters, cpu: HostRenderer::adapter() });
    }
    let width = adapters.iter().map(|a| a.name.chars().count()).max().unwrap_or(0);
    let line = |(index, a): (usize, &AdapterInfo)| {
        format!("#{index}  {:width$}  {:10}  {:7}  {}\n", a.name, a.kind, a.backend, a.driver)
    };
    let host = HostRenderer::adapter();
    let host = format!("cpu {:width$}  {:10}  {:7}  {}\n", host.name, host.kind, host.backend, host.driver);
    output::print(&adapters.iter().enumerate().map(line).chain([host]).collect::<String>())
}
