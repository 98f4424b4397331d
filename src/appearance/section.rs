//! Sections that a user requests: their planes, and the look of the volume in them.

use std::str::FromStr;

use glam::DVec3;

use super::transfer::{TransferChoice, TransferRequest};
use crate::error::{Error, Result};
use crate::image::{Ground, SectionPlane};
use crate::settings::parse::finite;
use crate::transfer::Window;
use crate::volume::{Statistics, Volume};

/// A requested plane through a volume.
#[derive(Debug, Clone, PartialEq)]
pub struct PlaneSpec {
    name: &'static str,
    forward: DVec3,
    up: DVec3,
    place: PlanePlace,
}

/// The place of a plane.
#[derive(Debug, Clone, PartialEq)]
enum PlanePlace {
    /// The middle of the volume.
    Middle,
    /// The points p of p . normal = distance.
    Distance {
        normal: DVec3,
        distance: f64,
    },
    Through(DVec3),
}

/// The planes across the axes of the world, seen as radiologists see a patient: from the feet, from the front, and from
/// the left. Name, another name, normal, direction of the view, direction upwards.
const NAMED: [(&str, &str, DVec3, DVec3, DVec3); 3] = [
    ("axial", "xy", DVec3::Z, DVec3::Z, DVec3::NEG_Y),
    ("coronal", "xz", DVec3::Y, DVec3::Y, DVec3::Z),
    ("sagittal", "yz", DVec3::X, DVec3::NEG_X, DVec3::Z),
];

impl PlaneSpec {
    /// Returns the planes of a figure of sections of a volume. See [`Self::plane`].
    ///
    /// # Errors
    /// [`Error::Setting`] if a plane misses the box of the voxels.
    pub fn planes(specs: &[Self], volume: &Volume, at: Option<DVec3>) -> Result<Vec<SectionPlane>> {
        let setting = if at.is_some() { "at" } else { "planes" };
        specs.iter().map(|plane| plane.plane(volume, at, setting)).collect()
    }

    /// Returns the plane through a volume. A plane without a place of its own goes through `at`, or through the middle
    /// of the lattice. The names of planes are a patient's only if the world is. `setting` is the setting that errors
    /// name.
    ///
    /// # Errors
    /// [`Error::Setting`] if the plane misses the box of the voxels.
    pub fn plane(&self, volume: &Volume, at: Option<DVec3>, setting: &'static str) -> Result<SectionPlane> {
        let grid = volume.grid();
        let point = match self.place {
            PlanePlace::Middle => at.unwrap_or_else(|| grid.center()),
            PlanePlace::Through(point) => point,
            PlanePlace::Distance { normal, distance } => {
                let off = (distance - grid.center().dot(normal)) / normal.length_squared();
                grid.center() + off * normal
            }
        };
        let world = NAMED.iter().find(|(name, ..)| *name == self.name).map_or("", |(_, world, ..)| world);
        let name = if volume.is_oriented() { self.name } else { world }.to_owned();
        let plane = SectionPlane { name, point, forward: self.forward, up: self.up };
        if plane.outline(grid).is_empty() {
            let (low, high) = grid
                .corners(0.5)
                .iter()
                .fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(low, high), c| (low.min(*c), high.max(*c)));
            let reason = format!(
                "{} at {point:.1} misses the volume, whose box goes from {low:.1} to {high:.1}",
                if plane.name.is_empty() { "a plane" } else { &plane.name }
            );
            return Err(Error::setting(setting, reason));
        }
        Ok(plane)
    }
}

impl FromStr for PlaneSpec {
    type Err = Error;

    /// Parses a name, maybe with a place along the axis across the plane, `axial:12.5`; or `NX,NY,NZ`, `NX,NY,NZ,D` or
    /// `NX,NY,NZ,X,Y,Z`.
    fn from_str(text: &str) -> Result<Self> {
        let (name, along) = text.split_once(':').map_or((text, None), |(name, along)| (name, Some(along)));
        let named = NAMED.iter().find(|(patient, world, ..)| name == *patient || name == *world);
        let along = along.map(finite);
        let oblique = |normal: DVec3, place: PlanePlace| {
            let up = if normal.cross(DVec3::Z).length() > 1e-3 * normal.length() { DVec3::Z } else { DVec3::NEG_Y };
            (normal.length() > 0.0).then_some(Self { name: "", forward: -normal, up, place })
        };
        let plane = match (named, along) {
            (Some((patient, _, normal, forward, up)), along) => {
                let place = match along {
                    None => Some(PlanePlace::Middle),
                    Some(distance) => distance.map(|[distance]| PlanePlace::Distance { normal: *normal, distance }),
                };
                place.map(|place| Self { name: patient, forward: *forward, up: *up, place })
            }
            (None, Some(_)) => None,
            (None, None) => {
                let distance = |[x, y, z, d]: [f64; 4]| {
                    let normal = DVec3::new(x, y, z);
                    oblique(normal, PlanePlace::Distance { normal, distance: d })
                };
                let through = |[x, y, z, px, py, pz]: [f64; 6]| {
                    oblique(DVec3::new(x, y, z), PlanePlace::Through(DVec3::new(px, py, pz)))
                };
                let middle = finite(text).and_then(|[x, y, z]| oblique(DVec3::new(x, y, z), PlanePlace::Middle));
                middle.or_else(|| finite(text).and_then(distance)).or_else(|| finite(text).and_then(through))
            }
        };
        plane.ok_or_else(|| {
            let expected = "axial, coronal or sagittal (xy, xz or yz), maybe with a place such as axial:12.5, or a \
                            normal NX,NY,NZ over 0, maybe with a distance D or a point X,Y,Z behind it";
            Error::setting("plane", format!("{text:?}, expected {expected}"))
        })
    }
}

impl TransferRequest {
    /// Returns the ground of the sections of a volume with a number of channels: black for several, the colours of
    /// labels and of a colour map, otherwise grey over the requested window or the foreground.
    ///
    /// # Errors
    /// The errors of [`Statistics::of`] and [`Window::ends`].
    pub fn ground(&self, volume: &Volume, channels: usize) -> Result<Ground> {
        Ok(match (&self.choice, self.window) {
            _ if channels > 1 => Ground::Black,
            (TransferChoice::Labels, _) => Ground::Colors,
            (TransferChoice::Given(imported), _) if imported.fits => Ground::Colors,
            (_, Some(window)) => Ground::Grey(window.ends()?),
            (_, None) => match Window::of_foreground(&Statistics::of(volume)?) {
                Some(window) => Ground::Grey(window.ends()?),
                None => Ground::Colors,
            },
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn planes() {
        let volume = Volume::from_slice([11, 21, 31], [1.0; 3], &[0_u8; 11 * 21 * 31]).unwrap();
        let at = |text: &str, at| text.parse::<PlaneSpec>().unwrap().plane(&volume, at, "planes").unwrap();
        assert_eq!((at("axial", None).point, at("axial", None).forward), (DVec3::new(5.0, 10.0, 15.0), DVec3::Z));
        assert_eq!(at("xz:3", None).point, DVec3::new(5.0, 3.0, 15.0));
        assert_eq!(at("sagittal", Some(DVec3::splat(2.0))).point, DVec3::splat(2.0));
        assert_eq!(at("coronal:4", Some(DVec3::splat(2.0))).point.y, 4.0);
        let [far, through] = ["0,0,2,8", "0,0,2,5,10,4"].map(|text| at(text, Some(DVec3::ZERO)));
        assert_eq!((far.point, far.forward), (DVec3::new(5.0, 10.0, 4.0), DVec3::new(0.0, 0.0, -2.0)));
        assert_eq!(far, through);
        for bad in ["", "axial:", "axial:x", "upper", "0,0,0", "1,2", "1,2,3,4,5", "axial:1:2", "nan,0,1", "z"] {
            let error = bad.parse::<PlaneSpec>().unwrap_err().to_string();
            assert!(error.contains("expected axial, coronal or sagittal"), "{bad}: {error}");
        }
        let missed = "axial:31".parse::<PlaneSpec>().unwrap().plane(&volume, None, "plane").unwrap_err().to_string();
        assert!(missed.starts_with("plane: xy at [5.0, 10.0, 31.0] misses the volume"), "{missed}");
    }
}
