//! The twin of shaders/common/lit_splat.wgsl on the host: the colours of splats under light.

mod light;

use pulp::{Arch, NullaryFnOnce};

use self::light::Shining;
use crate::splats::words::{Lanes, SplatRun, Vectors, appearances};

pub(crate) use self::light::{SplatLight, ToEye};

/// The steps of a gradient: `splat_gradient` in shaders/common/splat.wgsl.
pub(crate) fn gradient([low, high]: [u32; 2]) -> [f32; 3] {
    let signed = |bits: u32| (bits << 14) as i32 >> 14;
    let steps = [low, low >> 18 | (high & 15) << 14, high >> 4].map(|bits| signed(bits & 0x3_ffff));
    let step = f32::from_bits(high >> 22 << 23) / 65_536.0;
    steps.map(|c| c as f32 * step)
}

impl SplatRun<'_> {
    /// The colours under a light, `None` for unlit ones, and the densities of classified splats.
    pub(crate) fn appearances(&self, light: Option<&SplatLight>) -> (Vectors, Lanes) {
        Arch::new().dispatch(Appearances { run: self, light })
    }
}

/// The parameters of [`SplatRun::appearances`], as a type like [`Shining`].
struct Appearances<'a> {
    run: &'a SplatRun<'a>,
    light: Option<&'a SplatLight>,
}

impl NullaryFnOnce for Appearances<'_> {
    type Output = (Vectors, Lanes);

    #[inline(always)]
    fn call(self) -> Self::Output {
        let Self { run, light } = self;
        let (mut colors, densities) = appearances(&run.column(0), &run.column(1));
        if let Some(light) = light {
            let (points, normals) = ((&run.xs, [run.y, run.z]), &run.column(2));
            Shining { light, points, colors: &mut colors, normals, arriving: run.kept().as_ref() }.call();
        }
        (colors, densities)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::gpu::layout::Lighting;

    #[test]
    fn wider_vectors_change_no_bit_of_splats() {
        let random = |i: u32| (i + 1).wrapping_mul(2_654_435_761) ^ i.wrapping_mul(40_503);
        let density = |i: u32| (0.01 + (i % 50) as f32).to_bits();
        let words: Vec<u32> = (0..16).flat_map(|i| [density(i), random(3 * i), random(3 * i + 1)]).collect();
        let kept: Vec<[u32; 2]> = (0..16).map(|i| [random(100 + i), random(200 + i)]).collect();
        let lighting = Lighting {
            right: [0.8, 0.1, 0.0],
            up: [0.0, 1.1, 0.3],
            forward: [-0.6, 0.2, 1.0],
            ambient: 0.15,
            diffuse: 0.6,
            specular: 0.3,
            shininess: 24.0,
            lights: [[0.0; 4], [0.6, 0.0, -0.8, 0.0], [3.0, 4.0, -5.0, 1.0], [0.0; 4]],
            colors: [[0.9, 0.8, 0.7, 0.0]; 4],
            from_lattice: [[0.1, 0.0, 0.0, 0.0], [0.0, 0.1, 0.0, 0.0], [0.0, 0.0, 0.1, 0.0], [0.0; 4]],
            ..Lighting::default()
        };
        let view = [[1.0, 0.0, 0.2], [0.0, 1.0, 0.1], [-0.2, 0.0, 1.0]];
        let to_eye = ToEye { perspective: true, eye: [40.0, -10.0, -90.0], view };
        let light = SplatLight { lighting, lights: 3, points: true, to_eye };
        for (light, kept) in [(None, &[][..]), (Some(&light), &[]), (Some(&light), &kept)] {
            let xs = std::array::from_fn(|i| 5 + i as u32);
            let run = SplatRun { xs, y: 3, z: 60, each: 3, words: &words, light: kept };
            let narrow = Appearances { run: &run, light }.call();
            assert_eq!(run.appearances(light), narrow);
            assert!(narrow.0[0].iter().any(|&red| red > 0.0));
        }
    }
}
