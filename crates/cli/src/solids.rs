//! Meshes and depth buffers of a job.

use std::path::PathBuf;

use voxsplat::camera::{Camera, Hull};
use voxsplat::image::{Ground, SectionPlane};
use voxsplat::layers::Layers;
use voxsplat::lighting::Lighting;
use voxsplat::program::PlaneSpec;
use voxsplat::solids::{MeshSpec, Solid, Solids};
use voxsplat::volume::Volume;

use super::args::SolidArgs;
use super::failure::{Failure, fail};
use super::output;

/// The solids of a job.
#[derive(Debug, Clone, Default, PartialEq)]
pub(crate) struct SolidsJob {
    meshes: Vec<MeshSpec>,
    pub(crate) planes: Vec<PlaneSpec>,
    depth: Option<PathBuf>,
}

impl SolidsJob {
    pub(crate) fn new(args: &SolidArgs) -> Result<Self, Failure> {
        let meshes = args.mesh.iter().map(|path| MeshSpec::new(path)).collect::<Result<_, _>>()?;
        Ok(Self { meshes, planes: args.plane.clone(), depth: args.depth.clone() })
    }
}

/// Meshes and planes that have been read, with the job to which they belong.
#[derive(Default)]
pub(crate) struct HeldSolids {
    job: SolidsJob,
    meshes: Vec<Solid>,
    planes: Vec<SectionPlane>,
    /// The corners of the planes' parts in the volume.
    corners: Vec<glam::DVec3>,
}

impl HeldSolids {
    /// Reads the meshes of a job, unless they are here, and returns whether it did. Notes meshes outside of the volume.
    pub(crate) fn read(&mut self, job: &SolidsJob, volume: &Volume) -> Result<bool, Failure> {
        if self.job == *job {
            return Ok(false);
        }
        self.meshes = job.meshes.iter().map(MeshSpec::load).collect::<Result<_, _>>()?;
        let planes = job.planes.iter().map(|plane| plane.plane(volume, None, "plane"));
        self.planes = planes.collect::<Result<_, _>>()?;
        let outlines = self.planes.iter().map(|plane| plane.outline(volume.grid()));
        self.corners = outlines.flatten().collect();
        self.job = job.clone();
        for (spec, solid) in job.meshes.iter().zip(&self.meshes) {
            if !solid.reaches(volume.grid()) {
                output::say(&format!(
                    "note: --mesh {}: it lies beside the volume, whose world is LPS for patients",
                    spec.path.display()
                ));
            }
        }
        Ok(true)
    }

    /// Returns the hull of some matter, the meshes and the planes.
    pub(crate) fn around(&self, hull: Hull) -> Hull {
        let hull = self.meshes.iter().fold(hull, |hull, solid| hull.with_mesh(&solid.mesh));
        hull.with_points(self.corners.iter().copied())
    }

    /// Returns the surfaces as a camera sees them; `None` without any.
    pub(crate) fn seen(
        &self,
        camera: &Camera,
        lighting: Option<&Lighting>,
        (layers, ground): (&Layers, Ground),
    ) -> Result<Option<Solids>, Failure> {
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
        let cuts = Solids::of_planes(&self.planes, layers, ground, camera)?;
        Ok(Solids::seen(&self.meshes, cuts.into_iter().chain(loaded.map(|(_, solids)| solids)), camera, lighting)?)
    }
}
