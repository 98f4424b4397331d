//! Synthetic scans of many kinds: phantoms of tissues, imaged by the physics of each method.
//!
//! A phantom gives each voxel its shares of tissues, with partial volumes. CT shows Hounsfield units with normal noise.
//! MRI shows the signal equations of its sequences (Bernstein, King and Zhou 2004, "Handbook of MRI pulse sequences")
//! with a receive field and Rician noise. The numbers are of the literature; none is fitted to a rule of suggestions.

use std::f64::consts::TAU;

use voxsplat::volume::{Sample, Units, Volume};

/// Samples along an edge of a phantom.
const EDGE: usize = 64;
const COUNT: usize = EDGE * EDGE * EDGE;

/// A kind of volume, and the preset that suits it, or `labels`.
pub(super) struct Kind {
    pub(super) name: &'static str,
    pub(super) expected: &'static str,
    pub(super) volume: Volume,
}

/// A linear congruential generator, 0..1: the same sequence on every machine.
struct Random(u64);

impl Random {
    fn next(&mut self) -> f64 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 40) as f64 / (1 << 24) as f64
    }

    fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.next()
    }

    /// A normally distributed number (Box and Muller).
    fn normal(&mut self) -> f64 {
        (-2.0 * self.next().max(1e-9).ln()).sqrt() * (TAU * self.next()).cos()
    }
}

#[derive(Clone, Copy, PartialEq)]
enum Tissue {
    Air,
    Fat,
    Muscle,
    Bone,
    Marrow,
    Csf,
    Gray,
    White,
    Blood,
    Lung,
    Organ,
    Lesion,
}

use Tissue::{Air, Blood, Bone, Csf, Fat, Gray, Lesion, Lung, Marrow, Muscle, Organ, White};

const TISSUES: [Tissue; 12] = [Air, Fat, Muscle, Bone, Marrow, Csf, Gray, White, Blood, Lung, Organ, Lesion];

impl Tissue {
    /// Hounsfield units without contrast agent.
    fn hounsfield(self) -> f64 {
        match self {
            Air => -1000.0,
            Fat => -100.0,
            Muscle => 55.0,
            Bone => 1150.0,
            Marrow => 260.0,
            Csf => 8.0,
            Gray => 37.0,
            White => 29.0,
            Blood => 45.0,
            Lung => -840.0,
            Organ => 60.0,
            Lesion => 50.0,
        }
    }

    /// Proton density, T1, T2 and T2* in ms, at 1.5 to 3 tesla.
    fn relaxation(self) -> [f64; 4] {
        match self {
            Air => [0.0, 1000.0, 1.0, 1.0],
            Fat => [1.0, 350.0, 110.0, 40.0],
            Muscle => [0.8, 1300.0, 40.0, 30.0],
            Bone => [0.05, 1000.0, 1.0, 1.0],
            Marrow => [0.7, 550.0, 55.0, 20.0],
            Csf => [1.0, 4000.0, 1800.0, 300.0],
            Gray => [0.82, 1300.0, 100.0, 60.0],
            White => [0.7, 830.0, 78.0, 50.0],
            Blood => [0.85, 1600.0, 200.0, 60.0],
            Lung => [0.15, 1200.0, 40.0, 2.0],
            Organ => [0.8, 750.0, 45.0, 25.0],
            Lesion => [0.85, 1500.0, 140.0, 80.0],
        }
    }

    fn is_brain(self) -> bool {
        matches!(self, Csf | Gray | White | Lesion)
    }
}

/// The length of a place, in units of half axes.
fn radius(p: [f64; 3], center: [f64; 3], axes: [f64; 3]) -> f64 {
    (0..3).map(|a| ((p[a] - center[a]) / axes[a]).powi(2)).sum::<f64>().sqrt()
}

/// Whether a place lies in one of ten winding vessels along z.
fn in_vessel([x, y, z]: [f64; 3], wide: f64) -> bool {
    (0..10).any(|k| {
        let k = f64::from(k);
        let (along, around) = (0.5 * (0.5 + 0.05 * k), 2.4 * k);
        let center = [along * around.cos() + 0.08 * (4.0 * z + k).sin(), along * around.sin() + 0.08 * (3.0 * z).cos()];
        (x - center[0]).hypot(y - center[1]) < wide * (1.0 - 0.05 * k)
    })
}

/// A head from the chin to the crown.
fn head(p: [f64; 3]) -> Tissue {
    let r = radius(p, [0.0; 3], [0.72, 0.9, 0.95]);
    let folds = 0.025 * ((14.0 * p[0]).sin() + (13.0 * p[1]).sin() + (15.0 * p[2]).sin());
    let ventricle = radius([p[0].abs(), p[1], p[2]], [0.12, 0.0, 0.1], [0.07, 0.28, 0.12]) < 1.0;
    if r > 1.0 {
        Air
    } else if radius(p, [0.0, -0.62, -0.35], [0.16, 0.16, 0.2]) < 1.0 {
        if (30.0 * p[0]).sin() > 0.9 { Bone } else { Air }
    } else if r > 0.93 {
        Fat
    } else if p[2] < -0.55 {
        if radius(p, [0.0, 0.2, p[2]], [0.13, 0.13, 1.0]) < 1.0 { Bone } else { Muscle }
    } else if r > 0.9 {
        Bone
    } else if r > 0.87 {
        Marrow
    } else if r > 0.85 {
        Bone
    } else if in_vessel(p, 0.035) {
        Blood
    } else if r > 0.82 || ventricle {
        Csf
    } else if radius(p, [0.25, 0.25, 0.3], [0.09; 3]) < 1.0 {
        Lesion
    } else if r + folds > 0.66 {
        if r + folds > 0.75 && folds < -0.03 { Csf } else { Gray }
    } else {
        White
    }
}

/// A chest over an abdomen.
fn body(p: [f64; 3]) -> Tissue {
    let r = radius([p[0], p[1], 0.0], [0.0; 3], [0.92, 0.62, 1.0]);
    let lung = radius([p[0].abs(), p[1], p[2]], [0.4, 0.0, 0.55], [0.27, 0.36, 0.6]);
    let spine = radius(p, [0.0, 0.35, p[2]], [0.12, 0.1, 1.0]);
    if r > 1.0 {
        Air
    } else if r > 0.87 {
        Fat
    } else if spine < 1.0 {
        if spine > 0.75 { Bone } else { Marrow }
    } else if (0.78..0.83).contains(&r) && (22.0 * p[2] + 4.0 * p[1]).sin() > 0.3 && p[2] > -0.3 {
        Bone
    } else if radius(p, [0.05, 0.18, p[2]], [0.055, 0.055, 1.0]) < 1.0 || in_vessel(p, 0.022) {
        Blood
    } else if lung < 1.0 {
        Lung
    } else if r > 0.75 {
        Muscle
    } else if radius(p, [-0.35, 0.0, -0.3], [0.35, 0.35, 0.45]) < 1.0 {
        Organ
    } else if (9.0 * p[0]).sin() * (9.0 * p[1]).sin() > 0.2 {
        Fat
    } else {
        Muscle
    }
}

/// A volume of tissues: their shares of each voxel.
struct Phantom(Vec<[f32; TISSUES.len()]>);

impl Phantom {
    /// A phantom that fills a share of the field of view.
    fn new(of: impl Fn([f64; 3]) -> Tissue, fill: f64) -> Self {
        let place = |i: usize, half: usize| ((2 * i + half) as f64 + 0.5 - EDGE as f64) / EDGE as f64 / fill;
        let voxel = |at: usize| {
            let [x, y, z] = [at % EDGE, at / EDGE % EDGE, at / (EDGE * EDGE)];
            let mut shares = [0.0; TISSUES.len()];
            for half in 0..8 {
                let p = [place(x, half & 1), place(y, (half >> 1) & 1), place(z, half >> 2)];
                shares[of(p) as usize] += 0.125;
            }
            shares
        };
        Self((0..COUNT).map(voxel).collect())
    }

    fn shows(&self, value: impl Fn(Tissue) -> f64) -> Vec<f64> {
        let values = TISSUES.map(value);
        self.0.iter().map(|shares| shares.iter().zip(values).map(|(&share, v)| f64::from(share) * v).sum()).collect()
    }
}

/// The variation of a series of volumes: the seed 0 is the usual.
struct Maker {
    random: Random,
    head: Phantom,
    body: Phantom,
    /// Noise, in shares of the usual noise.
    noise: f64,
    /// The values of MRI for a full signal.
    gain: f64,
}

impl Maker {
    /// CT in Hounsfield units, with blood of some units.
    fn ct(&mut self, is_head: bool, blood: f64) -> Vec<f64> {
        let phantom = if is_head { &self.head } else { &self.body };
        let values = phantom.shows(|tissue| if tissue == Blood { blood } else { tissue.hounsfield() });
        let spread = 16.0 * self.noise;
        values.into_iter().map(|v| (v + spread * self.random.normal()).max(-1024.0)).collect()
    }

    /// MRI by a signal of each tissue, 0 to about 1, with noise of a share of a signal of 1.
    fn mr(&mut self, is_head: bool, noise: f64, signal: impl Fn(Tissue) -> f64) -> Vec<f64> {
        let phantom = if is_head { &self.head } else { &self.body };
        let values = phantom.shows(signal);
        let spread = noise * self.noise;
        let field = |at: usize| {
            let [x, y, z] = [at % EDGE, at / EDGE % EDGE, at / (EDGE * EDGE)].map(|i| i as f64 / EDGE as f64 - 0.5);
            1.0 + 0.25 * x - 0.2 * y + 0.2 * z
        };
        let noisy = |(at, v): (usize, f64)| {
            let [a, b] = [self.random.normal(), self.random.normal()];
            self.gain * (v * field(at) + spread * a).hypot(spread * b)
        };
        values.into_iter().enumerate().map(noisy).collect()
    }

    /// Values where the phantom has mostly tissues of a kind, and 0 elsewhere.
    fn masked(&self, values: Vec<f64>, is_head: bool, keeps: impl Fn(Tissue) -> bool) -> Vec<f64> {
        let phantom = if is_head { &self.head } else { &self.body };
        let kept = |shares: &[f32; TISSUES.len()]| {
            TISSUES.iter().zip(shares).filter(|(tissue, _)| keeps(**tissue)).map(|(_, share)| share).sum::<f32>() > 0.5
        };
        values.into_iter().zip(&phantom.0).map(|(v, shares)| if kept(shares) { v } else { 0.0 }).collect()
    }
}

/// A spoiled gradient echo with a flip angle in degrees and a repetition and an echo time in ms.
fn gradient_echo(tissue: Tissue, flip: f64, repetition: f64, echo: f64) -> f64 {
    let ([density, t1, _, t2_star], flip) = (tissue.relaxation(), flip.to_radians());
    let recovered = (-repetition / t1).exp();
    density * flip.sin() * (1.0 - recovered) / (1.0 - flip.cos() * recovered) * (-echo / t2_star).exp()
}

/// A spin echo with a repetition and an echo time in ms; flowing blood has no signal.
fn spin_echo(tissue: Tissue, repetition: f64, echo: f64) -> f64 {
    let [density, t1, t2, _] = tissue.relaxation();
    let flows = if tissue == Blood { 0.1 } else { 1.0 };
    flows * density * (1.0 - (-repetition / t1).exp()) * (-echo / t2).exp()
}

fn t1(tissue: Tissue) -> f64 {
    3.0 * gradient_echo(tissue, 25.0, 20.0, 4.0) + if tissue == Blood { 0.1 } else { 0.0 }
}

fn t1_with_contrast(tissue: Tissue) -> f64 {
    let [density, ..] = tissue.relaxation();
    match tissue {
        Blood => 0.75 * density,
        Lesion => 0.6 * density,
        other => t1(other),
    }
}

fn t2(tissue: Tissue) -> f64 {
    1.2 * spin_echo(tissue, 4000.0, 100.0)
}

fn proton_density(tissue: Tissue) -> f64 {
    spin_echo(tissue, 3000.0, 15.0)
}

/// T2 with inversion, which removes the signal of liquor.
fn flair(tissue: Tissue) -> f64 {
    let [_, t1, ..] = tissue.relaxation();
    let inverted = 1.0 - 2.0 * (-2500.0 / t1).exp() + (-9000.0 / t1).exp();
    2.5 * spin_echo(tissue, 9000.0, 120.0) * inverted.abs()
}

/// An echo-planar image: T2*, without fat.
fn echo_planar(tissue: Tissue) -> f64 {
    let fat = if tissue == Fat || tissue == Marrow { 0.1 } else { 1.0 };
    1.4 * fat * gradient_echo(tissue, 80.0, 2000.0, 30.0)
}

/// Time of flight: fresh blood, and tissue that the pulses saturate, water also by magnetisation transfer. An echo out
/// of phase takes a part of fat's signal.
fn time_of_flight(tissue: Tissue) -> f64 {
    let saturated = 3.0 * gradient_echo(tissue, 18.0, 25.0, 4.0);
    match tissue {
        Blood => 3.0 * 0.85 * 18.0_f64.to_radians().sin(),
        Fat | Marrow => 0.6 * saturated,
        _ => 0.7 * saturated,
    }
}

/// An angiogram with contrast agent, after subtraction of the image before.
fn subtracted(tissue: Tissue) -> f64 {
    match tissue {
        Air => 0.0,
        Blood => 0.9,
        Organ | Lesion => 0.12,
        Lung => 0.02,
        _ => 0.05,
    }
}

/// Diffusion weighting of 1000 s/mm2 on an echo-planar image.
fn diffusion(tissue: Tissue) -> f64 {
    let loses: f64 = match tissue {
        Csf => 3.0,
        Gray => 0.85,
        White | Lesion => 0.7,
        _ => 1.2,
    };
    let fat = if tissue == Fat || tissue == Marrow { 0.1 } else { 1.0 };
    3.0 * fat * spin_echo(tissue, 6000.0, 80.0) * (-loses).exp()
}

/// The largest value of all but one in 1000.
fn nearly_largest(values: &[f64]) -> f64 {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    sorted[sorted.len() - 1 - sorted.len() / 1000]
}

fn mapped(values: &[f64], map: impl FnMut(f64) -> f64) -> Vec<f64> {
    values.iter().copied().map(map).collect()
}

/// Samples of 8 bits between two values.
fn bytes(values: &[f64], low: f64, high: f64) -> Vec<u8> {
    values.iter().map(|v| (255.0 * (v - low) / (high - low)).round().clamp(0.0, 255.0) as u8).collect()
}

fn words(values: &[f64]) -> Vec<u16> {
    values.iter().map(|v| v.round().clamp(0.0, 65_535.0) as u16).collect()
}

fn signed(values: &[f64]) -> Vec<i16> {
    values.iter().map(|v| v.round().clamp(-32_768.0, 32_767.0) as i16).collect()
}

fn reals(values: &[f64]) -> Vec<f32> {
    values.iter().map(|&v| v as f32).collect()
}

fn bare<T: Sample>(spacing: f64, samples: &[T]) -> Volume {
    let edge = EDGE as u32;
    let deep = (samples.len() / (EDGE * EDGE)) as u32;
    Volume::from_slice([edge, edge, deep], [spacing, spacing, 1.5 * spacing], samples).unwrap()
}

/// A scan of a patient.
fn scan<T: Sample>(spacing: f64, samples: &[T]) -> Volume {
    bare(spacing, samples).with_orientation_known()
}

/// A volume in micrometres, as microscopes write it.
fn micrometres<T: Sample>(spacing: f64, samples: &[T]) -> Volume {
    bare(spacing, samples).with_units(Units { length: Some("µm".to_owned()), value: None })
}

fn in_units(volume: Volume, value: &str) -> Volume {
    volume.with_units(Units { value: Some(value.to_owned()), ..Units::default() })
}

/// The values of a function of places from -1 to 1.
fn field(of: impl Fn([f64; 3]) -> f64) -> Vec<f64> {
    let place = |i: usize| (2 * i + 1) as f64 / EDGE as f64 - 1.0;
    (0..COUNT).map(|at| of([place(at % EDGE), place(at / EDGE % EDGE), place(at / (EDGE * EDGE))])).collect()
}

/// Nuclei of cells: a number of bright balls on a dim cytoplasm, after blur by an objective, with photon noise over the
/// offset of a camera.
fn cells(random: &mut Random, count: usize, size: f64, haze: f64) -> Vec<f64> {
    let balls: Vec<([f64; 3], f64, f64)> = (0..count)
        .map(|_| {
            let center = std::array::from_fn(|_| random.between(-1.0, 1.0));
            (center, size * random.between(0.7, 1.3), random.between(0.4, 1.6))
        })
        .collect();
    let mut values = field(|p| {
        let light = |&(center, size, bright): &([f64; 3], f64, f64)| {
            let r = radius(p, center, [size, size, 1.5 * size]);
            bright / (1.0 + (8.0 * (r - 1.0)).exp()) + haze * (-0.5 * r).exp()
        };
        balls.iter().map(light).sum()
    });
    for v in &mut values {
        let photons = 60.0 * *v + 2.0;
        *v = 100.0 + 20.0 * (photons + photons.sqrt() * random.normal()).max(0.0) + 6.0 * random.normal();
    }
    values
}

/// A normal distribution of unit variance smoothed over neighbours, as maps of statistics are.
fn smooth_noise(random: &mut Random) -> Vec<f64> {
    let waves: Vec<([f64; 3], f64)> =
        (0..60).map(|_| (std::array::from_fn(|_| 9.0 * random.normal()), random.between(0.0, TAU))).collect();
    field(|p| {
        let wave = |(k, phase): &([f64; 3], f64)| (k[0] * p[0] + k[1] * p[1] + k[2] * p[2] + phase).cos();
        waves.iter().map(wave).sum::<f64>() / (waves.len() as f64 / 2.0).sqrt()
    })
}

/// A name, the expected preset and a volume.
type Row = (&'static str, &'static str, Volume);

/// Volumes of every kind. Seeds other than 0 vary noise, scale, contrast and the share of the field of view.
pub(super) fn kinds(seed: u64) -> Vec<Kind> {
    let mut random = Random(seed.wrapping_mul(0x9e37_79b9_7f4a_7c15).wrapping_add(11));
    random.next();
    let mut vary = |usual: f64, low: f64, high: f64| if seed == 0 { usual } else { random.between(low, high) };
    let (fill, noise) = (vary(0.95, 0.75, 1.0), vary(1.0, 0.6, 1.8));
    let (gain, contrast) = (vary(900.0, 150.0, 3000.0), vary(350.0, 250.0, 450.0));
    let (head, body) = (Phantom::new(head, fill), Phantom::new(body, fill));
    let mut maker = Maker { random, head, body, noise, gain };
    let rows = [ct(&mut maker, contrast), mr(&mut maker), others(&mut maker)];
    rows.into_iter().flatten().map(|(name, expected, volume)| Kind { name, expected, volume }).collect()
}

fn ct(maker: &mut Maker, contrast: f64) -> Vec<Row> {
    let (head, body) = (maker.ct(true, 45.0), maker.ct(false, 45.0));
    let (head_agent, body_agent) = (maker.ct(true, contrast), maker.ct(false, contrast));
    let unsigned = |values: &[f64]| mapped(values, |v| v + 1024.0);
    let vessels = maker.masked(unsigned(&body_agent), false, |tissue| tissue == Blood);
    let no_bone =
        maker.masked(unsigned(&head_agent), true, |tissue| tissue != Bone && tissue != Marrow && tissue != Air);
    let fetal = field(|p| {
        let strut = (14.0 * p[0]).sin() * (14.0 * p[1]).cos() + (14.0 * p[2]).sin();
        if radius(p, [0.0; 3], [0.7, 0.7, 2.0]) < 1.0 && strut > 0.75 { 9000.0 } else { 1500.0 }
    });
    let trabecular = mapped(&fetal, |v| v + 900.0 * maker.random.normal());
    let cone_beam = mapped(&unsigned(&head), |v| v + 60.0 * maker.random.normal());
    let padded = field(|p| p[0].hypot(p[1]));
    let padded: Vec<f64> = body.iter().zip(padded).map(|(&v, r)| if r > 1.0 { -2000.0 } else { v }).collect();
    let mostly_flesh: Vec<f64> = mapped(&body[COUNT / 8..COUNT * 3 / 8], |v| v.max(-160.0));
    vec![
        ("CT head", "ct-bone", scan(0.5, &signed(&head))),
        ("CT body", "ct-bone", scan(0.8, &signed(&body))),
        ("CT body, padded with -2000", "ct-bone", scan(0.8, &signed(&padded))),
        ("CT body with contrast agent", "ct-bone", scan(0.8, &signed(&body_agent))),
        ("CT head, real numbers", "ct-bone", scan(0.5, &reals(&head))),
        ("CT body, HU stated, air cut off", "ct-bone", in_units(scan(0.8, &signed(&mostly_flesh)), "HU")),
        ("CT head + 1024", "ct-bone", scan(0.5, &words(&unsigned(&head)))),
        ("CT body + 1024", "ct-bone", scan(0.8, &words(&unsigned(&body)))),
        ("CT body + 1024 with contrast agent", "ct-bone", scan(0.8, &words(&unsigned(&body_agent)))),
        ("CT head + 1024, bare", "ct-bone", bare(1.0, &words(&unsigned(&head)))),
        ("CT body + 1024, bare", "ct-bone", bare(1.0, &words(&unsigned(&body)))),
        ("CT of a cone beam + 1024", "ct-bone", scan(0.4, &words(&cone_beam))),
        ("CT head, 8 bits", "ct-bone", scan(0.5, &bytes(&head, -1024.0, 1400.0))),
        ("CT body, 8 bits", "ct-bone", scan(0.8, &bytes(&body, -1024.0, 1400.0))),
        ("CT head, 8 bits, bare", "ct-bone", bare(1.0, &bytes(&head, -1024.0, 1400.0))),
        ("CT head, window of bone", "ct-bone", scan(0.5, &bytes(&head, -700.0, 1300.0))),
        ("CT head, window of flesh", "ct-bone", scan(0.5, &bytes(&head, -160.0, 440.0))),
        ("CT body, window of flesh", "ct-bone", scan(0.8, &bytes(&body, -160.0, 440.0))),
        ("CT head, 0 to 1", "ct-bone", scan(0.5, &reals(&mapped(&head, |v| (v + 1024.0) / 2600.0)))),
        ("CT body, 0 to 1", "ct-bone", scan(0.8, &reals(&mapped(&body, |v| (v + 1024.0) / 2600.0)))),
        ("micro-CT of trabecular bone", "ct-bone", bare(0.02, &words(&trabecular))),
        ("CT angiogram, vessels alone, bare", "angiography", bare(1.0, &signed(&vessels))),
        ("CT angiogram, vessels alone", "angiography", scan(0.6, &signed(&vessels))),
        ("CT angiogram without bone", "angiography", scan(0.6, &words(&no_bone))),
    ]
}

fn mr(maker: &mut Maker) -> Vec<Row> {
    let noise = 0.02;
    let (t1_head, t2_head) = (maker.mr(true, noise, t1), maker.mr(true, noise, t2));
    let (density, dark_csf) = (maker.mr(true, noise, proton_density), maker.mr(true, noise, flair));
    let agent = maker.mr(true, noise, t1_with_contrast);
    let (flow, difference) = (maker.mr(true, 0.012, time_of_flight), maker.mr(false, 0.015, subtracted));
    let (epi, dwi) = (maker.mr(true, 0.03, echo_planar), maker.mr(true, 0.03, diffusion));
    let mean_epi = {
        let mut sum = vec![0.0; COUNT];
        for _ in 0..8 {
            maker.mr(true, 0.03, echo_planar).into_iter().zip(&mut sum).for_each(|(v, sum)| *sum += v / 8.0);
        }
        sum
    };
    let (t1_body, t2_body) = (maker.mr(false, noise, t1), maker.mr(false, noise, t2));
    let is_inside = |tissue: Tissue| tissue != Air;
    let slab = |values: &[f64]| values[COUNT / 4..COUNT / 4 * 3].to_vec();
    let scaled = |values: &[f64]| bytes(values, 0.0, nearly_largest(values));
    let inside = |maker: &Maker, values: &[f64]| maker.masked(values.to_vec(), true, is_inside);
    let brain = |maker: &Maker, values: &[f64]| maker.masked(values.to_vec(), true, Tissue::is_brain);
    let (t1_inside, agent_inside) = (inside(maker, &t1_head), inside(maker, &agent));
    let (flow_inside, mean_inside) = (inside(maker, &flow), inside(maker, &mean_epi));
    let anisotropy = maker.head.shows(|tissue| match tissue {
        White => 0.45,
        Gray => 0.15,
        _ => 0.08,
    });
    let anisotropy =
        mapped(&brain(maker, &anisotropy), |v| if v > 0.0 { v * maker.random.between(0.6, 1.6) } else { v });
    let probability = brain(maker, &maker.head.shows(|tissue| f64::from(u8::from(tissue == Gray))));
    vec![
        ("T1 head", "mri", scan(1.0, &signed(&t1_head))),
        ("T1 head, bare", "mri", bare(1.0, &words(&t1_head))),
        ("T1 head, 8 bits", "mri", scan(1.0, &scaled(&t1_head))),
        ("T1 head, 0 to 1", "mri", scan(1.0, &reals(&mapped(&t1_head, |v| v / 4000.0)))),
        ("T1 head, without noise outside", "mri", scan(1.0, &signed(&t1_inside))),
        ("T1 head, without noise outside, 8 bits", "mri", scan(1.0, &scaled(&t1_inside))),
        ("T1 head with contrast agent", "mri", scan(1.0, &signed(&agent))),
        ("T1 head with contrast agent, without noise outside", "mri", scan(1.0, &signed(&agent_inside))),
        ("T1 brain", "mr-brain", scan(1.0, &signed(&brain(maker, &t1_head)))),
        ("T1 brain, 8 bits", "mr-brain", scan(1.0, &scaled(&brain(maker, &t1_head)))),
        ("T1 brain, real numbers", "mr-brain", scan(1.0, &reals(&brain(maker, &t1_head)))),
        ("T2 head", "mri", scan(0.9, &signed(&t2_head))),
        ("T2 head, 8 bits", "mri", scan(0.9, &scaled(&t2_head))),
        ("T2 head, without noise outside", "mri", scan(0.9, &signed(&inside(maker, &t2_head)))),
        ("T2 brain", "mr-brain", scan(0.9, &signed(&brain(maker, &t2_head)))),
        ("PD head", "mri", scan(0.9, &signed(&density))),
        ("PD head, without noise outside", "mri", scan(0.9, &signed(&inside(maker, &density)))),
        ("FLAIR head", "mri", scan(1.0, &signed(&dark_csf))),
        ("FLAIR head, without noise outside", "mri", scan(1.0, &signed(&inside(maker, &dark_csf)))),
        ("FLAIR brain", "mr-brain", scan(1.0, &signed(&brain(maker, &dark_csf)))),
        ("T1 body", "mri", scan(1.3, &signed(&t1_body))),
        ("T2 body, 8 bits", "mri", scan(1.3, &scaled(&t2_body))),
        ("MR angiogram", "angiography", scan(0.6, &signed(&slab(&flow)))),
        ("MR angiogram, whole head", "angiography", scan(0.6, &signed(&flow))),
        ("MR angiogram, without noise outside", "angiography", scan(0.6, &signed(&slab(&flow_inside)))),
        ("MR angiogram, whole head, without noise outside", "angiography", scan(0.6, &words(&flow_inside))),
        ("MR angiogram, 8 bits", "angiography", scan(0.6, &scaled(&slab(&flow)))),
        ("MR angiogram, without noise outside, 8 bits", "angiography", scan(0.6, &scaled(&slab(&flow_inside)))),
        ("MR angiogram, real numbers", "angiography", scan(0.6, &reals(&slab(&flow)))),
        ("MR angiogram with contrast agent, subtracted", "angiography", scan(0.9, &signed(&difference))),
        ("EPI", "mri", scan(3.4, &signed(&epi))),
        ("EPI, 8 bits", "mri", scan(3.4, &scaled(&epi))),
        ("EPI, mean", "mri", scan(3.4, &reals(&mean_epi))),
        // Without fat the brain is left.
        ("EPI, mean, without noise outside", "mr-brain", scan(3.4, &reals(&mean_inside))),
        ("EPI, mean of a brain", "mr-brain", scan(3.4, &reals(&brain(maker, &mean_epi)))),
        ("EPI, weighted by diffusion", "mri", scan(2.0, &signed(&dwi))),
        ("fractional anisotropy", "mr-brain", scan(2.0, &reals(&anisotropy))),
        ("probability of grey matter", "mr-brain", scan(1.5, &reals(&probability))),
    ]
}

fn others(maker: &mut Maker) -> Vec<Row> {
    let random = &mut maker.random;
    let (sparse, dense) = (cells(random, 40, 0.12, 0.0), cells(random, 160, 0.14, 0.02));
    let sheet = cells(random, 90, 0.16, 0.05);
    let confocal = mapped(&cells(random, 60, 0.13, 0.0), |v| (v - 110.0).max(0.0));
    let deconvolved = mapped(&sparse, |v| ((v - 100.0) / 400.0).max(0.0));
    let noise = smooth_noise(random);
    let active = field(|p| {
        let spot = |center: [f64; 3]| (-4.0 * radius(p, center, [0.25; 3]).powi(2)).exp();
        7.0 * spot([0.3, 0.3, 0.2]) + 6.0 * spot([-0.3, 0.4, 0.2]) - 6.0 * spot([0.1, -0.4, 0.3])
    });
    let scores: Vec<f64> = noise.iter().zip(&active).map(|(n, a)| n + a).collect();
    let waves = field(|p| (5.0 * p[0]).sin() * (4.0 * p[1] + 2.0 * p[2]).cos() + p[2]);
    let plume = field(|p| (-30.0 * (p[0] * p[0] + p[1] * p[1]) / (1.2 + p[2])).exp() * (1.5 - p[2]));
    let cosmos = mapped(&noise, |v| (1.5 * v).exp());
    let pressure = mapped(&noise, |v| 101_325.0 + 40.0 * v);
    let organs = field(|p| match body(p) {
        Air => 0.0,
        Lung => 1.0,
        Organ => 2.0,
        Marrow => 3.0,
        _ => 4.0,
    });
    let parcels = field(|p| {
        let parcel = p.iter().fold(0.0, |n, c| 4.0 * n + ((c + 1.0) * 1.99).floor());
        if head(p).is_brain() { 1001.0 + (37.0 * parcel) % 101.0 } else { 0.0 }
    });
    let mask = field(|p| f64::from(u8::from(head(p).is_brain())));
    // Uptake in tumours, the heart and the bladder: 5 to 20 times the uptake of the body.
    let uptake = field(|p| {
        let hot = |center, size: f64| radius(p, center, [size; 3]) < 1.0;
        match body(p) {
            _ if hot([0.15, -0.1, 0.4], 0.13) => 6.0,
            _ if hot([0.0, 0.0, -0.85], 0.12) => 20.0,
            _ if hot([-0.4, 0.1, 0.5], 0.06) => 9.0,
            Air => 0.0,
            Lung => 0.4,
            Organ => 2.2,
            Fat => 0.3,
            _ => 0.8,
        }
    });
    let uptake = mapped(&uptake, |v| (v + 0.1 * (1.0 + v).sqrt() * random.normal()).max(0.0));
    let echoes = field(|p| {
        let depth = (p[0].powi(2) + p[1].powi(2) + (p[2] + 1.3).powi(2)).sqrt();
        if depth < 2.2 && p[0].hypot(p[1]) < 0.6 * (p[2] + 1.3) { 60.0 + 50.0 * (6.0 * p[0]).sin() } else { 0.0 }
    });
    let echoes = mapped(&echoes, |v| v * random.between(0.02, 1.8).sqrt());
    let in_brain = |values: &[f64]| maker.masked(values.to_vec(), true, Tissue::is_brain);
    vec![
        ("cells, few", "fluorescence", bare(0.3, &words(&sparse))),
        ("cells, many", "fluorescence", bare(0.3, &words(&dense))),
        ("cells, micrometres", "fluorescence", micrometres(0.4, &words(&dense))),
        ("cells with haze, micrometres", "fluorescence", micrometres(0.8, &words(&sheet))),
        ("cells, 8 bits", "fluorescence", bare(0.3, &bytes(&confocal, 0.0, nearly_largest(&confocal)))),
        ("cells, real numbers, micrometres", "fluorescence", micrometres(0.3, &reals(&deconvolved))),
        ("scores", "activation", scan(2.0, &reals(&scores))),
        ("scores in a brain", "activation", scan(2.0, &reals(&in_brain(&scores)))),
        ("t, stated", "activation", in_units(scan(2.0, &reals(&in_brain(&scores))), "t")),
        ("r, stated", "activation", in_units(scan(2.0, &reals(&mapped(&scores, |v| (v / 6.0).tanh()))), "r")),
        ("waves", "field", bare(1.0, &reals(&waves))),
        ("a plume", "field", bare(0.01, &reals(&plume))),
        ("densities of matter in the cosmos", "field", bare(1.0, &reals(&cosmos))),
        ("pressure", "field", bare(0.1, &reals(&pressure))),
        ("uptake, real numbers", "pet", scan(4.0, &reals(&uptake))),
        ("uptake, counts", "pet", scan(4.0, &words(&mapped(&uptake, |v| 900.0 * v)))),
        ("organs", "labels", scan(1.0, &bytes(&organs, 0.0, 255.0))),
        ("parcels", "labels", scan(1.0, &words(&parcels))),
        ("a mask", "labels", scan(1.0, &bytes(&mask, 0.0, 255.0))),
        ("a mask of 255, bare", "labels", bare(1.0, &bytes(&mask, 0.0, 1.0))),
        ("nothing", "grayscale", bare(1.0, &vec![7_u8; COUNT])),
        ("ultrasound", "grayscale", scan(0.5, &bytes(&echoes, 0.0, 255.0))),
    ]
}
