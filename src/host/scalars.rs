//! Scenes of scalars: fields that are classified along rays.

use std::ops::Range;
use std::sync::Arc;

use glam::{DMat3, DVec3};

use super::arriving::{ArrivingLight, Casters, Falling};
use super::field::{Field, padding};
use super::kept::Kept;
use super::level::Level;
use super::light::Shader;
use super::post::{Post, Surface};
use super::shot::{Shot, places_of_light};
use super::table::Table;
use crate::camera::clip::is_inside;
use crate::error::Result;
use crate::kernel::{Kernel, Slopes, SplineFilter};
use crate::lighting::shadow::SURFACE_BIAS;
use crate::lighting::shadow::field::CLIPPED;
use crate::lighting::shadow::incoming::Incoming;
use crate::progress::Progress;
use crate::settings::Settings;
use crate::transfer::scalars::{Reduction, Relative};
use crate::transfer::{ControlPoint, Resolution, TransferFunction, isosurface, scaled_share};
use crate::volume::{ToF64, Volume, with_samples};

/// Number of voxels of a row that are lit together or not at all.
const RUN: usize = 8;

/// A volume whose samples are reconstructed before they are classified.
pub(super) struct Scalars {
    /// The samples, filtered if the picture is sharpened.
    pub(super) volume: Volume,
    pub(super) transfer: TransferFunction,
    pub(super) reduction: Reduction,
    pub(super) resolution: Resolution,
    pub(super) table: Table,
    pub(super) sharpened: Option<(Kernel, f64)>,
    /// Whether most of the visible matter is uniform, as of a mask.
    pub(super) is_uniform: bool,
    /// The fields of kernels of a level. The last numbers of a key are the number of points around the lattice and the
    /// ratio of sums of kernels to their means.
    pub(super) field: Kept<(Kernel, Level, usize, f64), Reconstructed>,
    /// The light that arrives under the last light with shadows.
    pub(super) light: Kept<Falling, ArrivingLight>,
}

/// The field of a kernel.
pub(super) struct Reconstructed {
    pub(super) field: Field,
    pub(super) filter: SplineFilter,
}

impl Scalars {
    /// Reads a volume.
    ///
    /// # Errors
    /// [`Error::Input`](crate::Error::Input) if samples cannot be read or are not finite;
    /// [`Error::Memory`](crate::Error::Memory).
    pub(super) fn new(
        volume: &Volume,
        transfer: &TransferFunction,
        settings: &Settings,
        progress: &Progress,
    ) -> Result<Self> {
        volume.check_finite()?;
        let is_uniform = settings.lighting.is_some() && is_uniform(volume, transfer)?;
        let filtered = settings.prefilter()?;
        let filtered = filtered.map(|filter| filter.apply::<f32>(volume, transfer.base(), progress)).transpose()?;
        let volume = filtered.unwrap_or_else(|| volume.clone());
        let reduction = Reduction::new(transfer, volume.farthest_from(transfer.base())?);
        Ok(Self {
            table: Table::new(transfer, &reduction),
            resolution: Resolution::new(transfer, &volume)?,
            transfer: transfer.clone(),
            reduction,
            sharpened: settings.sharpens(),
            is_uniform,
            volume,
            field: Kept::default(),
            light: Kept::default(),
        })
    }

    /// Returns the fields of the kernels of a picture.
    ///
    /// # Errors
    /// [`Error::Setting`](crate::Error::Setting) if the scene was prepared for another sharpness.
    pub(super) fn reconstructed(&self, shot: &Shot<'_>, progress: &Progress) -> Result<Vec<Arc<Reconstructed>>> {
        if shot.settings.sharpens() != self.sharpened {
            return Err(Settings::not_prepared("sharpness", "for another sharpness or kernel"));
        }
        let (kernels, level) = (shot.kernels(), shot.level);
        let pad = padding(&kernels);
        let keys: Vec<_> = kernels.into_iter().map(|kernel| (kernel, level, pad, shot.density)).collect();
        self.field.get_or_make(&keys, |keys, spare| {
            let filter = |(kernel, .., density): &(Kernel, Level, usize, f64)| {
                SplineFilter::new(kernel).map(|filter| filter.times(*density))
            };
            let filters = keys.iter().map(filter).collect::<Result<Vec<_>>>()?;
            let spare = spare.into_iter().map(|made| made.field).collect();
            let dims = self.dims();
            let fields = if level == Level(0) {
                Field::new((dims, shot.first(), pad), &filters, &|planes| self.planes(planes), spare, progress)?
            } else {
                let plane = |plane: usize| Ok(self.planes(plane..plane + 1)?.into_iter().map(|v| [v]).collect());
                let (dims, cells) = level.cells(dims, &plane, true)?;
                let planes = |planes: Range<usize>| {
                    let area = dims[0] * dims[1];
                    Ok(cells[planes.start * area..planes.end * area].as_flattened().to_vec())
                };
                Field::new((dims, shot.first(), pad), &filters, &planes, spare, progress)?
            };
            Ok(fields.into_iter().zip(filters).map(|(field, filter)| Reconstructed { field, filter }).collect())
        })
    }

    /// Returns the classification along the rays of a picture.
    pub(super) fn post<'a>(
        &'a self,
        shot: &Shot<'_>,
        reconstructed: &'a [Arc<Reconstructed>],
        arriving: Option<&'a ArrivingLight>,
    ) -> Post<'a> {
        let Shot { grid, settings, .. } = *shot;
        // Of a jump, splines leave a slope in uniform matter beside it: no surface.
        let of_misfit = if self.is_uniform { 2.0 * reconstructed[0].filter.misfit().data } else { 0.0 };
        let of_distance = of_misfit.max(Resolution::OF_DISTANCE) as f32;
        let resolution = [of_distance, self.reduction.faintest(&self.resolution)];
        let shader = settings.lighting.as_ref();
        Post {
            blend: shot.blend(reconstructed, |reconstructed| &reconstructed.field),
            table: &self.table,
            shader: shader.map(|lighting| Shader::new(lighting, grid.center(), grid.unit(), resolution)),
            surfaces: Surface::of(&self.transfer, &self.reduction),
            arriving,
            gradient_opacity: self.transfer.scaled_gradient_opacity(self.reduction.factor()),
            to_places: places_of_light(grid, &shot.lattice),
            to_voxels: shot.to_voxels(),
        }
    }

    fn dims(&self) -> [usize; 3] {
        self.volume.grid().dims().map(|d| d as usize)
    }

    /// Returns the scalars of planes.
    fn planes(&self, planes: Range<usize>) -> Result<Vec<f32>> {
        let [nx, ny, _] = self.dims();
        self.scalars(planes.start * nx * ny..planes.end * nx * ny)
    }

    /// Returns the scalars of samples, x fastest.
    fn scalars(&self, samples: Range<usize>) -> Result<Vec<f32>> {
        let relative = Relative::new(&self.volume, self.reduction);
        let samples = self.volume.read(samples)?;
        Ok(with_samples!(&samples, s => s.iter().map(|v| relative.to(v.to_f64())).collect()))
    }

    /// Returns the matter that casts shadows, with extinctions in a unit of length; with a field, voxels far from its
    /// visible matter are left out.
    pub(super) fn occluders<'a>(&'a self, field: Option<&'a Field>, unit: f64) -> Extinctions<'a> {
        let gradient_opacity = self.transfer.scaled_gradient_opacity(self.reduction.factor());
        let to_world = self.volume.grid().to_lattice().matrix3.transpose();
        let surfaces = CastingSurfaces { surfaces: self.transfer.isosurfaces(), reduction: &self.reduction, unit };
        Extinctions { scene: self, field, gradient_opacity, to_world, surfaces }
    }

    /// Returns the matter that casts shadows; with a field, voxels far from its visible matter are left out.
    pub(super) fn casters<'a>(&'a self, field: Option<&'a Field>, falling: &'a Falling) -> Casters<'a> {
        let matter = self.occluders(field, self.transfer.unit_or(self.volume.grid().min_spacing()));
        let row = move |place: [usize; 2], row: &mut [f32]| matter.row(falling, place, row);
        Casters { bounds: [[0; 3], self.dims()], row: Box::new(row) }
    }

    /// Returns the light that arrives at the voxels; with a field, voxels far from its visible matter are left out.
    pub(super) fn arriving(
        &self,
        field: Option<&Field>,
        falling: Falling,
        incoming: Option<&Incoming>,
        progress: &Progress,
    ) -> Result<Arc<ArrivingLight>> {
        let mut made = self.light.get_or_make(&[falling], |falling, mut before| {
            let casters = self.casters(field, &falling[0]);
            Ok(vec![ArrivingLight::new(&casters, &falling[0], incoming, before.pop(), progress)?])
        })?;
        Ok(made.swap_remove(0))
    }
}

/// The extinctions of a scene's matter, for shadows.
pub(super) struct Extinctions<'a> {
    scene: &'a Scalars,
    field: Option<&'a Field>,
    /// The points of gradient opacity; see [`super::post::Post::gradient_opacity`].
    gradient_opacity: Vec<[f32; 2]>,
    /// The map from gradients along the lattice axes to gradients in the world.
    to_world: DMat3,
    surfaces: CastingSurfaces<'a>,
}

/// The isosurfaces of matter that casts shadows.
struct CastingSurfaces<'a> {
    surfaces: Vec<ControlPoint>,
    reduction: &'a Reduction,
    /// The length of the unit of extinctions, in world units.
    unit: f64,
}

impl CastingSurfaces<'_> {
    /// Returns the extinction of a voxel by its scalar and the length of its gradient per voxel and in the world.
    fn casting(&self, scalar: f32, gradient: [f64; 2]) -> f32 {
        let steepness = gradient.map(|length| length / self.reduction.factor());
        (isosurface::casting(&self.surfaces, self.reduction.value(scalar), steepness) * self.unit) as f32
    }
}

impl Extinctions<'_> {
    /// Returns the scalars of a row; rows beyond the lattice are the nearest.
    fn scalars(&self, y: isize, z: isize) -> Result<Vec<f32>> {
        let [nx, ny, nz] = self.scene.dims();
        let row = y.clamp(0, ny as isize - 1) as usize + ny * z.clamp(0, nz as isize - 1) as usize;
        self.scene.scalars(row * nx..(row + 1) * nx)
    }

    /// Writes the extinctions of a row, given its y and z: 0 where no visible matter is near.
    pub(super) fn row(&self, falling: &Falling, at: [usize; 2], row: &mut [f32]) -> Result<()> {
        let [nx, ..] = self.scene.dims();
        let [y, z] = at.map(|place| place as isize);
        let has_surfaces = !self.surfaces.surfaces.is_empty();
        // The light on an isosurface is that before it, between voxels.
        let reach = if has_surfaces { SURFACE_BIAS as isize + 2 } else { 3 };
        let is_lit = |run: &Range<usize>| {
            let low = [run.start as isize, y, z].map(|point| point - reach);
            let high = [run.end as isize - 1, y, z].map(|point| point + reach);
            let [low, high] =
                [low, high].map(|end| [0, 1, 2].map(|axis| end[axis] + falling.lattice.first[axis] as isize));
            self.field.is_none_or(|field| field.any(low, high, |range| !self.scene.table.is_invisible(range)))
        };
        // Runs begin at the same voxels in a part of a lattice as in the whole.
        let before = falling.lattice.first[0] as usize % RUN;
        let ends =
            (0..nx + before).step_by(RUN).map(|start| [start, start + RUN].map(|end| end.saturating_sub(before)));
        let runs: Vec<_> = ends.map(|[start, end]| start..end.min(nx)).filter(is_lit).collect();
        if runs.is_empty() {
            return Ok(());
        }
        let own = self.scalars(y, z)?;
        let thins = !self.gradient_opacity.is_empty();
        let beside = (0..9).filter(|_| thins || has_surfaces).map(|n| [y + n % 3 - 1, z + n / 3 - 1]);
        let rows = beside.map(|[y, z]| self.scalars(y, z)).collect::<Result<Vec<_>>>()?;
        let slopes = Slopes::of_cells(1.0);
        for x in runs.into_iter().flatten() {
            let mut extinction = self.scene.table.extinction(own[x]);
            if has_surfaces || thins && extinction > 0.0 {
                let mut around = [0.0; 27];
                for (place, row) in around.chunks_exact_mut(3).zip(&rows) {
                    place.copy_from_slice(&[row[x.saturating_sub(1)], row[x], row[(x + 1).min(nx - 1)]]);
                }
                let gradient = DVec3::from_array(slopes.gradient(&around, 13, 3).map(f64::from));
                let [per_voxel, per_unit] = [gradient.length(), (self.to_world * gradient).length()];
                if thins {
                    extinction *= scaled_share(&self.gradient_opacity, per_unit as f32);
                }
                extinction += self.surfaces.casting(own[x], [per_voxel, per_unit]);
            }
            let casts = falling.clip.is_empty() || is_inside(&falling.clip, falling.place([x, at[0], at[1]]));
            row[x] = if casts { extinction.max(CLIPPED) } else { CLIPPED };
        }
        Ok(())
    }
}

/// Returns whether most visible samples equal the next along x. Inspects at most a million samples, in rows spread over
/// the volume. In scans a few in a hundred do, in scans of 8 bits one in five.
pub(crate) fn is_uniform(volume: &Volume, transfer: &TransferFunction) -> Result<bool> {
    const SAMPLES: usize = 1 << 20;
    let [nx, ny, nz] = volume.grid().dims().map(|d| d as usize);
    let (slope, intercept) = volume.rescale();
    let step = (nx * ny * nz).div_ceil(SAMPLES);
    // A step along y and z that have a factor in common would miss most of the slices.
    let rows = (0..ny * nz).filter(|row| (row % ny + row / ny).is_multiple_of(step));
    let (mut visible, mut equal) = (0_u64, 0_u64);
    for row in rows {
        let samples = volume.read(row * nx..(row + 1) * nx)?;
        for x in 1..nx {
            let [before, own] = [samples.raw(x - 1), samples.raw(x)];
            if transfer.sample(slope * own + intercept).1 > 0.0 {
                visible += 1;
                equal += u64::from(before == own);
            }
        }
    }
    Ok(2 * equal > visible)
}
