//! Isosurfaces: points of a transfer function between others at the same value.

use super::{ControlPoint, TransferFunction};
use crate::error::{Error, Result};

impl TransferFunction {
    /// The largest number of isosurfaces that is accepted.
    pub const MAX_ISOSURFACES: usize = 16;

    /// Returns the isosurfaces, values ascending: the visible points that lie between two others at the same value. A
    /// composite shows each as a surface without thickness, where the reconstructed scalar passes its value. Its
    /// opacity is that of the surface, from all directions, and not of a slab. Other models leave isosurfaces out. The
    /// painter `quads` refuses them, and `tiles` draws them in post-shading alone.
    ///
    /// ```
    /// use voxsplat::transfer::{ControlPoint, TransferFunction};
    ///
    /// let skin = ControlPoint { value: -300.0, color: [0.9, 0.7, 0.6], opacity: 0.3 };
    /// let bone = ControlPoint { value: 250.0, color: [1.0, 0.95, 0.85], opacity: 1.0 };
    /// let transfer = TransferFunction::of_isosurfaces(&[bone, skin])?;
    /// assert_eq!(transfer.isosurfaces(), [skin, bone]);
    /// assert_eq!(transfer.sample(250.0).1, 0.0);
    /// # Ok::<(), voxsplat::error::Error>(())
    /// ```
    #[must_use]
    pub fn isosurfaces(&self) -> Vec<ControlPoint> {
        let between = |w: &&[ControlPoint]| w[0].value == w[2].value && w[1].opacity > 0.0;
        self.points.windows(3).filter(between).map(|w| w[1]).collect()
    }

    /// Makes a function that is clear but for isosurfaces, in any order.
    ///
    /// # Errors
    /// [`Error::Transfer`] if there is none or more than [`Self::MAX_ISOSURFACES`], if a value is not finite, or if a
    /// colour or an opacity is outside 0..1.
    pub fn of_isosurfaces(isosurfaces: &[ControlPoint]) -> Result<Self> {
        let [first, ..] = isosurfaces else { return Err(Self::wrong_count(0)) };
        Self::new(vec![ControlPoint { opacity: 0.0, ..*first }], None)?.with_isosurfaces(isosurfaces)
    }

    /// Returns the function with further isosurfaces, in any order.
    ///
    /// # Errors
    /// [`Error::Transfer`] if there are more than [`Self::MAX_ISOSURFACES`] in all, if a value is not finite, or if a
    /// colour or an opacity is outside 0..1.
    pub fn with_isosurfaces(mut self, isosurfaces: &[ControlPoint]) -> Result<Self> {
        for surface in isosurfaces {
            surface.check(None).map_err(|reason| Error::Transfer(format!("isosurface: {reason}")))?;
            let (color, opacity) = self.sample(surface.value);
            let beside = ControlPoint { value: surface.value, color, opacity };
            let at = self.points.partition_point(|p| p.value <= surface.value);
            // Of a jump, the value before it stays before the surface.
            let before = match self.points.get(at.wrapping_sub(1)) {
                Some(last) if last.value == surface.value => vec![*surface, beside],
                _ => vec![beside, *surface, beside],
            };
            self.points.splice(at..at, before);
        }
        let count = self.isosurfaces().len();
        if count > Self::MAX_ISOSURFACES {
            return Err(Error::Transfer(format!("{count} isosurfaces, expected at most {}", Self::MAX_ISOSURFACES)));
        }
        Self::new(self.points, self.unit_distance)?
            .with_gradient_opacity(self.gradient)
            .map(|transfer| transfer.with_classification(self.classification))
    }

    /// Returns the function without these of its isosurfaces. [`Self::with_isosurfaces`] adds them again.
    #[must_use]
    #[doc(hidden)]
    pub fn without_isosurfaces(mut self, isosurfaces: &[ControlPoint]) -> Self {
        for surface in isosurfaces {
            if let Some(at) = self.points.windows(3).position(|w| w[0].value == w[2].value && w[1] == *surface) {
                self.points.drain(at + 1..at + 3);
            }
        }
        self
    }
}

/// Returns the extinction per world unit of isosurfaces in a voxel that casts a shadow, given its value and the length
/// of its gradient in values per voxel and per world unit.
///
/// Each surface is a tent as wide as the change of values over a voxel to either side, so rays lose as much in voxels
/// as at the surface.
pub(crate) fn casting(surfaces: &[ControlPoint], value: f64, [per_voxel, per_unit]: [f64; 2]) -> f64 {
    if per_voxel <= 0.0 {
        return 0.0;
    }
    let tent = |surface: &ControlPoint| {
        let share = 1.0 - (value - surface.value).abs() / per_voxel;
        TransferFunction::extinction(surface.opacity, 1.0) * share.max(0.0)
    };
    surfaces.iter().map(tent).sum::<f64>() * per_unit / per_voxel
}
