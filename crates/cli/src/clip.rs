//! Clipping, as options request it: its place in the world depends on the volume.

use glam::DVec3;
use voxsplat::clip::{Clip, Plane};
use voxsplat::volume::Volume;

use super::failure::{Failure, refuse};
use super::layers::named;
use super::parse::{expect, list};

/// A range of voxels along an axis; a missing end is the end of the volume.
type Voxels = [Option<u32>; 2];

/// The value of `--clip`.
#[derive(Debug, Clone, PartialEq)]
pub(crate) enum ClipArg {
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

impl ClipArg {
    /// Returns the part of a volume that stays.
    fn inside(&self, volume: &Volume) -> Result<Clip, Failure> {
        let grid = volume.grid();
        let plane = match self {
            Self::Box(inside) => return Ok(inside.clone()),
            Self::Voxels(voxels) => {
                let range = |axis: usize| voxels[axis][0].unwrap_or(0)..voxels[axis][1].unwrap_or(grid.dims()[axis]);
                return Ok(Clip::of_voxels(grid, [0, 1, 2].map(range)).map_err(|error| named(error, "clip"))?);
            }
            Self::Plane(plane) => *plane,
            Self::Side(letter, _) if !volume.is_oriented() => {
                return refuse(format!(
                    "--clip {letter}: the file does not state the patient's sides, give a direction NX,NY,NZ"
                ));
            }
            Self::Half(normal) | Self::Side(_, normal) => Plane::through(grid.center(), *normal)?,
        };
        Ok(Clip::new(vec![plane])?)
    }
}

/// Returns the region that all values of `--clip` leave of a volume.
pub(crate) fn intersection(args: &[ClipArg], volume: &Volume) -> Result<Clip, Failure> {
    args.iter().try_fold(Clip::default(), |clip, arg| Ok(clip.and(arg.inside(volume)?)?))
}

/// Parses `box:X0,X1,Y0,Y1,Z0,Z1`, `voxels:I0:I1,J0:J1,K0:K1`, a side of the patient, `NX,NY,NZ`, `NX,NY,NZ,D` or
/// `NX,NY,NZ,X,Y,Z`.
pub(crate) fn clip(text: &str) -> Result<ClipArg, String> {
    if let Some(numbers) = text.strip_prefix("box:") {
        return clip_box(numbers).map(ClipArg::Box);
    }
    if let Some(ranges) = text.strip_prefix("voxels:") {
        return voxels(ranges).map(ClipArg::Voxels);
    }
    let expected = "a direction NX,NY,NZ over 0, with a distance D or a point X,Y,Z behind it, L, R, A, P, S \
                    or I, box:X0,X1,Y0,Y1,Z0,Z1 or voxels:I0:I1,J0:J1,K0:K1";
    if let Some((letter, normal)) = SIDES.into_iter().find(|(side, _)| text == side.to_string()) {
        return Ok(ClipArg::Side(letter, normal));
    }
    let numbers: Option<Vec<f64>> = text.split(',').map(|part| part.trim().parse().ok()).collect();
    let half = match numbers.as_deref() {
        Some(&[x, y, z]) => Plane::new(DVec3::new(x, y, z), 0.0).map(|_| ClipArg::Half(DVec3::new(x, y, z))).ok(),
        Some(&[x, y, z, offset]) => Plane::new(DVec3::new(x, y, z), offset).map(ClipArg::Plane).ok(),
        Some(&[x, y, z, px, py, pz]) => {
            Plane::through(DVec3::new(px, py, pz), DVec3::new(x, y, z)).map(ClipArg::Plane).ok()
        }
        _ => None,
    };
    expect(half, expected)
}

/// Parses a box of the world, `X0,X1,Y0,Y1,Z0,Z1`.
fn clip_box(text: &str) -> Result<Clip, String> {
    let inside = |[x0, x1, y0, y1, z0, z1]: [f64; 6]| Clip::of_box(DVec3::new(x0, y0, z0), DVec3::new(x1, y1, z1)).ok();
    expect(
        list(text).and_then(inside),
        "box: and six numbers X0,X1,Y0,Y1,Z0,Z1, the first of each pair below the second",
    )
}

/// Parses voxels along the axes, `I0:I1,J0:J1,K0:K1`.
fn voxels(text: &str) -> Result<[Voxels; 3], String> {
    let number = |text: &str| match text.trim() {
        "" => Some(None),
        text => text.parse().ok().map(Some),
    };
    let range = |part: &str| part.split_once(':').and_then(|(start, end)| Some([number(start)?, number(end)?]));
    let ranges: Option<Vec<Voxels>> = text.split(',').map(range).collect();
    let ranges = ranges.and_then(|ranges| ranges.try_into().ok());
    expect(ranges, "voxels: and three ranges I0:I1,J0:J1,K0:K1, such as voxels:10:20,:,40:")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn planes_are_directions_with_a_place() {
        assert_eq!(clip("R"), Ok(ClipArg::Side('R', DVec3::NEG_X)));
        assert_eq!(clip("0, -2,0"), Ok(ClipArg::Half(DVec3::new(0.0, -2.0, 0.0))));
        let plane = |normal, offset| Ok(ClipArg::Plane(Plane::new(normal, offset).unwrap()));
        assert_eq!(clip("0,0,2,-7"), plane(DVec3::Z, -7.0));
        assert_eq!(clip("0,0,-1,5,6,7"), plane(DVec3::NEG_Z, -7.0));
        for bad in ["", "X", "1,2", "0,0,0", "0,0,0,1", "1,0,0,nan", "1,0,0,1,2", "1,0,0,1,2,inf"] {
            assert!(clip(bad).unwrap_err().starts_with("expected a direction"), "{bad}");
        }
    }

    #[test]
    fn boxes_and_voxels() {
        let Ok(ClipArg::Box(inside)) = clip("box:0,1,-inf,3,4,inf") else { panic!("no box") };
        assert_eq!(inside.planes().len(), 4);
        let ranges = [[Some(1), Some(2)], [None, None], [Some(3), None]];
        assert_eq!(clip("voxels:1:2,:,3:"), Ok(ClipArg::Voxels(ranges)));
        for bad in ["box:0,1,2,3,4", "box:1,0,0,1,0,1", "box:a"] {
            assert!(clip(bad).unwrap_err().starts_with("expected box: and six numbers"), "{bad}");
        }
        for bad in ["1:2,3:4", "1,2,3", "-1:2,:,:", "1:2:3,:,:"] {
            assert!(clip(&format!("voxels:{bad}")).unwrap_err().starts_with("expected voxels: and three"), "{bad}");
        }
    }
}
