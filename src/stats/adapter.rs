//! The graphics adapter on which pictures are made, as its driver describes it.

use serde::Serialize;

use voxsplat_volume::names::spelled;

/// A graphics adapter as the driver describes it.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
#[non_exhaustive]
pub struct AdapterInfo {
    /// The name of the adapter.
    pub name: String,
    /// The graphics interface: vulkan, metal or dx12.
    pub backend: String,
    /// The kind of the adapter's device.
    pub kind: AdapterKind,
    /// The driver and its version.
    pub driver: String,
}

/// The kind of device of an adapter, the fastest kind first.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
#[non_exhaustive]
pub enum AdapterKind {
    /// A GPU with memory of its own.
    Discrete,
    /// A GPU that shares the processor's memory.
    Integrated,
    /// A GPU seen through a virtual machine.
    Virtual,
    /// A device whose driver does not state its kind.
    Other,
    /// A processor that does the work of a GPU, such as Mesa's lavapipe.
    Cpu,
}

spelled! {
    AdapterKind {
        Discrete: "discrete",
        Integrated: "integrated",
        Virtual: "virtual",
        Other: "other",
        Cpu: "cpu",
    }
}

impl AdapterInfo {
    /// Returns whether the adapter is a processor that does the work of a GPU, such as Mesa's lavapipe.
    #[must_use]
    pub fn is_software(&self) -> bool {
        self.kind == AdapterKind::Cpu
    }
}
