//! The bounds of the random scenes and hard cases: the largest difference of a picture from the f64 reference, for any
//! volume, view, transfer function and settings.
//!
//! | picture | alpha | colour | reason |
//! |---|---|---|---|
//! | X-ray, pre-shaded, `quads` | [`FOOTPRINT`] | the same + order | sections of a kernel add up to its footprint |
//! | the same, `tiles` | [`PACKED`] | the same + order | voxels and colours are packed in half floats |
//! | the same, `cpu` | the misfit for noise | the same + order | splines leave out a share of a voxel's kernel |
//! | post-shaded | 1 | 1 | a surface may fall on either side of a pixel; hence root mean squares |
//! | maximum | 1 | 1 | [`MAXIMUM`] bounds the scalar; a root mean square bounds the rest |
//!
//! *Order* is [`order`]: a slab knows its amounts of colours, not their order. Lit voxels add [`LIGHT`], termination
//! adds itself. The bound of the root mean square of post-shading (all channels, covered pixels) is [`CLASSIFIED`]
//! times the slope of the transfer function, or [`STEPPED`] if it is steep.

use std::fmt;

use voxsplat::Frame;
use voxsplat::camera::{Camera, Projection};
use voxsplat::error::Error;
use voxsplat::host::HostRenderer;
use voxsplat::image::Image;
use voxsplat::kernel::{Kernel, Normalization};
use voxsplat::layers::Layers;
use voxsplat::progress::Progress;
use voxsplat::renderer::Rendered;
use voxsplat::settings::{Model, Painter, Settings, Sheets};
use voxsplat::stats::PainterStats;
use voxsplat::transfer::{ControlPoint, TransferFunction};
use voxsplat::volume::Volume;

use crate::support::{draw_on, errors, prepare_on, renderer, rms_covered};
use crate::truth::truth;

/// The footprint table errs by 1e-5 of a kernel's peak; some ten kernels overlap, and alpha changes by at most 1/e of a
/// relative change of optical depth. The rest is rounding of f32 sums.
pub(crate) const FOOTPRINT: f64 = 1e-4;
/// Half floats round by 2^-11; alpha shows 1/e of it, colours show all of it. Polynomials of footprints err by 5e-5 of
/// the peak.
pub(crate) const PACKED: f64 = 1.5e-3;
/// Voxels are lit with normals of 2 x 16 bits and colours of 8 to 11 bits.
pub(crate) const LIGHT: f64 = 4e-3;
/// Scalars are means of slabs. The rims of the truncated Gaussian jump by 14 % of its peak, and a mean may be wrong by
/// half of the jump, 7 % of the range of values; half of that is its root mean square. The transfer function multiplies
/// it by its slope.
pub(crate) const CLASSIFIED: f64 = 4e-2;
/// A step turns an error of the scalar into pixels that are wholly wrong, along the outline of a surface.
pub(crate) const STEPPED: f64 = 0.2;
/// The same for kernels narrower than 2 voxels: the picture of a single voxel may be all outline.
pub(crate) const NARROW_STEPPED: f64 = 0.4;
/// A maximum shows one scalar in each pixel, and a transfer function may turn a small error of the scalar into any
/// colour. So the bound is on the scalar: a pixel may have any colour that the transfer function gives to the ray's
/// largest scalar, plus or minus this fraction of the range of values. Slabs hold means, which are below peaks: a slab
/// of thickness t on a Gaussian peak of width s is below it by t^2 / 24 s^2 of the peak, 8 % for t = 1 and s = 0.7.
pub(crate) const MAXIMUM: f64 = 0.1;
/// The same for kernels that reach at most a voxel: s is 0.5, and the fraction 17 %.
pub(crate) const NARROW_MAXIMUM: f64 = 0.2;
/// Root mean square of the differences that errors of the scalar do not explain, in pixels that touch the volume or a
/// step.
pub(crate) const UNEXPLAINED: f64 = 3e-2;

/// The largest width of a pixel over its distance of pictures with a bound by `cpu`. Where pixels are wider, samples of
/// a ray lie voxels apart, and within some 25 voxels kernels grow beyond the filters of splines, which follow them as
/// far as 10 voxels.
pub(crate) const WIDEST_PIXEL: f64 = 0.15;

/// The largest difference of a picture from the truth.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Bound {
    pub(crate) alpha: f64,
    pub(crate) color: f64,
    pub(crate) rms: f64,
}

/// The error of a slab of optical depth `depth` whose matter counts as evenly mixed, as a fraction of its alpha and of
/// the range of its colours: the distance in total variation between the light that reaches the eye from each depth in
/// it, exp(-s) / (1 - exp(-depth)), and 1 / depth. A depth of 0.7 gives 0.09; 0.01 gives 0.0012.
pub(crate) fn order(depth: f64) -> f64 {
    if depth < 1e-6 {
        return depth / 8.0;
    }
    let alpha = -(-depth).exp_m1();
    // Where the two densities cross.
    let crossing = (depth / alpha).ln();
    -(-crossing).exp_m1() / alpha - crossing / depth
}

/// The largest sum of kernels anywhere, over their divisor: the largest value of a lattice of ones.
fn overshoot(kernel: Kernel, normalization: Normalization) -> f64 {
    // Measured on a lattice of 1/20 voxel. (sum over the kernel's integral, the integral)
    let (unit, integral) = match kernel {
        Kernel::Gaussian { sigma: 1.0, radius: 2.0 } => (1.08, 11.64),
        Kernel::Gaussian { sigma: 0.25, radius: 0.5 } => (5.6, 0.19),
        Kernel::Gaussian { sigma: 0.5, radius: 1.0 } => (1.25, 1.46),
        Kernel::Gaussian { sigma: 0.7, radius: 1.5 } => (1.12, 4.3),
        Kernel::Gaussian { sigma: 1.0, radius: 0.5 } => (3.7, 0.49),
        Kernel::Gaussian { sigma: 1.2, radius: 3.0 } => (1.04, 24.5),
        Kernel::Gaussian { sigma: 2.0, radius: 6.0 } => (1.01, 122.4),
        Kernel::KaiserBessel { radius: 1.5, alpha: 6.0 } => (1.03, 1.77),
        Kernel::KaiserBessel { radius: 2.0, alpha: 10.4 } => (1.01, 2.49),
        Kernel::KaiserBessel { radius: 3.0, alpha: 8.0 } => (1.01, 11.0),
        _ => panic!("the sum of kernels {kernel:?} is not in the table"),
    };
    if normalization == Normalization::Peak { unit * integral } else { unit }
}

/// The largest change of a channel of the transfer function, with the opacity of a voxel's depth, from value to value,
/// over the change of the value as a fraction of `range`. Infinite if there is a step.
fn slope(transfer: &TransferFunction, range: f64, voxel: f64) -> f64 {
    let unit = transfer.unit_distance().unwrap_or(voxel);
    let channels = |value: f64, point: Option<(&[f64; 3], f64)>| {
        let ([r, g, b], opacity) = point.map_or_else(|| transfer.sample(value), |(color, opacity)| (*color, opacity));
        let alpha = -(-TransferFunction::extinction(opacity, unit) * voxel).exp_m1();
        // Opacity bounds the visible share of colours.
        [r, g, b, 1.0].map(|c| c * alpha)
    };
    const PIECES: u32 = 64;
    let mut slope = 0.0_f64;
    for w in transfer.points().windows(2) {
        let [a, b] = [0, 1].map(|i| (w[i].value, channels(w[i].value, Some((&w[i].color, w[i].opacity)))));
        let inside =
            (1..PIECES).map(|k| a.0 + (b.0 - a.0) * f64::from(k) / f64::from(PIECES)).map(|v| (v, channels(v, None)));
        let mut before = a;
        for after in inside.filter(|_| b.0 > a.0).chain([b]) {
            let change = before.1.iter().zip(after.1).map(|(p, q)| (p - q).abs()).fold(0.0, f64::max);
            if change > 0.0 {
                slope = slope.max(change * range / (after.0 - before.0));
            }
            before = after;
        }
    }
    slope
}

/// The share of its extinction that a kernel gains or loses because `cpu` grows it by the depth of the place that is
/// reached, not by its own: a quarter of the change of the growth over the kernel's radius.
fn deepening(volume: &Volume, camera: &Camera, settings: &Settings, growth: f64) -> f64 {
    let Some(eye) = camera.eye().filter(|_| growth > 1.0) else { return 0.0 };
    let spacing = volume.grid().spacing().into_iter().fold(0.0, f64::max);
    0.25 * settings.kernel.radius() * growth * spacing / (volume.grid().center() - eye).length()
}

/// Least and largest finite value of a volume.
fn data_range(volume: &Volume) -> [f64; 2] {
    let memory = volume.in_memory().unwrap();
    let values = (0..volume.grid().len() as usize).map(|i| memory.value(i));
    values.fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], v| [low.min(v), high.max(v)])
}

/// The range of a volume's values. One value alone is reconstructed to ripples around the base.
fn range_of(volume: &Volume, transfer: &TransferFunction) -> f64 {
    let [low, high] = data_range(volume);
    if high > low { high - low } else { (high - transfer.base()).abs().max(f64::MIN_POSITIVE) }
}

/// The bound of a picture's difference from the truth.
pub(crate) fn bound(
    volume: &Volume,
    transfer: &TransferFunction,
    camera: &Camera,
    settings: &Settings,
    rendered: &Rendered,
) -> Bound {
    let is_cpu = settings.painter == Painter::Cpu;
    if let Projection::Perspective { tan_half_fov, .. } = camera.projection
        && is_cpu
        && 2.0 * tan_half_fov / f64::from(camera.size[1]) > WIDEST_PIXEL
    {
        return Bound { alpha: 1.0, color: 1.0, rms: NARROW_STEPPED };
    }
    // Splines do not follow kernels much narrower than voxels.
    let misfit = if let PainterStats::Cpu(cpu) = &rendered.stats.painter { cpu.misfit[0] } else { 0.0 };
    if matches!(settings.model, Model::Mip | Model::Minip) {
        // Gaussians are truncated, and their sums have narrow dips between the rims: minima lie there.
        let rms = if settings.model == Model::Minip { 2.0 * UNEXPLAINED } else { UNEXPLAINED };
        return Bound { alpha: 1.0, color: 1.0, rms: rms + misfit };
    }
    if settings.is_post_shaded() {
        let slope = slope(transfer, range_of(volume, transfer), volume.grid().min_spacing());
        let stepped = if settings.kernel.radius() < 2.0 { NARROW_STEPPED } else { STEPPED };
        let rms = ((CLASSIFIED + misfit) * slope.max(1.0)).min(stepped);
        return Bound { alpha: 1.0, color: 1.0, rms: rms + settings.termination };
    }
    let unit = transfer.unit_distance().unwrap_or_else(|| volume.grid().min_spacing());
    let opacity = transfer.points().iter().map(|p| p.opacity).fold(0.0, f64::max);
    let extinction = TransferFunction::extinction(opacity, unit) * overshoot(settings.kernel, settings.normalization);
    let spacing = volume.grid().spacing().into_iter().fold(0.0, f64::max);
    let (alpha, slab, mixed) = match &rendered.stats.painter {
        PainterStats::Quads(q) => (FOOTPRINT, q.sheet_thickness, 1.0),
        // A slab passes the deficit of a fit on to the next slab: two slabs mix.
        PainterStats::Tiles(t) => (PACKED, t.slab_thickness, 2.0),
        // A share of the optical depth of a voxel: at the rim of dense matter, of any alpha.
        PainterStats::Cpu(cpu) => {
            let share = cpu.misfit[1] + deepening(volume, camera, settings, rendered.stats.kernel_growth);
            ((share * (extinction * spacing).max(1.0)).min(1.0), spacing, 1.0)
        }
        other => panic!("{other:?}: no bound"),
    };
    let rms = |bound: f64| if is_cpu { bound.min(NARROW_STEPPED) } else { bound };
    if settings.model == Model::Xray {
        let alpha = alpha + settings.termination;
        return Bound { alpha, color: alpha, rms: rms(alpha) };
    }
    let slant = match camera.projection {
        Projection::Orthographic { .. } => 1.0,
        Projection::Perspective { tan_half_fov, .. } => {
            let aspect = f64::from(camera.size[0]) / f64::from(camera.size[1]);
            (1.0 + tan_half_fov.powi(2) * (1.0 + aspect * aspect)).sqrt()
        }
    };
    let range = |c: usize| {
        let seen = transfer.points().iter().map(|p| p.color[c]);
        seen.clone().fold(0.0, f64::max) - seen.fold(1.0, f64::min)
    };
    let (range, light) = match settings.lighting {
        Some(_) => (1.0, LIGHT),
        None => (range(0).max(range(1)).max(range(2)), 0.0),
    };
    // Whole footprints of voxel planes are ordered by their planes: no bound but the range of colours.
    let whole = matches!(settings.painter, Painter::Quads(q) if q.sheets == Sheets::Axis);
    let order = if whole { 1.0 } else { order(mixed * slant * slab * extinction) };
    let alpha = alpha + settings.termination;
    let color = alpha + light + range * order;
    Bound { alpha, color, rms: rms(color) }
}

/// The largest scalar of each ray, by the reference; `None`: it is the base or less.
fn largest_scalars(
    volume: &Volume,
    transfer: &TransferFunction,
    camera: &Camera,
    settings: &Settings,
) -> Vec<Option<f64>> {
    // A ramp with the base of the transfer function.
    let base = transfer.base();
    let farthest = data_range(volume).map(|v| (v - base).abs()).into_iter().fold(f64::MIN_POSITIVE, f64::max);
    let most = 1.1 * farthest * overshoot(settings.kernel, settings.normalization);
    let least = if transfer.sample(base).1 > 0.0 { 0.125 } else { 0.0 };
    let point = |value, opacity| ControlPoint { value, color: [1.0; 3], opacity };
    let ramp = TransferFunction::new(vec![point(base, least), point(base + most, 1.0)], None).unwrap();
    assert_eq!(ramp.base(), base);
    let shares = truth(volume, &ramp, camera, settings);
    let share = |p: &[f32; 4]| (f64::from(p[3]) - least) / (1.0 - least);
    shares.pixels().iter().map(share).map(|share| (share > 0.0).then_some(base + share * most)).collect()
}

/// The least and the largest of each channel that a maximum shows if its scalar is between two values.
fn shown_between(transfer: &TransferFunction, [low, high]: [f64; 2]) -> [[f64; 2]; 4] {
    const PIECES: u32 = 32;
    let most = transfer.points().iter().map(|p| p.opacity).fold(f64::MIN_POSITIVE, f64::max);
    let inside = transfer.points().iter().filter(|p| (low..=high).contains(&p.value)).map(|p| (p.color, p.opacity));
    let between = (0..=PIECES).map(|k| transfer.sample(low + (high - low) * f64::from(k) / f64::from(PIECES)));
    inside.chain(between).fold([[f64::INFINITY, f64::NEG_INFINITY]; 4], |ends, ([r, g, b], opacity)| {
        let alpha = opacity / most;
        let channels = [r * alpha, g * alpha, b * alpha, alpha];
        std::array::from_fn(|c| [ends[c][0].min(channels[c]), ends[c][1].max(channels[c])])
    })
}

/// A picture of maxima without the differences that an error of the scalars of up to `error` explains: only the rest
/// differs from the truth.
fn unexplained(
    drawn: &Image,
    truth: &Image,
    scalars: &[Option<f64>],
    transfer: &TransferFunction,
    error: f64,
) -> Image {
    let points = transfer.points();
    let lowest = points[0].value - error;
    let pixels = drawn.pixels().iter().zip(truth.pixels()).zip(scalars).map(|((p, q), scalar)| {
        let base = transfer.base();
        let ends = shown_between(transfer, scalar.map_or([lowest.min(base), base + error], |v| [v - error, v + error]));
        std::array::from_fn(|c| {
            let [low, high] = ends[c];
            let p = f64::from(p[c]);
            (f64::from(q[c]) + (p - high).max(0.0) - (low - p).max(0.0)) as f32
        })
    });
    Image::new(drawn.width(), drawn.height(), pixels.collect()).unwrap()
}

/// The difference of a picture from the truth, and its bound.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Measured {
    pub(crate) painter: &'static str,
    pub(crate) alpha: f64,
    pub(crate) color: f64,
    pub(crate) rms: f64,
    /// The pixel of the largest error of alpha or colour: its number, its value and the true value.
    pub(crate) pixel: (usize, [f32; 4], [f32; 4]),
    pub(crate) bound: Bound,
    /// Seconds that the picture took, its scene and its pipelines included.
    pub(crate) seconds: f64,
}

impl Measured {
    /// The largest error as a fraction of its bound.
    pub(crate) fn worst(&self) -> f64 {
        let Bound { alpha, color, rms } = self.bound;
        (self.alpha / alpha).max(self.color / color).max(self.rms / rms)
    }
}

impl fmt::Display for Measured {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { painter, alpha, color, rms, bound, seconds, .. } = self;
        write!(
            f,
            "{painter:<5} alpha {alpha:.1e} of {:.1e}, colour {color:.1e} of {:.1e}, rms {rms:.1e} of {:.1e}, \
             {seconds:.2} s",
            bound.alpha, bound.color, bound.rms
        )
    }
}

/// The outcome of a scene with one painter.
pub(crate) enum Outcome {
    Drawn(Measured, Image),
    /// The painter refuses the picture, with a reason.
    Refused(String),
}

/// Renders a scene and measures it. `Err` names a fault that no scene may have.
pub(crate) fn measured(
    volume: &Volume,
    transfer: &TransferFunction,
    camera: &Camera,
    settings: &Settings,
) -> Result<Outcome, String> {
    let start = std::time::Instant::now();
    let rendered = match settings.painter {
        Painter::Cpu => {
            let host = HostRenderer::new(&Progress::default());
            host.prepare_layers(&Layers::of_volume(volume, transfer), settings)
                .and_then(|scene| host.render(&scene, &Frame::new(camera, settings)))
        }
        _ => prepare_on(&renderer(), volume, transfer, settings)
            .and_then(|scene| draw_on(&renderer(), &scene, camera, settings)),
    };
    let seconds = start.elapsed().as_secs_f64();
    let rendered = match rendered {
        Err(e @ (Error::Setting { .. } | Error::Unsupported { .. } | Error::Transfer(_) | Error::Input(_))) => {
            return Ok(Outcome::Refused(e.to_string()));
        }
        Err(e) => return Err(format!("{e:#}")),
        Ok(rendered) => rendered,
    };
    let bound = bound(volume, transfer, camera, settings, &rendered);
    let (painter, image) = (rendered.stats.painter.name(), rendered.image);
    if let Some(pixel) = image.pixels().iter().find(|p| !p.iter().all(|v| v.is_finite())) {
        return Err(format!("{painter}: a pixel is {pixel:?}"));
    }
    // Colours are premultiplied and at most 1.
    let wrong = |p: &&[f32; 4]| p[..3].iter().any(|&c| c > p[3] + 1e-5 || c < -1e-5);
    if let Some(pixel) = image.pixels().iter().find(wrong) {
        return Err(format!("{painter}: a colour is over its alpha or under 0: {pixel:?}"));
    }
    let expected = truth(volume, transfer, camera, settings);
    let compared = if settings.model == Model::Mip {
        let scalars = largest_scalars(volume, transfer, camera, settings);
        let error = if settings.kernel.radius() > 1.0 { MAXIMUM } else { NARROW_MAXIMUM };
        unexplained(&image, &expected, &scalars, transfer, error * range_of(volume, transfer))
    } else {
        image.clone()
    };
    let (color, alpha) = errors(&compared, &expected);
    let rms = rms_covered(&compared, &expected);
    let pairs = compared.pixels().iter().zip(expected.pixels()).enumerate();
    let error = |p: &[f32; 4], q: &[f32; 4], channel: usize| f64::from((p[channel] - q[channel]).abs());
    let by = |p: &[f32; 4], q: &[f32; 4]| {
        (0..3).map(|c| error(p, q, c) / bound.color).fold(error(p, q, 3) / bound.alpha, f64::max)
    };
    let worst = pairs.max_by(|a, b| by(a.1.0, a.1.1).total_cmp(&by(b.1.0, b.1.1)));
    let pixel = worst.map_or((0, [0.0; 4], [0.0; 4]), |(index, (p, q))| (index, *p, *q));
    Ok(Outcome::Drawn(Measured { painter, alpha, color, rms, pixel, bound, seconds }, image))
}

#[test]
fn order_is_an_eighth_of_a_small_depth_and_at_most_all() {
    for depth in [1e-5, 1e-3, 0.1] {
        assert!((order(depth) / (depth / 8.0) - 1.0).abs() < 0.05, "{depth}: {}", order(depth));
    }
    assert!(order(1e3) < 1.0 && order(1e3) > 0.98);
}
