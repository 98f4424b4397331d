//! Meshes and depth buffers in pictures.

use std::path::PathBuf;

use numpy::{PyArrayMethods, PyReadonlyArray2};
use pyo3::prelude::*;
use voxsplat::camera::{Camera, Hull};
use voxsplat::error::Result;
use voxsplat::image::{DepthMap, SectionPlane};
use voxsplat::lighting::Lighting;
use voxsplat::program::PlaneSpec;
use voxsplat::solids::{MeshSpec, Solid, Solids};
use voxsplat::volume::Volume;

use crate::error::raised;

/// A mesh of triangles, with a colour.
#[pyclass(frozen, module = "voxsplat")]
pub(crate) struct Mesh {
    solid: Solid,
}

#[pymethods]
impl Mesh {
    /// Reads the mesh of a file, or of a file with a colour behind it.
    #[staticmethod]
    fn of_file(py: Python<'_>, path: PathBuf, color: Option<&str>) -> PyResult<Self> {
        let load = || {
            let spec = MeshSpec::new(&path)?;
            let color = color.map(MeshSpec::color).transpose()?.or(spec.color);
            MeshSpec { color, ..spec }.load()
        };
        Ok(Self { solid: py.detach(load).map_err(|fault| raised(&fault))? })
    }

    /// Makes a mesh of places (n x 3), triangles (m x 3) and, maybe, colours of vertices (n x 3).
    #[staticmethod]
    fn of_arrays(
        vertices: PyReadonlyArray2<'_, f32>,
        triangles: PyReadonlyArray2<'_, u32>,
        colors: Option<PyReadonlyArray2<'_, u8>>,
        color: Option<&str>,
    ) -> PyResult<Self> {
        fn rows<T: Copy, const N: usize>(values: Vec<T>) -> Vec<[T; N]> {
            values.as_chunks().0.to_vec()
        }
        let mesh = voxsplat::solids::Mesh {
            vertices: rows(vertices.to_vec()?),
            triangles: rows(triangles.to_vec()?),
            colors: colors.map(|colors| colors.to_vec()).transpose()?.map(rows).unwrap_or_default(),
            space: None,
        };
        let color = color.map(MeshSpec::color).transpose().map_err(|fault| raised(&fault))?;
        let mesh = mesh.checked("meshes").map_err(|fault| raised(&fault.into()))?;
        Ok(Self { solid: Solid { mesh, color: color.unwrap_or(Solid::COLOR) } })
    }
}

/// Reads the texts of planes.
pub(crate) fn planes_of(texts: &[String]) -> PyResult<Vec<PlaneSpec>> {
    texts.iter().map(|text| text.parse()).collect::<Result<_>>().map_err(|fault| raised(&fault))
}

/// The solids that a picture requests.
#[derive(Default)]
pub(crate) struct Requested {
    meshes: Vec<Solid>,
    depths: Option<DepthMap>,
    planes: Vec<PlaneSpec>,
}

impl Requested {
    pub(crate) fn new(
        meshes: &[PyRef<'_, Mesh>],
        depth: Option<PyReadonlyArray2<'_, f32>>,
        planes: &[String],
    ) -> PyResult<Self> {
        let meshes = meshes.iter().map(|mesh| mesh.solid.clone()).collect();
        let depths = depth.map(|depth| {
            let [height, width] = [0, 1].map(|axis| depth.as_array().shape()[axis] as u32);
            DepthMap::new(width, height, depth.to_vec()?).map_err(|fault| raised(&fault))
        });
        Ok(Self { meshes, depths: depths.transpose()?, planes: planes_of(planes)? })
    }

    /// Returns the planes through a volume.
    pub(crate) fn planes(&self, volume: &Volume) -> Result<Vec<SectionPlane>> {
        PlaneSpec::planes(&self.planes, volume, None)
    }

    /// Returns the hull of some matter, the meshes and planes.
    pub(crate) fn around(&self, hull: Hull, planes: &[SectionPlane], volume: &Volume) -> Hull {
        let hull = self.meshes.iter().fold(hull, |hull, solid| hull.with_mesh(&solid.mesh));
        hull.with_points(planes.iter().flat_map(|plane| plane.outline(volume.grid())))
    }

    /// Returns the surfaces as a camera sees them, with planes as drawn; `None` without any.
    pub(crate) fn seen(
        self,
        planes: Option<Solids>,
        camera: &Camera,
        lighting: Option<&Lighting>,
    ) -> Result<Option<Solids>> {
        let others = self.depths.map(|depths| Solids { depths, image: None });
        Solids::seen(&self.meshes, planes.into_iter().chain(others), camera, lighting)
    }
}
