//! `voxsplat devices`.

use voxsplat::adapter::AdapterInfo;
use voxsplat::renderer::{adapters, silenced};

use super::failure::{Failure, fail};
use super::output;

pub(crate) fn run() -> Result<(), Failure> {
    let adapters = silenced(adapters);
    if adapters.is_empty() {
        return fail(
            "no graphics adapter: install a Vulkan driver, or mesa-vulkan-drivers for rendering without a GPU"
                .to_owned(),
        );
    }
    let width = adapters.iter().map(|a| a.name.chars().count()).max().unwrap_or(0);
    let line = |(index, a): (usize, &AdapterInfo)| {
        format!("#{index}  {:width$}  {:10}  {:7}  {}\n", a.name, a.kind, a.backend, a.driver)
    };
    output::print(&adapters.iter().enumerate().map(line).collect::<String>())
}
