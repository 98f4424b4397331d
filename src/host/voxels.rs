//! Scenes of classified voxels: fields of colours that are composited along rays.

use std::ops::Range;
use std::sync::Arc;

use glam::{DAffine3, DVec3};
use pulp::{Simd, WithSimd};

use super::arriving::{ArrivingLight, Casters, Falling};
use super::blend::LatticeGrowth;
use super::colors::ColorField;
use super::field::{Field, padding};
use super::filter::{RowSource, SampleRow};
use super::kept::Kept;
use super::lanes::{Lanes, three};
use super::lattice::Padded;
use super::level::Level;
use super::light::{Shader, Vector, unit};
use super::plane::CHANNELS;
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
use crate::vectors::dispatch;
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
    filters: Kept<Kernel, SplineFilter>,
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
    /// The growth by which the fields of several kernels are blended: each has coefficients only where it has a weight.
    /// `None`: everywhere, because there is one kernel, or the field serves other views too.
    growth: Option<LatticeGrowth>,
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
            filters: Kept::default(),
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
        let Shot { camera, settings, grid, .. } = *shot;
        settings.check_normals(self.normals)?;
        let falling = shot.falling(self.unit, self.surfaces.is_some());
        let to_eye = match camera.eye() {
            None => EyeDirections::Parallel(-camera.forward),
            Some(eye) => EyeDirections::At((eye - grid.center()) / grid.unit()),
        };
        let light = settings.lighting.clone().map(|lighting| (lighting, to_eye));
        let kernels = shot.kernels();
        let pad = padding(&kernels);
        let level = shot.level;
        let growth = (light.is_some() && kernels.len() > 1).then(|| shot.growth());
        let key = |kernel: Kernel| Key { kernel, level, pad, light: light.clone(), falling: falling.clone(), growth };
        let all: Vec<Key> = kernels.into_iter().map(key).collect();
        self.field.get_or_make(&all, |keys, spare| {
            let light = light.as_ref().map(|(lighting, to_eye)| {
                let shader = Shader::new(lighting, grid.center(), grid.unit(), [0.0; 2]);
                let first = shot.first_voxel();
                VoxelLight { shader, to_eye: *to_eye, to_places: places_of_light(grid, grid), first, arriving }
            });
            let kernels: Vec<Kernel> = keys.iter().map(|key| key.kernel).collect();
            let filters =
                self.filters.get_or_make(&kernels, |kernels, _| kernels.iter().map(SplineFilter::new).collect())?;
            let filters: Vec<SplineFilter> = filters.iter().map(|filter| filter.as_ref().clone()).collect();
            let voxels = LitVoxels { colored: self, light };
            let spare = spare.into_iter().map(|made| made.field).collect();
            let dims = self.grid.dims().map(|d| d as usize);
            let served = |lattice: &Padded| {
                let growth = growth?;
                let numbers = (0..all.len()).filter(|&number| keys.contains(&all[number]));
                Some(numbers.map(|number| growth.served(&shot.growths, number, lattice.middles())).collect::<Vec<_>>())
            };
            let fields = if level == Level(0) {
                let lattice = Padded::new(dims, pad, shot.first());
                ColorField::new(lattice, &filters, &voxels, (spare, served(&lattice).as_deref()), progress)?
            } else {
                let (dims, cells) = level.cells(dims, &|z| voxels.plane(z), false)?;
                let (lattice, cells) = (Padded::new(dims, pad, shot.first()), ColorCells { dims, cells });
                ColorField::new(lattice, &filters, &cells, (spare, served(&lattice).as_deref()), progress)?
            };
            Ok(fields.into_iter().zip(filters).map(|(field, filter)| Filtered { field, filter }).collect())
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
        let Some(falling) = shot.falling(self.unit, self.surfaces.is_some()) else { return Ok(None) };
        let mut made = self.light.get_or_make(&[falling], |falling, mut before| {
            let casters = self.casters(near, &falling[0]);
            Ok(vec![ArrivingLight::new(&casters, &falling[0], shot.incoming(), before.pop(), progress)?])
        })?;
        Ok(Some(made.swap_remove(0)))
    }

    /// Returns the matter that casts shadows; `near` is the field of the isosurfaces.
    pub(super) fn casters<'a>(&'a self, near: Option<&'a Field>, falling: &'a Falling) -> Casters<'a> {
        let bounds = self.bounds();
        let surfaces = self.surfaces.as_ref().map(|surfaces| surfaces.occluders(near, self.unit));
        let row = move |[y, z]: [usize; 2], row: &mut [f32]| {
            if let Some(surfaces) = &surfaces {
                surfaces.row(falling, [y, z], row)?;
            }
            for (run, count) in self.runs(y, z) {
                let (_, densities) = appearances(&run.column(0), &run.column(1));
                for (&x, density) in run.xs[..count].iter().zip(densities) {
                    let casts = falling.clip.is_empty() || is_inside(&falling.clip, falling.place([x as usize, y, z]));
                    let extinction = &mut row[x as usize - bounds[0][0]];
                    *extinction = if casts { (*extinction + density).max(CLIPPED) } else { CLIPPED };
                }
            }
            Ok(())
        };
        Casters { bounds, row: Box::new(row) }
    }
}

/// The light on the voxels of a field of colours.
struct VoxelLight<'a> {
    shader: Shader,
    to_eye: EyeDirections,
    /// The map from the lattice to places for the shader.
    to_places: DAffine3,
    /// The point of the lattice at the first voxel of the scene: parts of a lattice get the light of the whole.
    first: [u32; 3],
    arriving: Option<&'a ArrivingLight>,
}

/// The visible voxels of a scene under a light.
struct LitVoxels<'a> {
    colored: &'a Colored,
    light: Option<VoxelLight<'a>>,
}

impl LitVoxels<'_> {
    /// Returns the voxels of a plane, x fastest.
    fn plane(&self, z: usize) -> Result<Vec<[f32; CHANNELS]>> {
        let [nx, ny, _] = self.colored.grid.dims().map(|d| d as usize);
        let mut row = SampleRow::new(&Padded::new([nx, 1, 1], 0, [0; 3]))?;
        let mut voxels = Vec::with_capacity(nx * ny);
        for y in 0..ny {
            row.clear();
            self.row(&(), [y, z].map(|place| place as isize), &mut row);
            voxels.extend((0..nx).map(|x| row.get(x)));
        }
        Ok(voxels)
    }
}

impl RowSource<CHANNELS> for LitVoxels<'_> {
    type Slab = ();

    fn slab(&self, _: Range<isize>) -> Result<()> {
        Ok(())
    }

    fn row(&self, (): &(), place: [isize; 2], out: &mut SampleRow<CHANNELS>) {
        let [_, ny, nz] = self.colored.grid.dims().map(|d| d as isize);
        if (0..ny).contains(&place[0]) && (0..nz).contains(&place[1]) {
            let place = place.map(|place| place as usize);
            dispatch(Filling { colored: self.colored, light: self.light.as_ref(), place, out });
        }
    }
}

/// Cells of several voxels.
struct ColorCells {
    dims: [usize; 3],
    cells: Vec<[f32; CHANNELS]>,
}

impl RowSource<CHANNELS> for ColorCells {
    type Slab = ();

    fn slab(&self, _: Range<isize>) -> Result<()> {
        Ok(())
    }

    fn row(&self, (): &(), [y, z]: [isize; 2], out: &mut SampleRow<CHANNELS>) {
        let [nx, ny, nz] = self.dims;
        if (0..ny as isize).contains(&y) && (0..nz as isize).contains(&z) {
            let cells = &self.cells[nx * (y as usize + ny * z as usize)..][..nx];
            let shown = cells.iter().enumerate().filter(|(_, cell)| **cell != [0.0; CHANNELS]);
            shown.for_each(|(x, cell)| out.put(x, *cell));
        }
    }
}

/// A task that puts the visible voxels of a row into a [`SampleRow`].
struct Filling<'a> {
    colored: &'a Colored,
    light: Option<&'a VoxelLight<'a>>,
    /// The y and z of the row.
    place: [usize; 2],
    out: &'a mut SampleRow<CHANNELS>,
}

impl WithSimd for Filling<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Self { colored, light, place: [y, z], out } = self;
        let scale = Lanes::<S>::all(simd, colored.scale as f32);
        for (run, count) in colored.runs(y, z) {
            if !out.wants(run.xs[0], run.xs[count - 1]) {
                continue;
            }
            let (colors, densities) = appearances(&run.column(0), &run.column(1));
            let [r, g, b] = colors;
            let mut colors = [Lanes::from_array(r), Lanes::from_array(g), Lanes::from_array(b)];
            if let Some(light) = light {
                colors = light.lit(simd, &run, [y, z], colors);
            }
            let density = Lanes::from_array(densities).mul(simd, scale);
            let [r, g, b] = three!(channel => colors[channel].mul(simd, density).to_array());
            out.put_run(&run.xs, count, [r, g, b, density.to_array()]);
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
            xs[i] = (run.xs[i] + self.first[0]) as i32 as f32;
        }
        let xs = Lanes::<S>::from_array(xs);
        let [first_y, first_z] = [self.first[1], self.first[2]].map(f64::from);
        let start = self.to_places.transform_point3(DVec3::new(0.0, first_y + y as f64, first_z + z as f64)).to_array();
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
