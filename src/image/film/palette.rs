//! A palette of 256 colours for many frames: Heckbert 1982, "Color image quantization for frame buffer display".

/// The number of bits of a channel in the histogram.
const BITS: u32 = 5;
/// The number of cells of a histogram.
const CELLS: usize = 1 << (3 * BITS);
/// The number of colours of a palette.
const COLORS: usize = 256;

/// The thresholds of Bayer's ordered dither, 0 to 15.
const PATTERN: [[i16; 4]; 4] = [[0, 8, 2, 10], [12, 4, 14, 6], [3, 11, 1, 9], [15, 7, 13, 5]];

/// The number of pixels of each colour, and the sums of their channels.
pub(super) struct Histogram(Vec<[u64; 4]>);

impl Default for Histogram {
    fn default() -> Self {
        Self(vec![[0; 4]; CELLS])
    }
}

/// Returns the cell of a colour.
fn cell(rgb: [u8; 3]) -> usize {
    rgb.into_iter().fold(0, |cell, c| cell << BITS | usize::from(c) >> (8 - BITS))
}

impl Histogram {
    /// Counts pixels of RGB bytes.
    pub(super) fn count(&mut self, rgb: &[u8]) {
        for &rgb in rgb.as_chunks().0 {
            let cell = &mut self.0[cell(rgb)];
            cell[0] += 1;
            (0..3).for_each(|c| cell[c + 1] += u64::from(rgb[c]));
        }
    }

    /// Makes the palette of the counted pixels: halves the widest box of colours until there are enough.
    pub(super) fn palette(&self) -> Palette {
        let mean = |cell: &[u64; 4]| [1, 2, 3].map(|c| cell[c] as f64 / cell[0] as f64);
        let counted: Vec<(f64, [f64; 3])> =
            self.0.iter().filter(|cell| cell[0] > 0).map(|cell| (cell[0] as f64, mean(cell))).collect();
        let mut boxes = vec![ColorBox::new(counted)];
        while boxes.len() < COLORS {
            let widest = boxes.iter().enumerate().max_by(|a, b| a.1.spread.total_cmp(&b.1.spread));
            let Some((place, widest)) = widest.filter(|(_, widest)| widest.spread > 0.0) else { break };
            let [low, high] = widest.halves();
            boxes[place] = low;
            boxes.push(high);
        }
        let colors: Vec<[f64; 3]> = boxes.iter().map(|of| of.mean).collect();
        // The nearest colour to the middle of each cell.
        let half = 0.5 * f64::from(1 << (8 - BITS));
        let nearest = (0..CELLS).map(|cell| {
            let channel = |shift: u32| ((cell >> shift & ((1 << BITS) - 1)) << (8 - BITS)) as f64 + half;
            let rgb = [channel(2 * BITS), channel(BITS), channel(0)];
            let mean = if self.0[cell][0] > 0 { mean(&self.0[cell]) } else { rgb };
            let far = |color: &[f64; 3]| (0..3).map(|c| (color[c] - mean[c]).powi(2)).sum::<f64>();
            let best = (0..colors.len()).min_by(|&a, &b| far(&colors[a]).total_cmp(&far(&colors[b])));
            best.unwrap_or(0) as u8
        });
        let nearest = nearest.collect();
        Palette { colors: colors.iter().map(|color| color.map(|c| c.round() as u8)).collect(), nearest }
    }
}

/// Colours that share a colour of the palette.
struct ColorBox {
    cells: Vec<(f64, [f64; 3])>,
    mean: [f64; 3],
    /// The channel that varies most within the box.
    axis: usize,
    /// The sum of squared differences of channel `axis` from its mean.
    spread: f64,
}

impl ColorBox {
    fn new(cells: Vec<(f64, [f64; 3])>) -> Self {
        let count: f64 = cells.iter().map(|(count, _)| count).sum::<f64>().max(1.0);
        let mean = [0, 1, 2].map(|c| cells.iter().map(|(count, color)| count * color[c]).sum::<f64>() / count);
        let spreads = [0, 1, 2].map(|c| cells.iter().map(|(n, color)| n * (color[c] - mean[c]).powi(2)).sum::<f64>());
        let axis = (0..3).max_by(|&a, &b| spreads[a].total_cmp(&spreads[b])).unwrap_or(0);
        let spread = if cells.len() > 1 { spreads[axis] } else { 0.0 };
        Self { cells, mean, axis, spread }
    }

    /// Splits the box into the colours below the mean, and all others.
    fn halves(&self) -> [Self; 2] {
        let (low, high) = self.cells.iter().partition(|(_, color)| color[self.axis] < self.mean[self.axis]);
        [Self::new(low), Self::new(high)]
    }
}

/// A palette: colours, and the nearest colour to each cell.
pub(super) struct Palette {
    colors: Vec<[u8; 3]>,
    nearest: Vec<u8>,
}

impl Palette {
    /// Returns red, green and blue of each colour.
    pub(super) fn bytes(&self) -> Vec<u8> {
        self.colors.concat()
    }

    /// Returns the palette's colours for pixels in rows of `width`, with an ordered dither, which stays still where the
    /// picture does.
    pub(super) fn indices(&self, pixels: &[u8], width: usize) -> Vec<u8> {
        let (pixels, _) = pixels.as_chunks::<3>();
        let index = |(i, rgb): (usize, &[u8; 3])| {
            // At most half a cell, so that black stays black.
            let shift = PATTERN[i / width % 4][i % width % 4] / 2 - 4;
            self.nearest[cell(rgb.map(|c| (i16::from(c) + shift).clamp(0, 255) as u8))]
        };
        pixels.iter().enumerate().map(index).collect()
    }
}
