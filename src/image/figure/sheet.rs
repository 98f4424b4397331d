//! Contact sheets: small pictures in rows, each with its name.

use glam::DVec2;

use super::canvas::Canvas;
use super::slices::paste;
use super::{LEAST_EM, legend};
use crate::error::{Error, Result};
use crate::image::{Background, Image, Region};

/// The largest number of pixels of a contact sheet: 1 GiB in memory.
const MOST_PIXELS: u64 = 1 << 26;
/// The size of names, as a share of the width of a picture.
const EM: f64 = 0.06;
/// The height of a line of names, and the space around a picture, in sizes of letters.
const LINE: f64 = 1.8;
const GAP: f64 = 0.4;

/// A contact sheet of pictures of one size.
#[derive(Debug)]
pub struct ContactSheet {
    image: Image,
    names: Vec<String>,
    /// Width and height of a picture, pixels.
    size: [u32; 2],
    columns: u32,
}

impl ContactSheet {
    /// Makes a sheet with room for `count` pictures of `size` pixels, width and height: about as wide as high.
    ///
    /// # Errors
    /// [`Error::Setting`] if the sheet would have over 2^26 pixels, and [`Error::Memory`].
    pub fn new(count: usize, size: [u32; 2]) -> Result<Self> {
        let [across, down] = Self::cell(size).map(f64::from);
        let columns = (count as f64 * down / across).sqrt().round().clamp(1.0, count.max(1) as f64) as u32;
        Self::of_columns(count as u64, size, columns)
    }

    fn of_columns(count: u64, size: [u32; 2], columns: u32) -> Result<Self> {
        let cell = Self::cell(size).map(u64::from);
        let [width, height] = [cell[0] * u64::from(columns), cell[1] * count.div_ceil(u64::from(columns))];
        if width * height > MOST_PIXELS {
            let reason = format!(
                "{count} pictures of {} x {} pixels make a sheet of {width} x {height}, expected up to {MOST_PIXELS} \
                 pixels: choose smaller pictures",
                size[0], size[1]
            );
            return Err(Error::setting("size", reason));
        }
        let image = Image::transparent(width as u32, height as u32)?;
        Ok(Self { image, names: Vec::new(), size, columns })
    }

    /// Returns the size of letters for pictures of a size, pixels.
    fn em(size: [u32; 2]) -> f64 {
        (EM * f64::from(size[0])).max(LEAST_EM)
    }

    /// Returns the width and height of a picture with its name and the space around, pixels.
    fn cell([width, height]: [u32; 2]) -> [u32; 2] {
        let em = Self::em([width, height]);
        let gap = (GAP * em).ceil() as u32;
        [width + 2 * gap, height + 2 * gap + (LINE * em).ceil() as u32]
    }

    /// Returns the top left of a cell, pixels.
    fn corner(&self, number: u32) -> [u32; 2] {
        let [across, down] = Self::cell(self.size);
        [number % self.columns * across, number / self.columns * down]
    }

    /// Adds a picture with its name.
    ///
    /// # Errors
    /// [`Error::Image`] if the picture has another size, or if the sheet is full.
    pub fn add(&mut self, picture: &Image, name: &str) -> Result<()> {
        let [width, height] = self.size;
        let gap = (GAP * Self::em(self.size)).ceil() as u32;
        let [x, y] = self.corner(self.names.len() as u32).map(|at| at + gap);
        let to = Region { x, y, width, height };
        if [picture.width(), picture.height()] != self.size || y + height > self.image.height() {
            return Err(Error::Image(format!("no room for {name} on a contact sheet")));
        }
        paste(&mut self.image, picture, to);
        self.names.push(name.to_owned());
        Ok(())
    }

    /// Returns the sheet with the names below the pictures, shortened to their width. Without the rows that have no
    /// picture.
    ///
    /// # Errors
    /// [`Error::Image`] if no picture was added.
    pub fn finish(self, background: Background) -> Result<Image> {
        let [across, down] = Self::cell(self.size);
        let rows = (self.names.len() as u32).div_ceil(self.columns);
        if rows == 0 {
            return Err(Error::Image("a contact sheet without pictures".to_owned()));
        }
        let whole = Region { x: 0, y: 0, width: self.image.width(), height: rows * down };
        let em = Self::em(self.size);
        let mut canvas = Canvas::new(&self.image.part(whole)?, whole, background, em)?;
        for (number, name) in (0_u32..).zip(&self.names) {
            // Letters that the font lacks become question marks.
            let known = |c: char| if canvas.font.lacks(c.encode_utf8(&mut [0; 4])).is_some() { '?' } else { c };
            let name: String = name.chars().map(|c| if c.is_control() { '?' } else { known(c) }).collect();
            let name = legend::cut(&canvas.font, &name, em, f64::from(self.size[0]));
            let [x, y] = self.corner(number).map(f64::from);
            let line = DVec2::new(x + f64::from(across) / 2.0, y + f64::from(down) - LINE / 2.0 * em - GAP * em);
            canvas.write(&name, em, line, 0.5);
        }
        Ok(canvas.into_image())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pictures_stand_in_rows_with_their_names() {
        let mut sheet = ContactSheet::new(3, [128, 100]).unwrap();
        let picture = Image::new(128, 100, vec![[0.0, 0.5, 0.0, 1.0]; 12_800]).unwrap();
        sheet.add(&picture, "scan.nii.gz").unwrap();
        sheet.add(&picture, "骨 a name that is much too long for the width of its picture.nii.gz").unwrap();
        assert!(sheet.add(&Image::transparent(8, 8).unwrap(), "small").is_err());
        let [across, down] = ContactSheet::cell([128, 100]);
        let image = sheet.finish(Background::default()).unwrap();
        // Two columns; the second row has no picture.
        assert_eq!([image.width(), image.height()], [2 * across, down]);
        let greens = image.pixels().iter().filter(|pixel| pixel[..3] == [0.0, 0.5, 0.0]).count();
        assert_eq!(greens, 2 * 12_800);
        let white = |from: u32, to: u32| {
            let pixels = image.pixels().iter().zip((0..image.width()).cycle());
            pixels.filter(|(pixel, x)| (from..to).contains(x) && pixel[0] > 0.9).count()
        };
        assert!(white(0, across) > 50 && white(across, 2 * across) > 50);
        let refused = ContactSheet::new(100_000, [256; 2]).unwrap_err().to_string();
        assert!(refused.contains("100000 pictures of 256 x 256 pixels"), "{refused}");
        assert!(ContactSheet::new(1, [64; 2]).unwrap().finish(Background::default()).is_err());
    }
}
