//! Meshes and depth buffers of a job.

use std::path::PathBuf;

use voxsplat::camera::{Camera, Hull};
use voxsplat::lighting::Lighting;
use voxsplat::solids::{MeshSpec, Solid, Solids};
use voxsplat::volume::Grid;

use super::args::SolidArgs;
use super::failure::{Failure, fail};
use super::output;

/// The solids of a job.
#[derive(Debug, Clone, Default, PartialEq)]
pub(crate) struct SolidsJob {
    meshes: Vec<MeshSpec>,
    depth: Option<PathBuf>,
}

impl SolidsJob {
    pub(crate) fn new(args: &SolidArgs) -> Result<Self, Failure> {
        let meshes = args.mesh.iter().map(|path| MeshSpec::new(path)).collect::<Result<_, _>>()?;
        Ok(Self { meshes, depth: args.depth.clone() })
    }
}

/// Meshes that have been read, with the job to which they belong.
#[derive(Default)]
pub(crate) struct HeldSolids {
    job: SolidsJob,
    meshes: Vec<Solid>,
}

impl HeldSolids {
    /// Reads the meshes of a job, unless they are here, and returns whether it did. Notes meshes outside of the volume.
    pub(crate) fn read(&mut self, job: &SolidsJob, grid: &Grid) -> Result<bool, Failure> {
        if self.job == *job {
            return Ok(false);
        }
        self.meshes = job.meshes.iter().map(MeshSpec::load).collect::<Result<_, _>>()?;
        self.job = job.clone();
        for (spec, solid) in job.meshes.iter().zip(&self.meshes) {
            if !solid.reaches(grid) {
                output::say(&format!(
                    "note: --mesh {}: it lies beside the volume, whose world is LPS for patients",
                    spec.path.display()
                ));
            }
        }
        Ok(true)
    }

    /// Returns the hull of some matter and the meshes.
    pub(crate) fn around(&self, hull: Hull) -> Hull {
        self.meshes.iter().fold(hull, |hull, solid| hull.with_mesh(&solid.mesh))
    }

    /// Returns the surfaces as a camera sees them; `None` without any.
    pub(crate) fn seen(&self, camera: &Camera, lighting: Option<&Lighting>) -> Result<Option<Solids>, Failure> {
        let loaded = self.job.depth.as_ref().map(|path| Ok::<_, Failure>((path, Solids::load(path)?))).transpose()?;
        if let Some((path, solids)) = &loaded
            && solids.depths.size() != camera.size
        {
            let ([width, height], [across, down]) = (solids.depths.size(), camera.size);
            let path = path.display();
            return fail(format!(
                "--depth {path}: {width} x {height} pixels, expected {across} x {down} as the picture has: --size \
                 {width}x{height}"
            ));
        }
        Ok(Solids::seen(&self.meshes, loaded.map(|(_, solids)| solids), camera, lighting)?)
    }
}
