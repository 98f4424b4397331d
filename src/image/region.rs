//! Regions of pictures.

use crate::error::{Error, Result};

/// A rectangle of the picture, in pixels from its top left.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Region {
    /// Number of columns before the region.
    pub x: u32,
    /// Number of rows above the region.
    pub y: u32,
    /// Number of columns, at least 1.
    pub width: u32,
    /// Number of rows, at least 1.
    pub height: u32,
}

impl Region {
    /// Returns the number of pixels of the region.
    pub(crate) fn area(self) -> u64 {
        u64::from(self.width) * u64::from(self.height)
    }

    /// Returns the column and the row of each pixel, row by row.
    pub(crate) fn pixels(self) -> impl Iterator<Item = [u32; 2]> {
        (self.y..self.y + self.height).flat_map(move |y| (self.x..self.x + self.width).map(move |x| [x, y]))
    }

    /// Refuses a region without pixels, and a region that reaches beyond a picture of a width and height.
    ///
    /// # Errors
    /// [`Error::Setting`] that states the region and the size.
    pub fn check_within(self, [width, height]: [u32; 2]) -> Result<()> {
        let fits = |start: u32, length: u32, end: u32| length > 0 && start < end && length <= end - start;
        if fits(self.x, self.width, width) && fits(self.y, self.height, height) {
            return Ok(());
        }
        let Self { x, y, width: across, height: down } = self;
        let reason = format!("{across} x {down} pixels at ({x}, {y}) are no part of a picture of {width} x {height}");
        Err(Error::setting("region", reason))
    }

    /// Returns the intersection with another region; `None` if it is empty.
    pub(crate) fn and(self, other: Self) -> Option<Self> {
        let (x, y) = (self.x.max(other.x), self.y.max(other.y));
        let end = |start: u32, length: u32| u64::from(start) + u64::from(length);
        let width = end(self.x, self.width).min(end(other.x, other.width)).checked_sub(x.into())?;
        let height = end(self.y, self.height).min(end(other.y, other.height)).checked_sub(y.into())?;
        (width > 0 && height > 0).then_some(Self { x, y, width: width as u32, height: height as u32 })
    }

    /// Returns the smallest region around both regions.
    pub(crate) fn around(self, other: Self) -> Self {
        let (x, y) = (self.x.min(other.x), self.y.min(other.y));
        let right = (self.x + self.width).max(other.x + other.width);
        let bottom = (self.y + self.height).max(other.y + other.height);
        Self { x, y, width: right - x, height: bottom - y }
    }

    /// Splits the region into rectangles of at most `side` pixels a side, row by row.
    pub(crate) fn parts(self, side: u32) -> Vec<Self> {
        let steps = |start: u32, length: u32| {
            (0..length).step_by(side as usize).map(move |at| (start + at, side.min(length - at)))
        };
        let columns = move || steps(self.x, self.width);
        steps(self.y, self.height)
            .flat_map(|(y, height)| columns().map(move |(x, width)| Self { x, y, width, height }))
            .collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parts_cover_a_region_once() {
        let region = Region { x: 3, y: 5, width: 10, height: 7 };
        for side in [1, 3, 4, 7, 10, 64] {
            let parts = region.parts(side);
            assert_eq!(parts.iter().map(|part| part.area()).sum::<u64>(), region.area(), "{side}");
            for (i, a) in parts.iter().enumerate() {
                assert!(a.width <= side && a.height <= side);
                assert!(a.x >= 3 && a.y >= 5 && a.x + a.width <= 13 && a.y + a.height <= 12);
                let apart = |b: &Region| {
                    a.x + a.width <= b.x || b.x + b.width <= a.x || a.y + a.height <= b.y || b.y + b.height <= a.y
                };
                assert!(parts[i + 1..].iter().all(apart), "{side}");
            }
        }
    }

    #[test]
    fn regions_meet_and_stay_within_the_picture() {
        let region = |x, y, width, height| Region { x, y, width, height };
        assert_eq!(region(2, 3, 4, 5).and(region(4, 0, 9, 4)), Some(region(4, 3, 2, 1)));
        assert_eq!(region(0, 0, 2, 2).and(region(2, 0, 2, 2)), None);
        assert_eq!(region(0, 0, u32::MAX, 1).and(region(5, 0, u32::MAX, 1)), Some(region(5, 0, u32::MAX - 5, 1)));
        assert!(region(1, 1, 3, 2).check_within([4, 3]).is_ok());
        for beyond in [region(1, 0, 4, 1), region(0, 0, 0, 1), region(4, 0, 1, 1), region(u32::MAX, 0, 2, 1)] {
            assert!(beyond.check_within([4, 3]).unwrap_err().to_string().contains("no part of a picture of 4 x 3"));
        }
    }
}
