//! OME-XML in the description of the first page
//! (<https://docs.openmicroscopy.org/ome-model/latest/ome-tiff/>): images, their axes and the lengths of a voxel.

use std::path::Path;

use super::described::Described;
use crate::error::{Result, Subject, refuse, refuse_if};
use crate::formats::placement::{named_unit, plain_name};
use crate::formats::selection::{Axes, Role};
use crate::formats::xml::Tag;
use crate::names::counted;
use crate::volume::Channel;

/// The largest number of channels whose names are kept.
const MAX_LABELS: usize = 4096;

/// The units of length in micrometres, as OME-XML names them.
const LENGTHS: [(&str, f64); 8] =
    [("pm", 1e-6), ("Å", 1e-4), ("nm", 1e-3), ("µm", 1.0), ("mm", 1e3), ("cm", 1e4), ("dm", 1e5), ("m", 1e6)];

/// An image of a file, as the tags of OME-XML state it.
struct Image {
    name: Option<String>,
    pixels: Tag,
    labels: Vec<Channel>,
    /// The tags TiffData, which place planes in the file.
    planes: Vec<PlaneRun>,
}

/// A run of planes in consecutive directories.
struct PlaneRun {
    /// The number of the first directory.
    directory: Option<usize>,
    /// The section, the channel and the point in time of the first plane.
    first: [i64; 3],
    count: Option<usize>,
}

/// Describes the series of a file, one for each image; `None` if a text is not of OME. `pages` are the numbers of
/// directories of pages, and `samples` returns the number of samples in a pixel of a page.
pub(super) fn described(
    text: &str,
    pages: &[usize],
    samples: impl Fn(usize) -> i64,
    path: &Path,
) -> Result<Option<Vec<Described>>> {
    let images = images(text);
    if images.is_empty() {
        return Ok(None);
    }
    let (mut all, mut next, mut stated) = (Vec::new(), 0, 0_i64);
    for image in &images {
        // The first page, by its directory.
        let directory = image.planes.iter().filter_map(|planes| planes.directory).min();
        let first = directory.and_then(|directory| pages.binary_search(&directory).ok()).unwrap_or(next);
        let described = image.described(samples(first), path)?;
        let count = described.axes.iter().map(|(_, size)| *size).fold(1, i64::saturating_mul);
        stated = stated.saturating_add(count);
        // More planes than pages are refused below.
        let count = usize::try_from(count).ok().filter(|count| *count <= pages.len()).unwrap_or(0);
        let follow = (next..next + count).collect();
        let placed = image.placed(&described.axes, count, samples(first), (pages, next)).unwrap_or(follow);
        next += count;
        // The name of a single image, which writers number, tells nothing.
        let name = image.name.clone().filter(|_| images.len() > 1);
        all.push(Described { pages: placed, name, ..described });
    }
    if stated != pages.len() as i64 {
        let pages = counted(pages.len() as u64, "page");
        refuse!(path, "has {pages}, but its OME-XML states {stated}: save it as one file");
    }
    Ok(Some(all))
}

fn images(text: &str) -> Vec<Image> {
    let (mut images, mut name): (Vec<Image>, _) = (Vec::new(), None);
    for tag in Tag::all(text) {
        let local = tag.name.rsplit(':').next().unwrap_or_default();
        match (local, images.last_mut()) {
            ("Image", _) => name = tag.get("Name").and_then(plain_name),
            ("Pixels", _) => {
                images.push(Image { name: name.take(), pixels: tag, labels: Vec::new(), planes: Vec::new() });
            }
            ("Channel", Some(image)) if image.labels.len() < MAX_LABELS => image.labels.push(channel(&tag)),
            ("TiffData", Some(image)) => {
                let number = |name: &str| tag.get(name).and_then(|text| text.parse::<usize>().ok());
                let first = ["FirstZ", "FirstC", "FirstT"].map(|name| number(name).unwrap_or(0) as i64);
                image.planes.push(PlaneRun { directory: number("IFD"), first, count: number("PlaneCount") });
            }
            _ => {}
        }
    }
    images
}

fn channel(tag: &Tag) -> Channel {
    Channel {
        name: tag.get("Name").and_then(plain_name),
        // Red, green, blue and opacity, from the highest byte to the lowest.
        color: tag.get("Color").and_then(|text| text.parse::<i32>().ok()).map(|rgba| {
            let [r, g, b, _] = rgba.to_be_bytes();
            [r, g, b]
        }),
        window: None,
    }
}

impl Image {
    /// Describes an image whose pixels have that many samples, without its pages.
    fn described(&self, samples: i64, path: &Path) -> Result<Described> {
        let tag = &self.pixels;
        let count = |name: &str| tag.get(name).and_then(|text| text.parse::<i64>().ok()).unwrap_or(1).max(1);
        let (sections, channels, times) = (count("SizeZ"), count("SizeC"), count("SizeT"));
        let of_pages = (channels / samples.max(1)).max(1);
        let axes = tag.get("DimensionOrder").unwrap_or("XYZCT").chars().filter_map(|axis| match axis {
            'Z' => Some((Role::Space, sections)),
            'C' => Some((Role::Channel, of_pages)),
            'T' => Some((Role::Time, times)),
            _ => None,
        });
        let axes: Axes = axes.collect();
        refuse_if!(axes.len() != 3, path, "has no order of its dimensions that is known");
        let mut labels = self.labels.clone();
        if labels.len() as i64 != channels || labels.iter().all(|label| *label == Channel::default()) {
            labels.clear();
        }
        let described = Described { axes, labels, is_microscopy: true, ..Described::default() };
        let stated = |name: &str| tag.get(name).and_then(|text| text.parse::<f64>().ok()).filter(|n| *n > 0.0);
        let lengths = ["PhysicalSizeX", "PhysicalSizeY", "PhysicalSizeZ"].map(stated);
        let units = ["PhysicalSizeXUnit", "PhysicalSizeYUnit", "PhysicalSizeZUnit"];
        let units = units.map(|name| tag.get(name).unwrap_or("µm"));
        let Some(x) = lengths[0] else { return Ok(described) };
        let [_, y, z] = lengths.map(|length| length.unwrap_or(x));
        let is_alike = std::iter::zip(units, lengths).all(|(unit, length)| length.is_none() || unit == units[0]);
        if is_alike {
            return Ok(Described { spacing: Some([x, y, z]), unit: named_unit(units[0]), ..described });
        }
        let micrometres = |unit: &str| LENGTHS.iter().find(|(name, _)| *name == unit).map(|(_, length)| *length);
        let of: Option<Vec<f64>> = units.into_iter().map(micrometres).collect();
        let Some([of_x, of_y, of_z]) = of.as_deref() else {
            refuse!(path, "states lengths in several units, {}", units.join(", "));
        };
        // A length that is not stated has the unit of x.
        let of = |axis: usize, unit: &f64| if lengths[axis].is_some() { *unit } else { *of_x };
        let spacing = Some([x * of_x, y * of(1, of_y), z * of(2, of_z)]);
        Ok(Described { spacing, unit: Some("µm".to_owned()), ..described })
    }

    /// Returns the pages of the planes in the order of the axes; `None` if the tags do not place each plane in a page.
    /// Planes without a directory begin at the page `next`.
    fn placed(&self, axes: &Axes, count: usize, samples: i64, (pages, next): (&[usize], usize)) -> Option<Vec<usize>> {
        let mut placed = vec![None; count];
        for planes in &self.planes {
            let [z, c, t] = planes.first;
            let (mut start, mut stride) = (0, 1);
            for (role, size) in axes {
                let at = match role {
                    Role::Space => z,
                    Role::Channel => c / samples.max(1),
                    Role::Time => t,
                };
                start += if at < *size { at * stride } else { return None };
                stride *= size;
            }
            let start = usize::try_from(start).ok()?;
            // Without a directory all planes are meant.
            let run = planes.count.unwrap_or(if planes.directory.is_some() { 1 } else { count });
            let first = planes.directory.map_or(Ok(next), |directory| pages.binary_search(&directory)).ok()?;
            for (n, plane) in placed.get_mut(start..start.checked_add(run)?)?.iter_mut().enumerate() {
                *plane = Some(first + n).filter(|page| *page < pages.len());
            }
        }
        placed.into_iter().collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn pages(pixels: &str, directories: &[usize]) -> Vec<Vec<usize>> {
        let text = format!("<OME><Image Name=\"a\">{pixels}</Image></OME>");
        let all = described(&text, directories, |_| 1, Path::new("a.tif")).unwrap().unwrap();
        all.into_iter().map(|described| described.pages).collect()
    }

    #[test]
    fn planes_lie_in_the_pages_that_the_text_states() {
        let pixels = |planes: &str| {
            format!("<Pixels DimensionOrder=\"XYZCT\" SizeZ=\"2\" SizeC=\"2\" SizeT=\"1\">{planes}</Pixels>")
        };
        let plane = |z, c, ifd| format!("<TiffData FirstZ=\"{z}\" FirstC=\"{c}\" IFD=\"{ifd}\"/>");
        let turned = [plane(0, 0, 3), plane(1, 0, 2), plane(0, 1, 1), plane(1, 1, 0)].concat();
        assert_eq!(pages(&pixels(&turned), &[0, 1, 2, 3]), [[3, 2, 1, 0]]);
        // Directory 1 is a preview.
        let beyond = "<TiffData IFD=\"2\" PlaneCount=\"3\" FirstZ=\"1\"/><TiffData IFD=\"0\"/>";
        assert_eq!(pages(&pixels(beyond), &[0, 2, 3, 4]), [[0, 1, 2, 3]]);
        // Without places, or with places that do not exist, planes follow one another.
        for planes in ["", "<TiffData/>", "<TiffData IFD=\"7\"/>", "<TiffData FirstZ=\"9\" IFD=\"0\"/>"] {
            assert_eq!(pages(&pixels(planes), &[0, 1, 2, 3]), [[0, 1, 2, 3]], "{planes}");
        }
        let two = pixels("<TiffData/>").repeat(2);
        assert_eq!(pages(&two, &[0, 1, 2, 3, 4, 5, 6, 7]), [[0, 1, 2, 3], [4, 5, 6, 7]]);
    }

    #[test]
    fn lengths_in_several_units_become_micrometres() {
        let spacing = |y: &str| {
            let text = format!("<Pixels PhysicalSizeX=\"500\" PhysicalSizeXUnit=\"nm\" {y} PhysicalSizeZ=\"2\"/>");
            let all = described(&text, &[0], |_| 1, Path::new("a.tif"));
            all.map(|all| all.unwrap().remove(0)).map(|described| (described.spacing.unwrap(), described.unit.unwrap()))
        };
        assert_eq!(spacing("").unwrap(), ([0.5, 0.5, 2.0], "µm".to_owned()));
        let millimetre = "PhysicalSizeY=\"0.001\" PhysicalSizeYUnit=\"mm\"";
        assert_eq!(spacing(millimetre).unwrap(), ([0.5, 1.0, 2.0], "µm".to_owned()));
        let pixel = "PhysicalSizeY=\"1\" PhysicalSizeYUnit=\"pixel\"";
        assert!(spacing(pixel).unwrap_err().to_string().contains("states lengths in several units, nm, pixel, µm"));
    }
}
