//! The sizes of cells: a half-octave pyramid (Crowley and Stern 1984, "Fast computation of the difference of low-pass
//! transform"). With one size an octave cells are up to half as large as they may be, and eight times as many.

use crate::settings::MAX_LEVEL;

/// The size of a cell: 2^n voxels along each axis at level n, and half as many more at level n + 1/2. Level 0 is the
/// voxels.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub(crate) struct CellSize {
    /// The number of half voxels along a cell.
    halves: u32,
}

impl CellSize {
    pub(crate) const VOXEL: Self = Self { halves: 2 };

    /// The number of sizes of cells.
    pub(crate) const COUNT: usize = 2 * MAX_LEVEL as usize + 1;

    /// The size of the cells of the largest level.
    pub(crate) const LARGEST: Self = Self::of_level(MAX_LEVEL);

    /// Returns all sizes, from the voxels on.
    pub(crate) fn all() -> impl Iterator<Item = Self> {
        std::iter::successors(Some(Self::VOXEL), |size| (*size < Self::LARGEST).then(|| size.next()))
    }

    pub(crate) const fn of_level(level: u32) -> Self {
        Self { halves: 2 << level }
    }

    /// Returns the next larger size.
    pub(crate) const fn next(self) -> Self {
        let halves = if self.is_whole() { self.halves / 2 * 3 } else { self.halves / 3 * 4 };
        Self { halves }
    }

    /// Returns the largest size of a whole level that is no larger.
    pub(crate) const fn whole(self) -> Self {
        Self::of_level(self.halves.ilog2() - 1)
    }

    /// Returns whether the level of the size is a whole number.
    const fn is_whole(self) -> bool {
        self.halves.is_power_of_two()
    }

    /// Returns the number of the size among all sizes, from the voxels on.
    pub(crate) const fn number(self) -> usize {
        2 * (self.halves.ilog2() as usize - 1) + !self.is_whole() as usize
    }

    /// Returns the number of voxels along a cell.
    pub(crate) fn voxels(self) -> f64 {
        f64::from(self.halves) / 2.0
    }

    /// Returns the number of voxels along a cell as a fraction in lowest terms.
    pub(crate) const fn fraction(self) -> [u32; 2] {
        if self.halves.is_multiple_of(2) { [self.halves / 2, 1] } else { [self.halves, 2] }
    }

    /// Returns the number of cells that cover `voxels` voxels.
    pub(crate) fn cells(self, voxels: u32) -> u32 {
        let [over, under] = self.fraction();
        (u64::from(voxels) * u64::from(under)).div_ceil(u64::from(over)) as u32
    }

    /// Returns the level of the size: a whole number and perhaps a half.
    pub(crate) fn level(self) -> f32 {
        self.number() as f32 / 2.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sizes_are_two_an_octave() {
        let mut size = CellSize::VOXEL;
        let mut found = Vec::new();
        for number in 0..CellSize::COUNT {
            assert_eq!(size.number(), number);
            if number % 2 == 0 {
                assert_eq!(size, CellSize::of_level(number as u32 / 2));
            }
            assert_eq!(size.whole(), CellSize::of_level(number as u32 / 2));
            found.push((size.level(), size.voxels(), size.cells(12)));
            size = size.next();
        }
        let first = [(0.0, 1.0, 12), (0.5, 1.5, 8), (1.0, 2.0, 6), (1.5, 3.0, 4), (2.0, 4.0, 3), (2.5, 6.0, 2)];
        assert_eq!(found[..6], first);
    }
}
