//! The facts that the description of a page states about all pages of a series.

use crate::formats::selection::{Axes, Role};
use crate::volume::Channel;

/// A series of pages that are one image, and the facts that the file states about it.
#[derive(Debug, Default)]
pub(super) struct Described {
    /// The numbers of the series' pages among the pages of the file, in the order of `axes`.
    pub(super) pages: Vec<usize>,
    /// The axes of pages, the fastest first.
    pub(super) axes: Axes,
    pub(super) labels: Vec<Channel>,
    /// Whether all pages have one directory, as ImageJ writes large stacks.
    pub(super) together: bool,
    pub(super) spacing: Option<[f64; 3]>,
    pub(super) unit: Option<String>,
    /// Whether the image is of microscopy.
    pub(super) is_microscopy: bool,
    pub(super) name: Option<String>,
}

impl Described {
    /// Describes pages that are sections one behind the other.
    pub(super) fn sections(pages: Vec<usize>) -> Self {
        let axes = vec![(Role::Space, pages.len() as i64)];
        Self { pages, axes, ..Self::default() }
    }

    /// Returns the number of sections that the pages are.
    pub(super) fn depth(&self) -> i64 {
        self.axes.iter().filter(|(role, _)| *role == Role::Space).fold(1, |all, (_, size)| all.saturating_mul(*size))
    }
}
