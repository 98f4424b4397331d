//! The memory that a picture needs, predicted before any of it is allocated: a picture beyond the memory of the machine
//! is refused with its number, and not killed.

use rayon::prelude::*;
use voxsplat_volume::memory::{Available, available};

use super::cells::CellSize;
use crate::error::{Error, Result};
use crate::gpu::context::Context;
use crate::layers::{Layers, Matter, look_of};
use crate::settings::{MAX_LEVEL, Painter, Settings};

/// The number of rows from one sampled row to the next along y and z.
const STRIDE: usize = 8;
/// The number of neighbours along x that have one value inside of a label.
const SEGMENT: usize = 32;

/// Returns the bytes of each voxel of the box around the visible voxels, and of each visible voxel, on a software
/// adapter. Measured: docs/measurements/2026-11-25-bricks.md.
pub(crate) fn bytes_of_voxels(painter: Painter, post: bool, lit: bool) -> [f64; 2] {
    match (painter, post, lit) {
        (Painter::Quads(_), false, _) => [0.0, 91.0],
        (Painter::Quads(_), true, _) => [0.0, 110.0],
        (_, false, false) => [9.6, 8.0],
        (_, false, true) => [9.6, 11.6],
        (_, true, false) => [7.2, 3.1],
        (_, true, true) => [14.7, 8.2],
    }
}

/// The properties of a picture on which its memory depends.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Drawn {
    pub(super) post: bool,
    pub(super) lit: bool,
    pub(super) painter: Painter,
    /// Whether light is cast in the memory of the host.
    pub(super) shadows: bool,
    /// The size of the finest cells.
    pub(super) size: CellSize,
    /// Whether a software adapter draws, whose memory is the host's.
    pub(super) on_host: bool,
    /// Whether samples are to be filtered, to 4 bytes each.
    pub(super) filtered: bool,
}

/// The numbers of voxels of a volume by which memory is predicted.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Counts {
    all: f64,
    /// Number of voxels in the box around the visible ones.
    boxed: f64,
    visible: f64,
    /// Number of visible voxels that are not surrounded by voxels of the same label, which share their memory.
    listed: f64,
}

impl Drawn {
    /// Returns the properties of a picture with these settings, of cells of a size.
    pub(super) fn new(context: &Context, settings: &Settings, size: CellSize) -> Self {
        let on_host = context.info.is_software();
        let (post, lit) = (settings.is_post_shaded(), settings.lighting.is_some());
        Self {
            post,
            lit,
            painter: settings.painter,
            shadows: on_host && settings.casting().is_some(),
            size,
            on_host,
            filtered: false,
        }
    }

    /// Returns the bytes that a picture needs, given its numbers of voxels.
    fn bytes(&self, Counts { all, boxed, visible, listed }: Counts) -> f64 {
        let Self { post, lit, painter, shadows, size, on_host, filtered } = *self;
        let filtered = if filtered { 4.0 * all } else { 0.0 };
        let each = size.voxels().powi(-3);
        let [of_box, of_splat] = bytes_of_voxels(painter, post, lit);
        let of_box = if on_host { of_box } else { 0.0 };
        if post {
            return filtered + each * (of_box * boxed + of_splat * visible);
        }
        // A software adapter has each splat in its lists.
        let of_lists = if on_host { visible } else { listed };
        // Shadows lie on voxels, and their occluders and light are gone when the volume is packed.
        let of_light = if shadows { 12.0 * boxed } else { 0.0 };
        let of_voxels = if shadows || size == CellSize::VOXEL { of_lists } else { 0.0 };
        let lists = of_voxels * (of_splat + if shadows { 8.0 } else { 0.0 });
        let of_cell = if matches!(painter, Painter::Quads(_)) { of_splat } else { 12.0 };
        let cells = if size == CellSize::VOXEL { 0.0 } else { each * of_cell * visible };
        lists + cells + of_light.max(each * of_box * boxed)
    }
}

/// Refuses layers whose picture needs more memory than there is.
///
/// # Errors
/// [`Error::TooLarge`]; the errors of reading samples.
pub(super) fn check(layers: &Layers, drawn: &Drawn) -> Result<()> {
    // A GPU has memory of its own.
    match available().filter(|_| drawn.on_host || layers.plain().is_none()) {
        Some(available) => check_within(layers, drawn, available),
        None => Ok(()),
    }
}

fn check_within(layers: &Layers, drawn: &Drawn, available: Available) -> Result<()> {
    let all = layers.grid().len() as f64;
    let most = available.bytes as f64;
    if drawn.bytes(Counts { all, boxed: all, visible: all, listed: all }) <= most {
        return Ok(());
    }
    let counts = counts(layers)?;
    let bytes = drawn.bytes(counts);
    if bytes <= most {
        return Ok(());
    }
    // Whatever needs little enough.
    let fits = |drawn: Drawn| drawn.bytes(Counts { listed: counts.visible, ..counts }) <= most;
    let unlit = Drawn { lit: false, shadows: false, ..*drawn };
    let levels = || (0..=MAX_LEVEL).map(|level| (level, CellSize::of_level(level)));
    let mut remedies = Vec::new();
    if drawn.shadows && unlit.bytes(counts) <= most {
        remedies.push("--light off".to_owned());
    }
    if layers.all().iter().any(|layer| matches!(layer.matter, Matter::Labels { .. })) {
        let level = levels().find(|&(_, size)| fits(Drawn { size, ..unlit }));
        let option = |(level, _)| if level == 0 { String::new() } else { format!(" --level {level}") };
        remedies.extend(level.map(|level| format!("--transfer grayscale{}", option(level))));
    } else if layers.plain().is_some() {
        let level = levels().find(|&(_, size)| size > drawn.size && fits(Drawn { size, ..*drawn }));
        remedies.extend(level.map(|(level, _)| format!("--level {level}")));
    }
    remedies.push("bricks (voxsplat plan)".to_owned());
    Err(Error::TooLarge { bytes: bytes as u64, available: available.bytes, limit: available.limit, remedies })
}

/// Estimates the numbers of voxels from some rows. Several layers, and colours, count as visible everywhere.
fn counts(layers: &Layers) -> Result<Counts> {
    let all = layers.grid().len() as f64;
    let everywhere = Counts { all, boxed: all, visible: all, listed: all };
    let [layer] = layers.all() else { return Ok(everywhere) };
    let (volume, looks) = match (&layer.matter, &layer.mask) {
        (Matter::Scalars { volume, .. }, None) => (volume, None),
        (Matter::Labels { volume, looks, .. }, None) => (volume, Some(looks)),
        _ => return Ok(everywhere),
    };
    let (slope, intercept) = volume.rescale();
    let shows = |value: f64| match (&layer.matter, looks) {
        (Matter::Scalars { transfer, .. }, _) => transfer.sample(value).1 > 0.0,
        (_, Some(looks)) => look_of(looks, value).is_some_and(|look| look.opacity > 0.0),
        _ => true,
    };
    let [nx, ny, nz] = volume.grid().dims().map(|count| count as usize);
    let rows: Vec<[usize; 2]> =
        (0..nz).step_by(STRIDE).flat_map(|z| (0..ny).step_by(STRIDE).map(move |y| [y, z])).collect();
    // Of a row: visible voxels, those of segments of one value, and the ends along the three axes.
    let row = |&[y, z]: &[usize; 2]| -> Result<([usize; 2], [[usize; 2]; 3])> {
        let samples = volume.read(nx * (y + ny * z)..nx * (y + ny * z + 1))?;
        let (mut found, mut ends) = ([0; 2], EMPTY);
        for start in (0..nx).step_by(SEGMENT) {
            let end = nx.min(start + SEGMENT);
            let first = samples.raw(start);
            let is_uniform = (start..end).all(|x| samples.raw(x) == first);
            for x in (start..end).filter(|&x| shows(slope * samples.raw(x) + intercept)) {
                found[0] += 1;
                found[1] += usize::from(is_uniform);
                ends = joined(ends, [x, y, z].map(|at| [at, at + 1]));
            }
        }
        Ok((found, ends))
    };
    let sum = |a: ([usize; 2], _), b: ([usize; 2], _)| Ok(([a.0[0] + b.0[0], a.0[1] + b.0[1]], joined(a.1, b.1)));
    let sampled = rows.len();
    let ([visible, uniform], ends) = rows.par_iter().map(row).try_reduce(|| ([0; 2], EMPTY), sum)?;
    let each = (ny * nz) as f64 / sampled as f64;
    let side = |axis: usize| ends[axis][1].saturating_sub(ends[axis][0]) as f64;
    let beside = |axis: usize| if axis == 0 { 0.0 } else { (STRIDE - 1) as f64 };
    let boxed: f64 = (0..3).map(|axis| (side(axis) + beside(axis)).min([nx, ny, nz][axis] as f64)).product();
    let visible_voxels = visible as f64 * each;
    // Surfaces cross segments along all three axes alike.
    let crossed = (3.0 * (visible - uniform) as f64 / visible.max(1) as f64).min(1.0);
    let listed = if looks.is_some() { crossed * visible_voxels } else { visible_voxels };
    Ok(Counts { all, boxed: if visible > 0 { boxed } else { 0.0 }, visible: visible_voxels, listed })
}

/// The ends of an empty box.
const EMPTY: [[usize; 2]; 3] = [[usize::MAX, 0]; 3];

fn joined(a: [[usize; 2]; 3], b: [[usize; 2]; 3]) -> [[usize; 2]; 3] {
    std::array::from_fn(|axis| [a[axis][0].min(b[axis][0]), a[axis][1].max(b[axis][1])])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::layers::{Labels, Layer};
    use crate::settings::QuadsSettings;
    use crate::transfer::TransferFunction;
    use crate::volume::Volume;

    #[test]
    fn a_picture_beyond_the_memory_is_refused_with_its_number_and_what_helps() {
        // A cube of one label in a lattice of 64^3.
        let inside = |i: usize| [i % 64, i / 64 % 64, i / 4096].iter().all(|at| (8..56).contains(at));
        let samples: Vec<u8> = (0..64_usize.pow(3)).map(|i| u8::from(inside(i))).collect();
        let volume = Volume::from_slice([64; 3], [1.0; 3], &samples).unwrap();
        let labels = Layers::new(Layer::labels(&volume, &Labels::default()).unwrap());
        let grey = Layers::of_volume(&volume, &TransferFunction::preset("grayscale", &volume).unwrap());
        let drawn = Drawn {
            post: false,
            lit: true,
            painter: Painter::Auto,
            shadows: true,
            size: CellSize::VOXEL,
            on_host: true,
            filtered: false,
        };
        let within = |layers: &Layers, drawn: Drawn, bytes: u64| {
            check_within(layers, &drawn, Available { bytes, limit: "the machine" })
        };
        let found = counts(&labels).unwrap();
        let exact = 48_f64.powi(3);
        assert!((found.visible / exact - 1.0).abs() < 0.01 && (found.boxed / exact - 1.0).abs() < 0.35, "{found:?}");
        let need = drawn.bytes(found) as u64;
        within(&labels, drawn, need + 1).unwrap();
        let refused = within(&labels, drawn, need - 1).unwrap_err().to_string();
        let expected = "MB of memory, and the machine has";
        assert!(
            refused.contains(expected) && refused.contains("--light off, or with --transfer grayscale, or in bricks"),
            "{refused}"
        );
        let refused = within(&labels, drawn, need / 8).unwrap_err().to_string();
        assert!(refused.contains("--transfer grayscale --level 1") && !refused.contains("--light off"), "{refused}");
        let unlit = Drawn { lit: false, shadows: false, ..drawn };
        let refused = within(&grey, unlit, need / 8).unwrap_err().to_string();
        assert!(refused.contains("draw it with --level 1, or in bricks (voxsplat plan)"), "{refused}");
        within(&grey, Drawn { size: CellSize::of_level(1), ..unlit }, need / 8).unwrap();
        // Each quad takes 91 bytes.
        let by_quads = Drawn { painter: Painter::Quads(QuadsSettings::default()), ..unlit };
        within(&grey, by_quads, 92 * exact as u64).unwrap();
        within(&grey, by_quads, 90 * exact as u64).unwrap_err();
    }
}
