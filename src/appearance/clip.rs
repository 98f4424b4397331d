//! Clipping as users request it: its place in the world depends on the volume.

use std::str::FromStr;

use glam::DVec3;

use crate::camera::clip::{Clip, Plane};
use crate::error::{Error, Result};
use crate::settings::parse::{expect, list};
use crate::volume::Volume;

/// A range of voxels along an axis; a missing end is the end of the volume.
type Voxels = [Option<u32>; 2];

/// A requested clip: a part of the volume that stays.
#[derive(Debug, Clone, PartialEq)]
pub enum ClipSpec {
    /// The half of a volume in a direction.
    Half(DVec3),
    /// The half of the patient on a side, and its direction in the world.
    Side(char, DVec3),
    /// The inner side of a plane.
    Plane(Plane),
    /// A box of the world.
    Box(Clip),
    /// The cells of some voxels.
    Voxels([Voxels; 3]),
}

/// The sides of a patient in the world of oriented files.
const SIDES: [(char, DVec3); 6] =
    [('L', DVec3::X), ('R', DVec3::NEG_X), ('P', DVec3::Y), ('A', DVec3::NEG_Y), ('S', DVec3::Z), ('I', DVec3::NEG_Z)];

impl ClipSpec {
    /// Returns the part of a volume that stays.
    fn inside(&self, volume: &Volume) -> Result<Clip> {
        let grid = volume.grid();
        let plane = match self {
            Self::Box(inside) => return Ok(inside.clone()),
            Self::Voxels(voxels) => {
                let range = |axis: usize| voxels[axis][0].unwrap_or(0)..voxels[axis][1].unwrap_or(grid.dims()[axis]);
                let named = |error| match error {
                    Error::Setting { reason, .. } => Error::setting("clip", reason),
                    other => other,
                };
                return Clip::of_voxels(grid, [0, 1, 2].map(range)).map_err(named);
            }
            Self::Plane(plane) => *plane,
            Self::Side(letter, _) if !volume.is_oriented() => {
                let reason =
                    format!("{letter}: the file does not state the patient's sides, give a direction NX,NY,NZ");
                return Err(Error::setting("clip", reason));
            }
            Self::Half(normal) | Self::Side(_, normal) => Plane::through(grid.center(), *normal)?,
        };
        Clip::new(vec![plane])
    }

    /// Returns the region that all requests leave of a volume.
    ///
    /// # Errors
    /// [`Error::Setting`] if the volume has no such sides or voxels, if there are over 8 planes, or if nothing is left.
    pub fn intersection(requests: &[Self], volume: &Volume) -> Result<Clip> {
        requests.iter().try_fold(Clip::default(), |clip, request| clip.and(request.inside(volume)?))
    }
}

impl FromStr for ClipSpec {
    type Err = Error;

    /// Parses `box:X0,X1,Y0,Y1,Z0,Z1`, `voxels:I0:I1,J0:J1,K0:K1`, a side of the patient, `NX,NY,NZ`, `NX,NY,NZ,D` or
    /// `NX,NY,NZ,X,Y,Z`.
    fn from_str(text: &str) -> Result<Self> {
        if let Some(numbers) = text.strip_prefix("box:") {
            return clip_box(numbers).map(Self::Box);
        }
        if let Some(ranges) = text.strip_prefix("voxels:") {
            return voxels(ranges).map(Self::Voxels);
        }
        let expected = "a direction NX,NY,NZ over 0, with a distance D or a point X,Y,Z behind it, L, R, A, P, S \
                        or I, box:X0,X1,Y0,Y1,Z0,Z1 or voxels:I0:I1,J0:J1,K0:K1";
        if let Some((letter, normal)) = SIDES.into_iter().find(|(side, _)| text == side.to_string()) {
            return Ok(Self::Side(letter, normal));
        }
        let numbers: Option<Vec<f64>> = text.split(',').map(|part| part.trim().parse().ok()).collect();
        let half = match numbers.as_deref() {
            Some(&[x, y, z]) => Plane::new(DVec3::new(x, y, z), 0.0).map(|_| Self::Half(DVec3::new(x, y, z))).ok(),
            Some(&[x, y, z, offset]) => Plane::new(DVec3::new(x, y, z), offset).map(Self::Plane).ok(),
            Some(&[x, y, z, px, py, pz]) => {
                Plane::through(DVec3::new(px, py, pz), DVec3::new(x, y, z)).map(Self::Plane).ok()
            }
            _ => None,
        };
        expect("clip", half, expected)
    }
}

/// Parses a box of the world, `X0,X1,Y0,Y1,Z0,Z1`.
fn clip_box(text: &str) -> Result<Clip> {
    let inside = |[x0, x1, y0, y1, z0, z1]: [f64; 6]| Clip::of_box(DVec3::new(x0, y0, z0), DVec3::new(x1, y1, z1)).ok();
    expect(
        "clip",
        list(text).and_then(inside),
        "box: and six numbers X0,X1,Y0,Y1,Z0,Z1, the first of each pair below the second",
    )
}

/// Parses voxels along the axes, `I0:I1,J0:J1,K0:K1`.
fn voxels(text: &str) -> Result<[Voxels; 3]> {
    let number = |text: &str| match text.trim() {
        "" => Some(None),
        text => text.parse().ok().map(Some),
    };
    let range = |part: &str| part.split_once(':').and_then(|(start, end)| Some([number(start)?, number(end)?]));
    let ranges: Option<Vec<Voxels>> = text.split(',').map(range).collect();
    let ranges = ranges.and_then(|ranges| ranges.try_into().ok());
    expect("clip", ranges, "voxels: and three ranges I0:I1,J0:J1,K0:K1, such as voxels:10:20,:,40:")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn planes_are_directions_with_a_place() {
        let clip = |text: &str| text.parse::<ClipSpec>().map_err(|error| error.to_string());
        assert_eq!(clip("R"), Ok(ClipSpec::Side('R', DVec3::NEG_X)));
        assert_eq!(clip("0, -2,0"), Ok(ClipSpec::Half(DVec3::new(0.0, -2.0, 0.0))));
        let plane = |normal, offset| Ok(ClipSpec::Plane(Plane::new(normal, offset).unwrap()));
        assert_eq!(clip("0,0,2,-7"), plane(DVec3::Z, -7.0));
        assert_eq!(clip("0,0,-1,5,6,7"), plane(DVec3::NEG_Z, -7.0));
        for bad in ["", "X", "1,2", "0,0,0", "0,0,0,1", "1,0,0,nan", "1,0,0,1,2", "1,0,0,1,2,inf"] {
            assert!(clip(bad).unwrap_err().starts_with("clip: expected a direction"), "{bad}");
        }
    }

    #[test]
    fn boxes_and_voxels() {
        let clip = |text: &str| text.parse::<ClipSpec>().map_err(|error| error.to_string());
        let Ok(ClipSpec::Box(inside)) = clip("box:0,1,-inf,3,4,inf") else { panic!("no box") };
        assert_eq!(inside.planes().len(), 4);
        let ranges = [[Some(1), Some(2)], [None, None], [Some(3), None]];
        assert_eq!(clip("voxels:1:2,:,3:"), Ok(ClipSpec::Voxels(ranges)));
        for bad in ["box:0,1,2,3,4", "box:1,0,0,1,0,1", "box:a"] {
            assert!(clip(bad).unwrap_err().starts_with("clip: expected box: and six numbers"), "{bad}");
        }
        for bad in ["1:2,3:4", "1,2,3", "-1:2,:,:", "1:2:3,:,:"] {
            assert!(
                clip(&format!("voxels:{bad}")).unwrap_err().starts_with("clip: expected voxels: and three"),
                "{bad}"
            );
        }
    }
}
