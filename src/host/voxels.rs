//! Scenes of classified voxels: fields of colours that are composited along rays.

use std::ops::Range;
use std::sync::Arc;

use glam::{DAffine3, DVec3};
use pulp::{Simd, WithSimd};

use super::arriving::{ArrivingLight, Falling};
use super::colors::{ColorField, VoxelPlanes};
use super::field::{Field, padding};
use super::kept::Kept;
use super::lanes::{Lanes, dispatch, three};
use super::level::Level;
use super::light::{Shader, Vector, unit};
use super::scalars::Scalars;
use super::shot::{Shot, places_of_light};
use crate::camera::clip::is_inside;
use crate::error::Result;
use crate::kernel::{Kernel, SplineFilter};
use crate::layers::Layers;
use crate::lighting::shadow::field::CLIPPED;
use crate::lighting::{Lighting, Normals};
use crate::progress::Progress;
use crate::settings::Settings;
use crate::splats::brick::MadeBrick;
use crate::splats::layers::{LayerClassifier, LeftOut};
use crate::splats::words::{SplatRun, appearances, unpacked};
use crate::volume::{BRICK_EDGE as EDGE, Grid};

/// The largest extinction of a voxel as a coefficient: f16 of a millionth of it are still exact.
const LARGEST: f64 = 1024.0;

/// Voxels that are classified and lit before they are reconstructed.
pub(super) struct Colored {
    grid: Grid,
    bricks: Vec<MadeBrick>,
    /// The bricks of each row along x, y faster than z.
    rows: Vec<Range<usize>>,
    /// The number of rows of bricks along y.
    down: usize,
    /// The kind of the voxels' normals; `None`: prepared without light.
    normals: Option<Normals>,
    /// The length of the unit of extinctions, in world units.
    pub(super) unit: f64,
    /// The factor that brings extinctions into the range of f16.
    pub(super) scale: f64,
    /// The layer with isosurfaces.
    pub(super) surfaces: Option<Box<Scalars>>,
    pub(super) field: Kept<Key, Filtered>,
    pub(super) light: Kept<Falling, ArrivingLight>,
}

/// The key of a field of colours: everything on which it depends.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Key {
    kernel: Kernel,
    level: Level,
    /// The number of points around the lattice.
    pad: usize,
    light: Option<(Lighting, EyeDirections)>,
    falling: Option<Falling>,
}

/// The directions from voxels to the eye: unit vectors in the world, or a place in the units of the shader.
#[derive(Debug, Clone, Copy, PartialEq)]
enum EyeDirections {
    Parallel(DVec3),
    At(DVec3),
}

/// The field of a kernel under a light.
pub(super) struct Filtered {
    pub(super) field: ColorField,
    pub(super) filter: SplineFilter,
}

impl Colored {
    /// Classifies layers.
    ///
    /// # Errors
    /// [`Error::Input`] if samples cannot be read.
    pub(super) fn new(layers: &Layers, settings: &Settings, progress: &Progress) -> Result<Self> {
        let normals = settings.normals();
        let layers = layers.finite()?;
        let surfaces = match layers.isosurfaces(settings.model)? {
            None => None,
            Some((_, volume, transfer)) => {
                Some(Box::new(Scalars::new(volume, &transfer, &settings.along_rays(), progress)?))
            }
        };
        let classifier = LayerClassifier::new(&layers, normals, LeftOut { voxels: true, bricks: true })?;
        let [_, down, deep] = classifier.counts;
        let mut bricks = Vec::new();
        let mut rows = Vec::with_capacity(down * deep);
        let row = |j: usize, k: usize| classifier.row([j, k]);
        layers.volume().for_each_row([down, deep], classifier.halo, &row, &mut |made| {
            let first = bricks.len();
            bricks.extend(made);
            rows.push(first..bricks.len());
            progress.report("classifying", rows.len() as f64 / (down * deep) as f64);
            progress.check()
        })?;
        let exponent = libm::log2(LARGEST / layers.max_density().max(1e-30)).floor();
        Ok(Self {
            grid: *layers.volume().grid(),
            bricks,
            rows,
            down,
            normals,
            unit: layers.unit(),
            scale: libm::exp2(exponent),
            surfaces,
            field: Kept::default(),
            light: Kept::default(),
        })
    }

    pub(super) fn grid(&self) -> &Grid {
        &self.grid
    }

    /// Returns the bytes of memory of the voxels.
    pub(super) fn bytes(&self) -> u64 {
        self.bricks.iter().map(|made| made.splats.bytes()).sum()
    }

    /// Returns the number of visible voxels.
    pub(super) fn count(&self) -> u64 {
        self.bricks.iter().map(|made| u64::from(made.splats.count())).sum()
    }

    /// Returns the box of the visible voxels, with isosurfaces of all voxels: its first voxel, and its size.
    fn bounds(&self) -> [[usize; 3]; 2] {
        if self.surfaces.is_some() {
            return [[0; 3], self.grid.dims().map(|d| d as usize)];
        }
        let (mut low, mut high) = ([usize::MAX; 3], [0; 3]);
        for [first, last] in self.bricks.iter().map(|made| made.brick.bounds) {
            for axis in 0..3 {
                low[axis] = low[axis].min(first[axis] as usize);
                high[axis] = high[axis].max(last[axis] as usize);
            }
        }
        if self.bricks.is_empty() { [[0; 3], [1; 3]] } else { [low, [0, 1, 2].map(|axis| high[axis] - low[axis])] }
    }

    /// Returns the fields of the kernels of a picture in the light that arrives.
    pub(super) fn filtered(
        &self,
        shot: &Shot<'_>,
        arriving: Option<&ArrivingLight>,
        progress: &Progress,
    ) -> Result<Vec<Arc<Filtered>>> {
        let Shot { camera, settings, .. } = *shot;
        settings.check_normals(self.normals)?;
        let falling = shot.falling(self.unit);
        let to_eye = match camera.eye() {
            None => EyeDirections::Parallel(-camera.forward),
            Some(eye) => EyeDirections::At((eye - self.grid.center()) / self.grid.unit()),
        };
        let light = settings.lighting.clone().map(|lighting| (lighting, to_eye));
        let kernels = shot.kernels();
        let pad = padding(&kernels);
        let level = shot.level;
        let key = |kernel: Kernel| Key { kernel, level, pad, light: light.clone(), falling: falling.clone() };
        self.field.get_or_make(kernels.into_iter().map(key).collect(), |key| {
            let shader = key.light.as_ref().map(|(lighting, to_eye)| {
                let shader = Shader::new(lighting, self.grid.center(), self.grid.unit(), [0.0; 2]);
                VoxelLight { shader, to_eye: *to_eye, to_places: places_of_light(&self.grid, &self.grid), arriving }
            });
            let filter = SplineFilter::new(&key.kernel)?;
            let [nx, ny, nz] = self.grid.dims().map(|d| d as usize);
            let fill =
                |z: usize, out: &mut VoxelPlanes| dispatch(Filling { colored: self, light: shader.as_ref(), z, out });
            let field = if key.level == Level(0) {
                ColorField::new(([nx, ny, nz], shot.first(), key.pad), &filter, &fill, progress)?
            } else {
                let plane = |z: usize| {
                    let mut voxels = VoxelPlanes::new([nx, ny], 0)?;
                    fill(z, &mut voxels);
                    Ok(voxels.plane(nx))
                };
                let (dims, cells) = key.level.cells([nx, ny, nz], &plane, false)?;
                let fill = |z: usize, out: &mut VoxelPlanes| {
                    for (row, cells) in cells[dims[0] * dims[1] * z..].chunks_exact(dims[0]).take(dims[1]).enumerate() {
                        let shown = cells.iter().enumerate().filter(|(_, cell)| **cell != [0.0; 4]);
                        shown.for_each(|(column, cell)| out.put(row, column, *cell));
                    }
                };
                ColorField::new((dims, shot.first(), key.pad), &filter, &fill, progress)?
            };
            Ok(Filtered { field, filter })
        })
    }

    /// Returns the runs of splats of a row of the lattice.
    fn runs(&self, y: usize, z: usize) -> impl Iterator<Item = (SplatRun<'_>, usize)> {
        let bricks = &self.bricks[self.rows[y / EDGE + self.down * (z / EDGE)].clone()];
        bricks.iter().flat_map(move |made| made.splats.runs(y % EDGE + EDGE * (z % EDGE), made.brick.origin[0]))
    }

    /// Returns the light that arrives at the voxels, if it casts shadows; `near` is the field of the isosurfaces.
    pub(super) fn arriving(
        &self,
        shot: &Shot<'_>,
        near: Option<&Field>,
        progress: &Progress,
    ) -> Result<Option<Arc<ArrivingLight>>> {
        let Some(falling) = shot.falling(self.unit) else { return Ok(None) };
        let (dims, [low, size]) = (self.grid.dims().map(|d| d as usize), self.bounds());
        let middle = DVec3::from_array(dims.map(|d| (d as f64 - 1.0) / 2.0));
        let mut made = self.light.get_or_make(vec![falling], |falling| {
            let surfaces = self.surfaces.as_ref().map(|surfaces| surfaces.occluders(near, self.unit));
            let row = |[y, z]: [usize; 2], row: &mut [f32]| {
                if let Some(surfaces) = &surfaces {
                    surfaces.row(falling, [y, z], row)?;
                }
                for (run, count) in self.runs(y, z) {
                    let (_, densities) = appearances(&run.column(0), &run.column(1));
                    for (&x, density) in run.xs[..count].iter().zip(densities) {
                        let point = DVec3::new(f64::from(x), y as f64, z as f64) - middle;
                        let casts = falling.clip.is_empty() || is_inside(&falling.clip, point);
                        let extinction = &mut row[x as usize - low[0]];
                        *extinction = if casts { (*extinction + density).max(CLIPPED) } else { CLIPPED };
                    }
                }
                Ok(())
            };
            ArrivingLight::new([low, size], &row, falling, progress)
        })?;
        Ok(Some(made.swap_remove(0)))
    }
}

/// The light on the voxels of a field of colours.
struct VoxelLight<'a> {
    shader: Shader,
    to_eye: EyeDirections,
    /// The map from the lattice to places for the shader.
    to_places: DAffine3,
    arriving: Option<&'a ArrivingLight>,
}

/// A task that puts the visible voxels of a plane into [`VoxelPlanes`].
struct Filling<'a> {
    colored: &'a Colored,
    light: Option<&'a VoxelLight<'a>>,
    z: usize,
    out: &'a mut VoxelPlanes,
}

impl WithSimd for Filling<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Self { colored, light, z, out } = self;
        let scale = Lanes::<S>::all(simd, colored.scale as f32);
        for y in 0..colored.grid.dims()[1] as usize {
            for (run, count) in colored.runs(y, z) {
                let (colors, densities) = appearances(&run.column(0), &run.column(1));
                let [r, g, b] = colors;
                let mut colors = [Lanes::from_array(r), Lanes::from_array(g), Lanes::from_array(b)];
                if let Some(light) = light {
                    colors = light.lit(simd, &run, [y, z], colors);
                }
                let density = Lanes::from_array(densities).mul(simd, scale);
                let [r, g, b] = three!(channel => colors[channel].mul(simd, density).to_array());
                let density = density.to_array();
                for i in 0..count {
                    out.put(y, run.xs[i] as usize, [r[i], g[i], b[i], density[i]]);
                }
            }
        }
    }
}

impl VoxelLight<'_> {
    /// Returns the colours of a run of splats under this light.
    #[inline(always)]
    fn lit<S: Simd>(&self, simd: S, run: &SplatRun<'_>, [y, z]: [usize; 2], colors: Vector<S>) -> Vector<S> {
        let normals = unpacked(&run.column(2));
        let [nx, ny, nz] = normals.directions();
        let normal = [Lanes::from_array(nx), Lanes::from_array(ny), Lanes::from_array(nz)];
        let mut xs = [0.0_f32; 16];
        for i in 0..16 {
            xs[i] = run.xs[i] as i32 as f32;
        }
        let xs = Lanes::<S>::from_array(xs);
        let start = self.to_places.transform_point3(DVec3::new(0.0, y as f64, z as f64)).to_array();
        let step = self.to_places.matrix3.x_axis.to_array();
        let place: Vector<S> = three!(axis => {
            xs.fma(simd, Lanes::all(simd, step[axis] as f32), Lanes::all(simd, start[axis] as f32))
        });
        let to_eye = match self.to_eye {
            EyeDirections::Parallel(towards) => {
                let towards = towards.to_array();
                three!(axis => Lanes::all(simd, towards[axis] as f32))
            }
            EyeDirections::At(eye) => {
                let eye = eye.to_array();
                unit(simd, &three!(axis => Lanes::all(simd, eye[axis] as f32).sub(simd, place[axis])))
            }
        };
        let mut kept = None;
        if let Some(arriving) = self.arriving {
            let mut shares = [[0.0_f32; 16]; 4];
            for i in 0..16 {
                let at = arriving.at_voxel([run.xs[i] as usize, y, z]);
                for light in 0..4 {
                    shares[light][i] = f32::from(at[light]) / f32::from(u16::MAX);
                }
            }
            let [a, b, c, d] = shares;
            kept = Some([Lanes::from_array(a), Lanes::from_array(b), Lanes::from_array(c), Lanes::from_array(d)]);
        }
        let surface = Lanes::from_array(normals.weights);
        let shine = self.shader.shine(simd, &normal, surface, &place, &to_eye, kept.as_ref());
        three!(channel => shine.lit(simd, channel, colors[channel]))
    }
}
