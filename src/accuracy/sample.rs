//! A sample of a picture's pixels, for errors where the truth of all of them would take too long.

use crate::error::Result;
use crate::image::Image;

/// Pixels evenly spread over a picture: the middles of the cells of a regular grid. The same size and count give the
/// same pixels.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Sample {
    size: [u32; 2],
    grid: [u32; 2],
}

impl Sample {
    /// Spreads about `count` pixels over a picture of `size` pixels, across and down; all of them if there are no more.
    #[must_use]
    pub fn new(size: [u32; 2], count: u32) -> Self {
        let (short, long) = if size[0] < size[1] { (0, 1) } else { (1, 0) };
        let count = f64::from(count.max(1));
        let [width, height] = size.map(f64::from);
        // Cells as close to squares as whole numbers allow.
        let side = (width * height / count).sqrt().max(1.0);
        let cells = |axis: usize, cells: f64| (cells.round() as u32).clamp(1, size[axis].max(1));
        let mut grid = [0; 2];
        grid[short] = cells(short, f64::from(size[short]) / side);
        grid[long] = cells(long, count / f64::from(grid[short]));
        Self { size, grid }
    }

    /// Returns the number of sampled pixels across and down.
    #[must_use]
    pub fn grid(&self) -> [u32; 2] {
        self.grid
    }

    /// Returns whether the sample is the whole picture.
    pub(super) fn is_whole(&self) -> bool {
        self.grid == self.size
    }

    /// Returns the column and the row of each sampled pixel from the top left, row by row.
    #[must_use]
    pub fn pixels(&self) -> Vec<[u32; 2]> {
        let [columns, rows] = self.grid;
        let place = |axis: usize, index: u32| {
            let [index, cells, pixels] = [index, self.grid[axis], self.size[axis]].map(u64::from);
            ((2 * index + 1) * pixels / (2 * cells)) as u32
        };
        (0..rows).flat_map(|row| (0..columns).map(move |column| [place(0, column), place(1, row)])).collect()
    }

    /// Returns the sampled pixels of a picture of the sample's size, as a picture of [`Self::grid`] pixels.
    ///
    /// # Errors
    /// [`Error::Image`](crate::error::Error::Image) if the picture has another size.
    pub fn of(&self, image: &Image) -> Result<Image> {
        let width = self.size[0] as usize;
        let shown = (image.width(), image.height()) == (self.size[0], self.size[1]);
        let at = |[x, y]: [u32; 2]| image.pixels()[y as usize * width + x as usize];
        let pixels = if shown { self.pixels().into_iter().map(at).collect() } else { Vec::new() };
        Image::new(self.grid[0], self.grid[1], pixels)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pixels_are_spread_over_the_picture() {
        let sample = Sample::new([100, 50], 50);
        assert_eq!(sample.grid(), [10, 5]);
        let pixels = sample.pixels();
        assert_eq!(
            (pixels.len(), pixels[0], pixels[1], pixels[10], pixels[49]),
            (50, [5, 5], [15, 5], [5, 15], [95, 45])
        );
    }

    #[test]
    fn a_small_picture_is_its_own_sample() {
        let sample = Sample::new([3, 2], 1000);
        assert_eq!(sample.pixels(), [[0, 0], [1, 0], [2, 0], [0, 1], [1, 1], [2, 1]]);
        let image = Image::new(3, 2, (0..6_u8).map(|i| [f32::from(i); 4]).collect()).unwrap();
        assert_eq!(sample.of(&image).unwrap(), image);
        let refused = sample.of(&Image::transparent(2, 2).unwrap()).unwrap_err().to_string();
        assert!(refused.contains("0 pixels"), "{refused}");
        let line = Sample::new([1000, 1], 10);
        assert_eq!((line.grid(), line.pixels()[9]), ([10, 1], [950, 0]));
    }
}
