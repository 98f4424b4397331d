//! Depths of pixels, and their files.

use std::io::{self, Cursor};
use std::path::Path;

use exr::image::{AnyChannel, AnyChannels, FlatSamples};
use exr::prelude::{ReadChannels, ReadLayers, WritableImage};

use super::file::{MAX_BYTES, check_exr, exr_with_notes};
use super::{Image, Note, Region};
use crate::camera::{Camera, Projection};
use crate::error::{Error, Result};
use crate::output::write_atomically;
use voxsplat_volume::files;
use voxsplat_volume::memory::{self, reserved};

/// The depth of each pixel of a picture, such as a depth buffer: rows from the top, pixels of a row from the left.
///
/// A depth is a distance along the camera's forward direction in world units. In perspective it begins at the eye;
/// along parallel rays it begins at the plane of the camera's target, and is negative before it. It is infinite in
/// pixels without a depth.
#[derive(Debug, Clone, PartialEq)]
pub struct DepthMap {
    width: u32,
    height: u32,
    depths: Vec<f32>,
}

/// The depth that files have in pixels without a depth, and the least that is read so: Blender's.
const NOTHING: f32 = 1e10;

/// A depth beyond every place on a ray, for shaders.
const BEYOND: f32 = 1e30;

impl DepthMap {
    /// Makes a map of depths, row by row from the top. Numbers that are not finite are no depths.
    ///
    /// # Errors
    /// [`Error::Image`] if there are not `width * height` depths.
    pub fn new(width: u32, height: u32, depths: Vec<f32>) -> Result<Self> {
        if depths.len() as u64 != u64::from(width) * u64::from(height) {
            return Err(Error::Image(format!("{} depths do not make {width} x {height}", depths.len())));
        }
        let depths = depths.into_iter().map(|depth| if depth.is_finite() { depth } else { f32::INFINITY }).collect();
        Ok(Self { width, height, depths })
    }

    /// Returns the width and the height in pixels.
    #[must_use]
    pub fn size(&self) -> [u32; 2] {
        [self.width, self.height]
    }

    /// Returns the depths, row by row from the top; infinite where there is none.
    #[must_use]
    pub fn depths(&self) -> &[f32] {
        &self.depths
    }

    /// Loads the depths of an OpenEXR and, if it has colours, its premultiplied picture.
    ///
    /// The channel of depths is named `Z`, `depth` or `Depth.V`, with or without the name of a layer before it, or is
    /// the only channel. Depths that are not finite, or 1e10 and more as in pixels of Blender without a surface, are
    /// no depths. Colours are the channels `R`, `G` and `B`, with `A` if it is there, of the same file.
    ///
    /// # Errors
    /// [`Error::Input`] if the file cannot be read, is no OpenEXR, or has no such channel; [`Error::Memory`].
    pub fn load(path: impl AsRef<Path>) -> Result<(Self, Option<Image>)> {
        let path = path.as_ref();
        let bytes = files::read(path, MAX_BYTES)?;
        check_exr(path, &bytes)?;
        let read = exr::prelude::read().no_deep_data().largest_resolution_level().all_channels();
        let read = read.first_valid_layer().all_attributes().from_buffered(Cursor::new(&bytes));
        let layer = read.map_err(|e| Error::format(path, format!("the picture cannot be decoded: {e}")))?.layer_data;
        let (width, height) = (layer.size.width() as u32, layer.size.height() as u32);
        let channels = &layer.channel_data.list;
        let named: Vec<(String, &FlatSamples)> =
            channels.iter().map(|channel| (channel.name.to_string(), &channel.sample_data)).collect();
        let find = |matches: &dyn Fn(&str) -> bool| named.iter().find(|(name, _)| matches(name)).map(|(_, data)| *data);
        let is_depth = |name: &str| {
            let name = name.to_ascii_lowercase();
            let last = name.rsplit('.').next().unwrap_or_default();
            matches!(last, "z" | "depth") || name.ends_with("depth.v")
        };
        let only = || if let [(_, data)] = &named[..] { Some(*data) } else { None };
        let Some(depths) = find(&|name| name == "Z").or_else(|| find(&is_depth)).or_else(only) else {
            let names = named.iter().map(|(name, _)| name.as_str()).collect::<Vec<_>>().join(", ");
            return Err(Error::format(
                path,
                format!("it has no channel of depths (Z, depth or Depth.V), only {names}"),
            ));
        };
        let area = u64::from(width) * u64::from(height);
        memory::check(24 * area, || format!("the picture {}", path.display()))?;
        let depth = |depth: f32| if depth >= NOTHING { f32::INFINITY } else { depth };
        let map = Self::new(width, height, depths.values_as_f32().map(depth).collect())?;
        let color = |letter: &str| {
            let of_layer = format!(".{}", letter.to_ascii_lowercase());
            find(&|name| name == letter).or_else(|| find(&|name| name.to_ascii_lowercase().ends_with(&of_layer)))
        };
        let image = match [color("R"), color("G"), color("B")] {
            [Some(red), Some(green), Some(blue)] => {
                let mut image = Image::transparent(width, height)?;
                let mut fill = |channel: usize, values: &FlatSamples| {
                    let pixels = image.pixels_mut().iter_mut();
                    pixels.zip(values.values_as_f32()).for_each(|(pixel, value)| pixel[channel] = value);
                };
                [red, green, blue].into_iter().enumerate().for_each(|(channel, values)| fill(channel, values));
                match color("A") {
                    Some(alpha) => fill(3, alpha),
                    // Surfaces are opaque.
                    None => image.pixels_mut().iter_mut().zip(&map.depths).for_each(|(pixel, depth)| {
                        pixel[3] = if depth.is_finite() { 1.0 } else { 0.0 };
                    }),
                }
                Some(image)
            }
            _ => None,
        };
        Ok((map, image))
    }

    /// Returns a copy of a region of the map.
    ///
    /// # Errors
    /// [`Error::Setting`] if the region reaches beyond the map.
    pub fn part(&self, region: Region) -> Result<Self> {
        region.check_within(self.size())?;
        Self::new(region.width, region.height, self.within(region).collect())
    }

    /// Returns the depths of a region inside the map.
    fn within(&self, region: Region) -> impl Iterator<Item = f32> {
        region.pixels().map(|pixel| self.at(pixel))
    }

    /// Returns the depth in a column and row.
    pub(crate) fn at(&self, [x, y]: [u32; 2]) -> f32 {
        self.depths[y as usize * self.width as usize + x as usize]
    }

    /// Returns the smallest rectangle in a region that contains all of its depths; `None` if it has none.
    pub(crate) fn reached(&self, region: Region) -> Option<Region> {
        let pixel = |[x, y]: [u32; 2]| Region { x, y, width: 1, height: 1 };
        region.pixels().filter(|&at| self.at(at).is_finite()).map(pixel).reduce(Region::around)
    }

    /// Returns the smaller depth of two maps in each pixel.
    ///
    /// # Errors
    /// [`Error::Image`] if the sizes differ.
    pub fn nearest(&self, other: &Self) -> Result<Self> {
        if self.size() != other.size() {
            return Err(Error::Image("depths of pictures of different sizes".to_owned()));
        }
        let depths = self.depths.iter().zip(&other.depths).map(|(a, b)| a.min(*b)).collect();
        Self::new(self.width, self.height, depths)
    }

    /// Refuses depths of another size than the pictures of a camera, and a camera whose depths have no scale.
    pub(crate) fn check(&self, camera: &Camera) -> Result<()> {
        if self.size() != camera.size {
            let ([width, height], [across, down]) = (self.size(), camera.size);
            let reason = format!("{width} x {height} pixels, expected {across} x {down} as the picture has");
            return Err(Error::setting("depth", reason));
        }
        check_scale(camera)
    }

    /// Returns the depths of a region in the form of shaders: see [`ViewGeometry::depth_of_z`]. `camera` is in units of
    /// `unit`.
    ///
    /// [`ViewGeometry::depth_of_z`]: crate::gpu::view::ViewGeometry::depth_of_z
    pub(crate) fn for_shaders(&self, camera: &Camera, unit: f64, region: Region) -> Result<Vec<f32>> {
        let (pixel, start) = scale(camera);
        let mut depths = reserved(region.area(), || "depths of solids".to_owned())?;
        let depth = |depth: f32| (((f64::from(depth) / unit - start) / pixel) as f32).clamp(-BEYOND, BEYOND);
        depths.extend(self.within(region).map(depth));
        Ok(depths)
    }

    /// Returns the depths of a picture of half depths: see shaders/common/half_depth.wgsl.
    pub(crate) fn of_halves(image: &Image, camera: &Camera, unit: f64) -> Self {
        let (pixel, start) = scale(camera);
        let depth = |&[sum, share, ..]: &[f32; 4]| match share > 0.5 {
            true => ((f64::from(sum / share) * pixel + start) * unit) as f32,
            false => f32::INFINITY,
        };
        let depths = image.pixels().iter().map(depth).collect();
        Self { width: image.width(), height: image.height(), depths }
    }
}

/// Returns the width of a pixel at the target, and the depth of the target.
fn scale(camera: &Camera) -> (f64, f64) {
    (camera.pixel_size().abs(), camera.projection.eye_distance().unwrap_or(0.0))
}

/// Refuses a camera whose eye is its target: a pixel there has no width.
pub(crate) fn check_scale(camera: &Camera) -> Result<()> {
    match camera.projection {
        Projection::Perspective { distance: 0.0, .. } => {
            Err(Error::Camera("the eye is the target, which leaves depths without a scale".to_owned()))
        }
        _ => Ok(()),
    }
}

impl Image {
    /// Writes the picture as an OpenEXR with its depths: channels R, G, B and A as [`Self::save`] writes them, and Z.
    /// Pixels without a depth have 1e10, as Blender writes them.
    ///
    /// # Errors
    /// [`Error::Image`] if the sizes differ; the errors of [`Self::save`].
    pub fn save_with_depths(&self, path: impl AsRef<Path>, depths: &DepthMap, notes: &[Note]) -> Result<()> {
        let path = path.as_ref();
        if depths.size() != [self.width(), self.height()] {
            return Err(Error::Image("the depths have another size than the picture".to_owned()));
        }
        let area = u64::from(self.width()) * u64::from(self.height());
        memory::check(44 * area, || path.display().to_string())?;
        let encoded = self.exr_with_depths(depths, notes);
        let encoded = encoded.map_err(|source| Error::Write { path: path.to_owned(), source })?;
        write_atomically(path, |file| io::Write::write_all(file, &encoded))
    }

    fn exr_with_depths(&self, depths: &DepthMap, notes: &[Note]) -> io::Result<Vec<u8>> {
        let color = |channel: usize| self.pixels().iter().map(|pixel| pixel[channel]).collect();
        let depths = depths.depths.iter().map(|&depth| if depth.is_finite() { depth } else { NOTHING }).collect();
        let channels = [("R", color(0)), ("G", color(1)), ("B", color(2)), ("A", color(3)), ("Z", depths)];
        let channels = channels.map(|(name, values)| AnyChannel::new(name, FlatSamples::F32(values)));
        let channels = AnyChannels::sort(channels.into_iter().collect());
        let image = exr::image::Image::from_channels((self.width() as usize, self.height() as usize), channels);
        exr_with_notes(image, notes, |image, file| image.write().to_buffered(file))
    }

    /// Composites the picture over another picture of the same size.
    ///
    /// # Errors
    /// [`Error::Image`] if the sizes differ.
    pub fn over(mut self, behind: &Self) -> Result<Self> {
        if [behind.width(), behind.height()] != [self.width(), self.height()] {
            return Err(Error::Image("a picture lies over one of another size".to_owned()));
        }
        for (pixel, behind) in self.pixels_mut().iter_mut().zip(behind.pixels()) {
            let passed = 1.0 - pixel[3];
            pixel.iter_mut().zip(behind).for_each(|(value, behind)| *value += passed * behind);
        }
        Ok(self)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image::Background;

    #[test]
    fn depths_and_colors_of_a_file_are_read_back() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("a.exr");
        let image = Image::new(2, 1, vec![[0.25, 0.5, 0.75, 1.0], [0.1, 0.2, 0.3, 0.5]]).unwrap();
        let depths = DepthMap::new(2, 1, vec![2.5, f32::NEG_INFINITY]).unwrap();
        assert_eq!(depths.depths(), [2.5, f32::INFINITY]);
        image.save_with_depths(&path, &depths, &[Note { name: "Software", text: "a renderer".to_owned() }]).unwrap();
        assert_eq!(DepthMap::load(&path).unwrap(), (depths.clone(), Some(image.clone())));
        assert_eq!(Image::load(&path).unwrap(), image, "a reader of pictures ignores depths");
        image.save(&path, Background::default()).unwrap();
        let error = DepthMap::load(&path).unwrap_err().to_string();
        assert!(error.contains("a.exr") && error.contains("no channel of depths"), "{error}");
        assert!(depths.check(&Camera::new(&crate::camera::View::default(), &grid(), [3, 1]).unwrap()).is_err());
    }

    fn grid() -> crate::volume::Grid {
        crate::volume::Grid::axis_parallel([4; 3], [1.0; 3]).unwrap()
    }

    #[test]
    fn channels_of_other_programs_are_found() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("a.exr");
        for names in [
            vec!["ViewLayer.Combined.R", "ViewLayer.Combined.G", "ViewLayer.Combined.B", "ViewLayer.Depth.Z"],
            vec!["Depth.V"],
            vec!["depth"],
            vec!["Y"],
        ] {
            let last = names.len() - 1;
            let channels = names.iter().enumerate().map(|(number, name)| {
                let values = if number == last { vec![3.0, 2e10] } else { vec![0.1 * (number + 1) as f32; 2] };
                AnyChannel::new(*name, FlatSamples::F32(values))
            });
            let image = exr::image::Image::from_channels((2, 1), AnyChannels::sort(channels.collect()));
            image.write().to_file(&path).unwrap();
            let (depths, image) = DepthMap::load(&path).unwrap();
            assert_eq!(depths.depths(), [3.0, f32::INFINITY], "{names:?}");
            let expected = vec![[0.1, 0.2, 0.3, 1.0], [0.1, 0.2, 0.3, 0.0]];
            assert_eq!(image.map(|image| image.pixels().to_vec()), (names.len() > 1).then_some(expected), "{names:?}");
        }
    }

    #[test]
    fn a_picture_lies_over_another() {
        let image = Image::new(1, 1, vec![[0.25, 0.0, 0.0, 0.5]]).unwrap();
        let over = image.clone().over(&Image::new(1, 1, vec![[0.0, 1.0, 0.0, 1.0]]).unwrap()).unwrap();
        assert_eq!(over.pixels(), [[0.25, 0.5, 0.0, 1.0]]);
        assert!(image.over(&Image::transparent(2, 1).unwrap()).is_err());
    }
}
