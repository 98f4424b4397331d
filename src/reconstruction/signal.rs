//! Signals that are known everywhere.

use glam::DVec3;

use crate::demos;
use crate::names::named;

/// A signal over the cube from -1 to 1 along each axis.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
pub enum Signal {
    /// The test signal of Marschner and Lobb (1994), whose finest waves are near what a lattice of 40^3 samples can
    /// hold.
    #[default]
    MarschnerLobb,
    /// Five Gaussians of standard deviations 0.045 to 0.3.
    Gaussians,
    /// The 3-D Shepp-Logan head: ellipsoids with sharp edges.
    SheppLogan,
}

named! { "signal", Signal { MarschnerLobb: "marschner-lobb", Gaussians: "gaussians", SheppLogan: "shepp-logan" } }

/// Peak, centre and standard deviation.
const GAUSSIANS: [(f64, [f64; 3], f64); 5] = [
    (0.5, [0.05, -0.1, 0.0], 0.3),
    (0.4, [-0.35, 0.3, 0.2], 0.12),
    (0.3, [0.4, 0.35, -0.3], 0.08),
    (0.3, [0.3, -0.4, 0.35], 0.06),
    (0.3, [-0.3, -0.35, -0.4], 0.045),
];

impl Signal {
    /// Its value at a point.
    #[must_use]
    pub fn value(self, p: DVec3) -> f64 {
        match self {
            Self::MarschnerLobb => demos::marschner_lobb_at(p),
            Self::SheppLogan => demos::shepp_logan_at(p),
            Self::Gaussians => GAUSSIANS
                .iter()
                .map(|&(peak, center, sigma)| {
                    peak * (-(p - DVec3::from_array(center)).length_squared() / (2.0 * sigma * sigma)).exp()
                })
                .sum(),
        }
    }

    /// Its integral from `origin` over `length` along the unit vector `direction`.
    pub(super) fn integral(self, origin: DVec3, direction: DVec3, length: f64) -> f64 {
        /// Nodes of the rule of the midpoint for smooth signals: waves are 0.1 long and more.
        const NODES: u32 = 2000;
        match self {
            Self::SheppLogan => demos::shepp_logan_chord(origin, direction, length),
            _ => {
                let step = length / f64::from(NODES);
                (0..NODES).map(|i| self.value(origin + direction * ((f64::from(i) + 0.5) * step))).sum::<f64>() * step
            }
        }
    }
}
