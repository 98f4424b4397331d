//! What a picture in bricks needs: an engine and a painter, a level whose cells no cut divides, and voxels around each
//! brick.

use super::grid::Chunks;
use crate::camera::Camera;
use crate::engine::Engine;
use crate::error::{Error, Result};
use crate::gpu::savings::Savings;
use crate::gpu::view::ViewGeometry;
use crate::host::{Needs, check_drawn, needs};
use crate::layers::Layers;
use crate::lighting::shadow::{occlusion_reach, passing};
use crate::painters::choice::PainterKind;
use crate::prepare::cells::{self, CellSize};
use crate::settings::{Level, Painter, QuadsSettings, Settings, Sheets};
use crate::volume::Grid;

/// Cells at the ends of a slice whose voxels partly lie beyond it.
const INCOMPLETE: u32 = 4;

/// Voxels to either side that the smoothed normals of labels and masks depend on.
const SMOOTHED_REACH: u32 = 4;

/// Voxels to either side on which the extinction of a voxel may depend: gradients, masks, and visible matter nearby.
pub(super) const SHAPED: u32 = 4;

/// Returns whether the processor draws the bricks of a plan.
pub(super) fn is_by_host(settings: &Settings) -> bool {
    match settings.painter {
        Painter::Cpu => true,
        Painter::Auto => !Engine::may_have_gpu() && check_drawn(settings).is_ok(),
        Painter::Tiles | Painter::Quads(_) => false,
    }
}

/// Refuses settings whose pictures cannot be made in bricks. Returns the distance in voxels of the farthest voxels on
/// which the shadows and the occlusion at a voxel depend, 0 without.
pub(super) fn check(settings: &Settings, by_host: bool) -> Result<u32> {
    if settings.quads().sheets == Sheets::Axis {
        return Err(Error::setting("sheets", "no brick owns an axis-aligned sheet: expected image"));
    }
    let Some(casting) = settings.casting() else { return Ok(0) };
    let kernel = settings.reconstruction_kernel();
    let refused = |reason| Err(Error::setting("shadows", reason));
    let mut reach = casting.occlusion().map_or(0, |radius| occlusion_reach(&kernel, radius));
    if casting.casts_shadows() {
        if !by_host {
            return refused("a device draws bricks without them: expected off, or --painter cpu");
        }
        if casting.is_exact() {
            return refused("bricks have no exact ones: expected on, off or a strength");
        }
        if casting.has_places() {
            return refused("a light at a place casts none in bricks: expected off, or lights from directions");
        }
        match passing::reach(&kernel, casting.bias()) {
            Some(of_shadows) => reach = reach.max(of_shadows + SHAPED),
            None => {
                return refused(
                    "the kernel is too narrow to sweep light through bricks: expected off, or a wider kernel",
                );
            }
        }
    }
    if !by_host {
        return Err(Error::setting("occlusion", "a device draws bricks without it: expected off, or --painter cpu"));
    }
    Ok(reach)
}

/// Returns the level and the needs of bricks that the processor draws.
pub(super) fn host_needs(
    layers: &Layers,
    grid: &Grid,
    chunks: &Chunks,
    camera: &Camera,
    settings: &Settings,
) -> Result<(Level, Needs)> {
    let most = chunks.level();
    let found = needs(camera, grid, settings);
    match settings.level {
        level if found.level <= most => Ok((level, found)),
        Level::At(level) => Err(beyond_chunks(level, most)),
        Level::Auto => {
            // A finer level, whose kernels grow: as far as filters follow them.
            let finer = needs(camera, grid, &Settings { level: Level::At(most), ..settings.clone() });
            // Of labels, masks and several layers no level can be requested.
            if finer.level <= most && layers.plain().is_some() {
                return Ok((Level::At(most), finer));
            }
            let reason = format!(
                "so small a picture has cells of level {}, and these bricks begin between cells of level {most} at \
                 most: use fewer bricks, or sizes that a power of two divides",
                found.level
            );
            Err(Error::setting("grid", reason))
        }
    }
}

/// The error of a level whose cells chunks divide.
fn beyond_chunks(level: u32, most: u32) -> Error {
    Error::setting(
        "level",
        format!("{level}: bricks begin between cells of level {most} at most: expected up to {most}"),
    )
}

/// Returns the settings of bricks that a device draws, with their painter, their level, the reach of slabs and sheets
/// beyond cuts, and the largest distance in voxels of the samples that they need.
pub(super) fn of_device(
    layers: &Layers,
    grid: &Grid,
    chunks: &Chunks,
    camera: &Camera,
    settings: &Settings,
) -> Result<(Settings, u32, f64, u32)> {
    let level = level(layers, grid, chunks, camera, settings)?;
    let settings = Settings { level: Level::At(level), ..settings.clone() };
    let (view, drawn) = drawn(grid, camera, &settings, level)?;
    let painter = painter(&view, &drawn)?;
    // In cells; those at the ends of a slice lack voxels beyond.
    let [beyond, reach] = (kind(painter).room().reach)(&view, &Settings { painter, ..drawn });
    let incomplete = if level > 0 { INCOMPLETE } else { 0 };
    let cells = beyond.max(reach).ceil() as u32 + incomplete;
    Ok((Settings { painter, ..settings }, level, beyond * libm::exp2(f64::from(level)), cells << level))
}

/// Returns the level of all bricks that a device draws. The cuts lie between cells of this level.
fn level(layers: &Layers, grid: &Grid, chunks: &Chunks, camera: &Camera, settings: &Settings) -> Result<u32> {
    let takes_cells = settings.takes_cells() && layers.plain().is_some();
    match settings.level {
        Level::At(level) if level > 0 && !takes_cells => {
            Err(Error::setting("level", format!("{level}: bricks of scalars are drawn of voxels: expected auto or 0")))
        }
        Level::At(level) if level > chunks.level() => Err(beyond_chunks(level, chunks.level())),
        Level::At(level) => Ok(level),
        Level::Auto if !takes_cells => Ok(0),
        Level::Auto => {
            let (view, drawn) = drawn(grid, camera, settings, 0)?;
            let [x, y, z] = grid.spacing();
            let denser = drawn.normalization.density(&drawn.kernel);
            let unit = layers.plain().map_or(1.0, |(_, transfer)| transfer.unit_or(grid.min_spacing()));
            let depth = layers.max_density() / unit * x.max(y).max(z) * denser;
            Ok(cells::level_of(&drawn.kernel, view.min_growth(), grid, depth).min(chunks.level()))
        }
    }
}

/// Returns the view of the lattice of a level, voxels or cells, and the settings for its pictures.
fn drawn(grid: &Grid, camera: &Camera, settings: &Settings, level: u32) -> Result<(ViewGeometry, Settings)> {
    let settings = Settings { kernel: settings.reconstruction_kernel(), level: Level::At(level), ..settings.clone() };
    let voxels = ViewGeometry::new(camera, grid, &settings, Savings::default());
    if level == 0 {
        return Ok((voxels, settings));
    }
    let size = CellSize::of_level(level);
    let growth = voxels.min_growth().max(cells::least_growth(&settings.kernel, size));
    let kernel = cells::kernel_of(&settings.kernel, growth, size);
    let grown = growth / size.voxels();
    let settings = Settings { kernel, ..settings }.with_sheets_of(grown);
    let cells = cells::grid_of(grid, size)?;
    Ok((ViewGeometry::of_cells(camera, &cells, &settings, Savings::default(), grown, None), settings))
}

/// Returns the painter of a device.
pub(super) fn kind(painter: Painter) -> PainterKind {
    if matches!(painter, Painter::Quads(_)) { PainterKind::Quads } else { PainterKind::Tiles }
}

/// Returns the painter of all bricks that a device draws.
fn painter(view: &ViewGeometry, settings: &Settings) -> Result<Painter> {
    let refusal = || (PainterKind::Tiles.room().refusal)(view, settings);
    match settings.painter {
        quads @ Painter::Quads(_) => Ok(quads),
        Painter::Auto if refusal().is_some() => Ok(Painter::Quads(QuadsSettings::default())),
        _ => match refusal() {
            Some(reason) => Err(Error::setting("painter", reason)),
            None => Ok(Painter::Tiles),
        },
    }
}

/// Returns the distance in voxels of the farthest samples on which the normal or the gradient of a voxel depends.
pub(super) fn normals_reach(layers: &Layers, settings: &Settings) -> u32 {
    match (settings.normals(), layers.plain()) {
        (Some(normals), Some(_)) => normals.reach() as u32,
        (Some(_), None) => SMOOTHED_REACH,
        (None, None) => 1,
        (None, Some((_, transfer))) => u32::from(transfer.depends_on_neighbours()),
    }
}

/// The largest degree of the polynomial that filters samples, in applications of the kernel.
const FILTER_DEGREE: u32 = 24;

/// Returns the largest distance in voxels of samples on which a filtered sample depends.
pub(super) fn filter_reach(settings: &Settings) -> u32 {
    settings.sharpens().map_or(0, |(kernel, _)| FILTER_DEGREE * kernel.radius().floor() as u32)
}
