//! Partial pictures as files: OpenEXR with one part and four channels of 32-bit floats.
//!
//! The data window is the box of pixels that the bricks reach, the display window the whole picture. The channels are
//! [`Values::channels`]. Attributes: `voxsplat.plan`, the plan's number in hexadecimal, `voxsplat.bricks`, the first
//! brick and the number after the last, as `FIRST:END`, `voxsplat.families`, the number of families of rays, and
//! `voxsplat.checksum` of the other attributes and all values.

use std::io::{self, Cursor, Write};
use std::path::Path;

use exr::image::{AnyChannel, AnyChannels, FlatSamples, Image as ExrImage, Layer};
use exr::math::Vec2;
use exr::meta::attribute::{AttributeValue, IntegerBounds, Text};
use exr::prelude::{Encoding, LayerAttributes, ReadChannels, ReadLayers, WritableImage};

use super::hash::fnv1a;
use super::partial::{Partial, Values};
use super::plan::Plan;
use crate::error::{Error, Result};
use crate::image::{Image, Note, Region, check_exr, exr_with_notes};
use crate::output::write_atomically;
use voxsplat_volume::files;

/// The names of the attributes.
const PLAN: &str = "voxsplat.plan";
const BRICKS: &str = "voxsplat.bricks";
const FAMILIES: &str = "voxsplat.families";
pub(super) const CHECKSUM: &str = "voxsplat.checksum";

/// The largest number of families of rays: one for each axis of the lattice.
const MOST_FAMILIES: usize = 3;

/// Returns the name of a channel; a family of rays after the first has its number behind it.
fn channel(values: Values, family: usize, number: usize) -> String {
    let name = values.channels()[number];
    if family == 0 { name.to_owned() } else { format!("family{family}.{name}") }
}

/// The largest file that is read, in bytes.
const MAX_BYTES: u64 = 32 << 30;

/// The picture of a file with one part.
type OnePart = ExrImage<Layer<AnyChannels<FlatSamples>>>;

/// Returns a hash of texts and values.
pub(super) fn checksum<'a>(texts: impl IntoIterator<Item = &'a str>, values: impl Iterator<Item = f32>) -> String {
    let bytes = texts.into_iter().flat_map(|text| text.bytes().map(u32::from).chain([u32::MAX]));
    // Zeros of either sign are equal.
    let words = bytes.chain(values.map(|value| (value + 0.0).to_bits())).map(u64::from);
    format!("{:016x}", fnv1a(words))
}

/// Writes an OpenEXR file, which appears whole or not at all.
pub(super) fn write_exr(path: &Path, encoded: io::Result<Vec<u8>>) -> Result<()> {
    let encoded = encoded.map_err(|source| Error::Write { path: path.to_owned(), source })?;
    write_atomically(path, |file| file.write_all(&encoded))
}

/// Reads an OpenEXR file and decodes it; `expected` is the error of a file of another format.
pub(super) fn read_exr<T>(path: &Path, expected: &str, decoded: impl FnOnce(&[u8]) -> Result<T>) -> Result<T> {
    let bytes = files::read(path, MAX_BYTES)?;
    if !bytes.starts_with(&exr::meta::magic_number::BYTES) {
        return Err(Error::format(path, expected));
    }
    check_exr(path, &bytes)?;
    decoded(&bytes).map_err(|error| match error {
        Error::Setting { reason, .. } => Error::format(path, reason),
        error => Error::format(path, error.to_string()),
    })
}

/// Decodes the bytes of a file with one part; the error is the reason.
pub(super) fn decoded_layer(bytes: &[u8]) -> std::result::Result<OnePart, String> {
    let read = exr::prelude::read().no_deep_data().largest_resolution_level().all_channels().first_valid_layer();
    let image = read.all_attributes().from_buffered(Cursor::new(bytes));
    image.map_err(|e| format!("it cannot be decoded: {e}"))
}

/// Returns an attribute of a part.
pub(super) fn text_of(layer: &Layer<AnyChannels<FlatSamples>>, name: &str) -> Option<String> {
    match layer.attributes.other.get(&Text::from(name)) {
        Some(AttributeValue::Text(text)) => Some(text.to_string()),
        _ => None,
    }
}

impl Partial {
    /// Writes the partial picture as an OpenEXR file. The file appears whole or not at all.
    ///
    /// # Errors
    /// [`Error::Output`] and [`Error::Write`] if it cannot be written.
    pub fn save(&self, path: impl AsRef<Path>) -> Result<()> {
        write_exr(path.as_ref(), self.to_exr())
    }

    /// Returns the bytes of the OpenEXR file.
    ///
    /// # Errors
    /// The errors of the encoder.
    pub fn to_exr(&self) -> io::Result<Vec<u8>> {
        let Region { x, y, width, height } = self.region;
        let with_values = |family: usize, number: usize| {
            let values: Vec<f32> = self.pixels(family).iter().map(|pixel| pixel[number]).collect();
            // Zeros of a family that no pixel has are left out.
            let shows = family == 0 || values.iter().any(|&value| value != 0.0);
            shows.then(|| AnyChannel::new(channel(self.values, family, number).as_str(), FlatSamples::F32(values)))
        };
        let channels =
            (0..self.families()).flat_map(|family| (0..4).filter_map(move |number| with_values(family, number)));
        let channels = channels.collect();
        let mut attributes = LayerAttributes::named("part");
        attributes.layer_position = Vec2(x as i32, y as i32);
        let families = self.families().to_string();
        let notes = [
            (PLAN, format!("{:016x}", self.plan)),
            (BRICKS, self.bricks_text()),
            (FAMILIES, families),
            (CHECKSUM, self.checksum()),
        ];
        let notes = notes.map(|(name, text)| Note { name, text });
        let size = Vec2(width as usize, height as usize);
        let layer = Layer::new(size, attributes, Encoding::FAST_LOSSLESS, AnyChannels::sort(channels));
        let mut image = ExrImage::from_layer(layer);
        let whole = self.size.map(|side| side as usize);
        image.attributes.display_window = IntegerBounds::new((0, 0), (whole[0], whole[1]));
        exr_with_notes(image, &notes, |image, file| image.write().to_buffered(file))
    }

    /// Returns the checksum of all that a file holds.
    fn checksum(&self) -> String {
        let Region { x, y, width, height } = self.region;
        let [of, families] = [self.plan, self.families() as u64].map(|number| number.to_string());
        let place = format!("{x} {y} {width} {height} {:?} {:?}", self.size, self.values);
        let values = (0..self.families()).flat_map(|family| self.pixels(family).as_flattened().iter().copied());
        checksum([&of, &families, &place, &self.bricks_text()].map(String::as_str), values)
    }

    fn bricks_text(&self) -> String {
        format!("{}:{}", self.bricks.start, self.bricks.end)
    }

    /// Loads a partial picture of a plan.
    ///
    /// # Errors
    /// [`Error::Input`] if the file cannot be read, is damaged, no partial picture, or belongs to another plan.
    pub fn load(path: impl AsRef<Path>, plan: &Plan) -> Result<Self> {
        let path = path.as_ref();
        let expected = "no partial picture: expected OpenEXR that voxsplat brick wrote";
        read_exr(path, expected, |bytes| Self::decoded(bytes).and_then(|part| plan.check_part(&part).map(|()| part)))
    }

    /// Reads a partial picture from the bytes of its OpenEXR file.
    ///
    /// # Errors
    /// [`Error::Input`] or [`Error::Setting`] if they are damaged or no partial picture; [`Error::Memory`].
    pub fn from_exr(bytes: &[u8]) -> Result<Self> {
        check_exr(Path::new("part"), bytes)?;
        Self::decoded(bytes)
    }

    fn decoded(bytes: &[u8]) -> Result<Self> {
        let refused = |reason: &str| Error::setting("parts", format!("no partial picture: {reason}"));
        let image = decoded_layer(bytes).map_err(|reason| refused(&reason))?;
        let layer = image.layer_data;
        let text = |name: &str| text_of(&layer, name);
        let id = text(PLAN).and_then(|text| u64::from_str_radix(&text, 16).ok());
        let bricks = text(BRICKS).and_then(|text| {
            let (first, end) = text.split_once(':')?;
            Some(first.parse().ok()?..end.parse().ok()?)
        });
        let families = text(FAMILIES).and_then(|text| text.parse().ok()).filter(|count| *count <= MOST_FAMILIES);
        let (Some(plan), Some(bricks), Some(families)) = (id, bricks, families) else {
            return Err(refused("it names no plan: draw it with voxsplat brick"));
        };
        let samples = |values: Values, family: usize, number: usize| {
            let name = channel(values, family, number);
            layer
                .channel_data
                .list
                .iter()
                .find(|channel| channel.name == *name.as_str())
                .map(|found| &found.sample_data)
        };
        let all = [Values::Emission, Values::Largest, Values::Mean];
        let Some(values) = all.into_iter().find(|values| samples(*values, 0, 0).is_some()) else {
            return Err(refused("it has the channels of no model"));
        };
        let Vec2(x, y) = layer.attributes.layer_position;
        let (Ok(x), Ok(y)) = (u32::try_from(x), u32::try_from(y)) else {
            return Err(refused("it lies beside the picture"));
        };
        let whole = image.attributes.display_window.size;
        let size = [whole.width() as u32, whole.height() as u32];
        let region = Region { x, y, width: layer.size.width() as u32, height: layer.size.height() as u32 };
        region.check_within(size)?;
        let mut part = Self { plan, bricks, values, size, region, families: Vec::new() };
        for family in 0..families {
            let mut pixels = Image::transparent(region.width, region.height)?;
            for number in 0..4 {
                let samples = match samples(values, family, number) {
                    Some(FlatSamples::F32(samples)) => samples,
                    None if family > 0 => continue,
                    _ => {
                        let name = channel(values, family, number);
                        return Err(refused(&format!("it has no channel {name} of 32-bit floats")));
                    }
                };
                if samples.iter().any(|value| !value.is_finite()) {
                    let name = channel(values, family, number);
                    return Err(refused(&format!("channel {name} has a value that is not finite")));
                }
                pixels.pixels_mut().iter_mut().zip(samples).for_each(|(pixel, value)| pixel[number] = *value);
            }
            part.families.push(pixels);
        }
        if text(CHECKSUM) != Some(part.checksum()) {
            return Err(refused("it is damaged, its checksum differs: draw it again, or copy the file again"));
        }
        Ok(part)
    }
}
