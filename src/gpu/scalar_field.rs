//! scalar-field: the scalars of voxels or cells to the field of extinctions that casts shadows, on the device:
//! shaders/field_of_cells.wgsl.

use bytemuck::Zeroable;

use super::cache::Cache;
use super::layout::Occluders;
use super::pipeline::{Binding, texture_view};
use super::recorder::Recorder;
use super::sampled_scalars::SampledScalars;
use super::shaders;
use super::stage::{Stage, for_each};
use super::transfer::TransferTable;
use crate::error::Result;
use crate::volume::Grid;

/// The scalars of a lattice, and their extinction.
pub(crate) struct ScalarField<'a> {
    pub(crate) scalars: &'a SampledScalars,
    pub(crate) table: &'a TransferTable,
    /// The lattice of the scalars.
    pub(crate) grid: &'a Grid,
    /// The length of the unit of extinctions, in world units.
    pub(crate) unit: f64,
}

/// The stage that makes the field. The key: whether cells have gradients, gradient opacity, and the isosurfaces.
struct FieldStage(Stage);

impl ScalarField<'_> {
    /// Returns the first lattice point of the box that has scalars, and its size.
    pub(crate) fn bounds(&self) -> [[usize; 3]; 2] {
        let [low, high] = self.scalars.bounds;
        [low, [0, 1, 2].map(|axis| high[axis] - low[axis])].map(|point| point.map(|n| n as usize))
    }

    /// Records the extinctions of the box, in the box of voxels that `light_box` describes.
    pub(crate) fn fill(
        &self,
        recorder: &mut Recorder<'_>,
        pipelines: &Cache,
        [light_box, field]: [&wgpu::Buffer; 2],
    ) -> Result<()> {
        use Binding::{Read, ReadTexture, Uniform, Write};
        let Self { scalars, table, grid, unit } = self;
        let context = recorder.context;
        let cells = scalars.as_cells(context, pipelines)?;
        let key @ (has_gradients, thins, surfaces) = (cells.has_gradients(), table.thins, table.surfaces);
        let stage = pipelines.get_or_make(key, || {
            let transfer = ReadTexture(wgpu::TextureFormat::Rgba32Float);
            let slots = [Uniform, Read, Uniform, Write, transfer, Uniform];
            let constants =
                [("RANGES", has_gradients.into()), ("GRADIENT_OPACITY", thins.into()), ("ISOSURFACES", surfaces)];
            let entry = ("classify", "field_of_cells");
            Ok(FieldStage(Stage::new(context, shaders::FIELD_OF_CELLS, entry, &slots, &constants)))
        })?;
        // Per local unit: the unit of the world does not move gradients out of the range of f32.
        let local = grid.local().to_lattice().matrix3.transpose();
        let [gradient_x, gradient_y, gradient_z] = [0, 1, 2].map(|axis| local.col(axis).as_vec3().to_array());
        let occluders = Occluders {
            gradient_x,
            gradient_lookup: table.gradient_lookup(grid.unit()),
            gradient_y,
            gradient_z,
            low: scalars.bounds[0],
            lookup: table.lookup,
            per_unit: (grid.unit() / unit) as f32,
            ..Occluders::zeroed()
        };
        let uniform = wgpu::BufferUsages::UNIFORM;
        let occluders = context.upload("shadows.occluders", bytemuck::bytes_of(&occluders), uniform)?;
        cells.each_part(recorder, &scalars.bound(), scalars.cells_of_bounds(), &mut |recorder, [part, cells], count| {
            let resources = [
                part.as_entire_binding(),
                cells.as_entire_binding(),
                light_box.as_entire_binding(),
                field.as_entire_binding(),
                texture_view(&table.texture),
                occluders.as_entire_binding(),
            ];
            stage.0.run(recorder, &resources, for_each(context, count));
        })
    }
}
