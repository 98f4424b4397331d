//! Meshes of triangles and readers of their files: PLY, STL, OBJ and, with the feature `vtk`, VTP.

mod obj;
mod ply;
mod stl;

use std::path::Path;

use glam::DVec3;

use crate::error::{Result, Subject, refuse, refuse_if};
use crate::files;

/// The largest file of a mesh that is read, in bytes: some 80 million triangles of a binary STL.
const MAX_BYTES: u64 = 4 << 30;

/// A mesh of triangles in the world.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Mesh {
    /// The places of the vertices, world units.
    pub vertices: Vec<[f32; 3]>,
    /// The indices of the vertices of each triangle.
    pub triangles: Vec<[u32; 3]>,
    /// The red, green and blue of each vertex, sRGB; none if the file has no colours.
    pub colors: Vec<[u8; 3]>,
    /// The patient space that the file states, as 3D Slicer does.
    pub space: Option<Space>,
}

/// A patient space: the directions of its axes. Both are in millimetres.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Space {
    /// The space of DICOM and of [`Grid`](crate::volume::Grid): left, posterior, superior.
    Lps,
    /// The space of NIfTI: right, anterior, superior.
    Ras,
}

impl Space {
    /// Returns the space that a comment states, such as `SPACE=LPS`.
    fn of_comment(text: &str) -> Option<Self> {
        let (_, name) = text.split_once("SPACE=")?;
        match name.get(..3)? {
            "LPS" => Some(Self::Lps),
            "RAS" => Some(Self::Ras),
            _ => None,
        }
    }
}

/// Loads a mesh from a PLY, STL, OBJ or VTP file. Polygons are cut into triangles around their first vertex.
///
/// # Errors
/// [`Error::Read`](crate::Error::Read) if the file cannot be read; [`Error::Format`](crate::Error::Format) if it is
/// none of these, damaged, cut short, without a triangle, or has numbers that are not finite.
pub fn load(path: impl AsRef<Path>) -> Result<Mesh> {
    let path = path.as_ref();
    let bytes = files::read(path, MAX_BYTES)?;
    let extension = path.extension().and_then(|extension| extension.to_str()).unwrap_or_default().to_ascii_lowercase();
    let head = bytes.trim_ascii_start();
    let mesh = if bytes.starts_with(b"ply") {
        ply::read(path, &bytes)?
    } else if head.starts_with(b"<?xml") || head.starts_with(b"<VTKFile") {
        drop(bytes);
        vtp(path)?
    } else if extension == "obj" {
        obj::read(path, &bytes)?
    } else if extension == "stl" && bytes.len() >= stl::BEFORE || stl::is_stl(&bytes) {
        stl::read(path, &bytes)?
    } else {
        refuse!(path, "is no mesh: expected a PLY, STL, OBJ or VTP file");
    };
    mesh.checked(path)
}

#[cfg(feature = "vtk")]
fn vtp(path: &Path) -> Result<Mesh> {
    crate::formats::read_poly_data(path)
}

#[cfg(not(feature = "vtk"))]
fn vtp(path: &Path) -> Result<Mesh> {
    refuse!(path, "is a VTP file, which this program was built without: build it with the feature vtk");
}

impl Mesh {
    /// Refuses a mesh without triangles, indices beyond its vertices, colours of other vertices, and places that are
    /// not finite. `name` is for messages.
    ///
    /// # Errors
    /// [`Error::Format`](crate::Error::Format).
    pub fn checked(self, name: impl AsRef<Path>) -> Result<Self> {
        let path = name.as_ref();
        refuse_if!(self.triangles.is_empty(), path, "has no triangle");
        let count = self.vertices.len();
        let colors = self.colors.len();
        refuse_if!(colors != 0 && colors != count, path, "has {colors} colours for {count} vertices");
        if let Some(index) = self.triangles.iter().flatten().find(|index| **index as usize >= count) {
            refuse!(path, "has a triangle with vertex {index}, but only {count} vertices");
        }
        let bad = self.vertices.iter().position(|place| !place.iter().all(|number| number.is_finite()));
        if let Some(index) = bad {
            refuse!(path, "vertex {index} has a place that is not finite");
        }
        Ok(self)
    }

    /// Returns the mesh in the patient space [`Space::Lps`]. A mesh that states no space is returned as it is.
    #[must_use]
    pub fn into_lps(mut self) -> Self {
        if self.space == Some(Space::Ras) {
            self.vertices.iter_mut().for_each(|[x, y, _]| (*x, *y) = (-*x, -*y));
            self.space = Some(Space::Lps);
        }
        self
    }

    /// Returns the place of a vertex in the world.
    #[must_use]
    pub fn place(&self, vertex: u32) -> DVec3 {
        DVec3::from_array(self.vertices[vertex as usize].map(f64::from))
    }

    /// Adds a polygon as triangles around its first vertex.
    pub(crate) fn add_polygon(&mut self, corners: &[u32]) {
        if let [first, rest @ ..] = corners {
            self.triangles.extend(rest.windows(2).map(|pair| [*first, pair[0], pair[1]]));
        }
    }
}

/// Returns the index of the vertex with this number in a file whose numbers begin at 0.
pub(crate) fn index(path: &Path, number: f64) -> Result<u32> {
    refuse_if!(!(0.0..4e9).contains(&number) || number.fract() != 0.0, path, "has {number} as the number of a vertex");
    Ok(number as u32)
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;

    /// Makes a unit square of two triangles, at a height.
    pub(crate) fn square() -> Mesh {
        Mesh {
            vertices: vec![[0.0, 0.0, 0.5], [1.0, 0.0, 0.5], [1.0, 1.0, 0.5], [0.0, 1.0, 0.5]],
            triangles: vec![[0, 1, 2], [0, 2, 3]],
            ..Mesh::default()
        }
    }

    fn loaded(name: &str, bytes: &[u8]) -> Result<Mesh> {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join(name);
        std::fs::write(&path, bytes).unwrap();
        load(&path)
    }

    fn refusal(name: &str, bytes: &[u8]) -> String {
        let error = loaded(name, bytes).unwrap_err().to_string();
        assert!(!error.contains('\n') && error.contains(name), "{error}");
        error
    }

    const PLY: &str = "ply\nformat ascii 1.0\ncomment SPACE=RAS\nelement vertex 4\nproperty float x\nproperty float y\n\
                       property float z\nproperty uchar red\nproperty uchar green\nproperty uchar blue\n\
                       element face 1\nproperty list uchar int vertex_indices\nend_header\n\
                       0 0 .5 255 0 0\n1 0 .5 255 0 0\n1 1 .5 255 0 0\n0 1 .5 255 0 0\n4 0 1 2 3\n";

    #[test]
    fn text_of_each_format_is_read() {
        let ply = loaded("a.ply", PLY.as_bytes()).unwrap();
        assert_eq!(ply, Mesh { colors: vec![[255, 0, 0]; 4], space: Some(Space::Ras), ..square() });
        assert_eq!(ply.into_lps().vertices[2], [-1.0, -1.0, 0.5]);
        let obj = b"# a square\nv 0 0 .5\nv 1 0 .5\nv 1 1 .5\nv 0 1 .5\nvn 0 0 1\nusemtl a\nf 1//1 2//1 -2/1/1 4\n";
        assert_eq!(loaded("a.obj", obj).unwrap(), square());
        let facet = |a: &str, b: &str| {
            format!("facet normal 0 0 1\nouter loop\nvertex 0 0 .5\nvertex {a} .5\nvertex {b} .5\nendloop\nendfacet\n")
        };
        let stl = format!("solid a\n{}{}endsolid a\n", facet("1 0", "1 1"), facet("1 1", "0 1"));
        let stl = loaded("a.stl", stl.as_bytes()).unwrap();
        assert_eq!((stl.triangles.len(), stl.place(stl.triangles[1][2])), (2, DVec3::new(0.0, 1.0, 0.5)));
    }

    /// Returns the square as a binary PLY with this byte order.
    fn binary_ply(order: &str, number: fn(f32) -> [u8; 4], whole: fn(i32) -> [u8; 4]) -> Vec<u8> {
        let mut bytes = format!(
            "ply\r\nformat binary_{order}_endian 1.0\r\nelement face 1\r\nproperty list uchar int vertex_index\r\n\
             property uchar flag\r\nelement vertex 4\r\nproperty float x\r\nproperty float y\r\nproperty float z\r\n\
             end_header\r\n"
        )
        .into_bytes();
        bytes.push(4);
        (0..4).for_each(|corner| bytes.extend(whole(corner)));
        bytes.push(0);
        square().vertices.iter().flatten().for_each(|&value| bytes.extend(number(value)));
        bytes
    }

    #[test]
    fn binary_files_are_read_in_either_order() {
        let little = binary_ply("little", f32::to_le_bytes, i32::to_le_bytes);
        let big = binary_ply("big", f32::to_be_bytes, i32::to_be_bytes);
        assert_eq!(loaded("a.ply", &little).unwrap(), square());
        assert_eq!(loaded("a.ply", &big).unwrap(), square());
        let mut stl = b"solid of 3D Slicer;SPACE=LPS".to_vec();
        stl.resize(80, 0);
        stl.extend(1_u32.to_le_bytes());
        [0.0_f32; 3].iter().chain(square().vertices[..3].iter().flatten()).for_each(|v| stl.extend(v.to_le_bytes()));
        stl.extend([0; 2]);
        let mesh = loaded("a.stl", &stl).unwrap();
        assert_eq!((mesh.vertices, mesh.space), (square().vertices[..3].to_vec(), Some(Space::Lps)));
        assert!(refusal("a.stl", &stl[..120]).contains("cut short"));
        assert!(refusal("a.ply", &little[..little.len() - 1]).contains("cut short"));
    }

    /// Loads files by VTK, which tests/data/meshes/make.py writes.
    #[test]
    fn meshes_of_another_program_have_their_places() {
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/data/meshes");
        let names = ["binary.ply", "text.ply", "binary.stl", "text.stl", "text.obj"];
        let names = names.into_iter().chain(
            if cfg!(feature = "vtk") { &["inline.vtp", "appended.vtp", "text.vtp"][..] } else { &[] }.iter().copied(),
        );
        for name in names {
            let mesh = load(folder.join(name)).unwrap();
            let area = |[a, b, c]: [u32; 3]| {
                let [a, b, c] = [a, b, c].map(|vertex| mesh.place(vertex));
                assert!([a, b, c].iter().all(|place| place.z == 0.5), "{name}");
                // All turn the same way round.
                (b - a).cross(c - a).z / 2.0
            };
            assert_eq!(mesh.triangles.iter().map(|&triangle| area(triangle)).collect::<Vec<_>>(), [0.5; 2], "{name}");
            let ends = mesh.vertices.iter().fold([0.0_f32; 2], |[x, y], place| [x.max(place[0]), y.max(place[1])]);
            assert_eq!(ends, [1.0; 2], "{name}");
        }
    }

    #[cfg(feature = "vtk")]
    #[test]
    fn bad_files_of_vtk_are_refused_in_one_line() {
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/data/meshes");
        let text = std::fs::read_to_string(folder.join("text.vtp")).unwrap();
        for (from, to, reason) in [
            ("PolyData\"", "ImageData\"", "type \"ImageData\", expected PolyData"),
            ("NumberOfPoints=\"4\"", "NumberOfPoints=\"5000000000\"", "is cut short: its Points need 15000000000"),
            ("NumberOfPolys=\"1\"", "NumberOfPolys=\"0\"", "no triangle"),
            ("NumberOfPolys=\"1\"", "NumberOfPolys=\"two\"", "NumberOfPolys is \"two\""),
            ("0 1 2 3\n", "0 1 2 9\n", "vertex 9, but only 4"),
        ] {
            assert!(text.contains(from), "{from}");
            // The heights are four such numbers too.
            let bad = text.rsplit_once(from).map(|(before, after)| [before, to, after].concat()).unwrap();
            let error = refusal("a.vtp", bad.as_bytes());
            assert!(error.contains(reason), "{error}: expected {reason}");
        }
    }

    #[test]
    fn bad_meshes_are_refused_in_one_line() {
        for (name, bytes, reason) in [
            ("a.ply", PLY.replace("4 0 1 2 3", "4 0 1 2 4"), "vertex 4, but only 4"),
            ("a.ply", PLY.replace("4 0 1 2 3", "4 0 1 2 -1"), "-1 as the number of a vertex"),
            ("a.ply", PLY.replace("4 0 1 2 3", "4000000 0 1"), "cut short"),
            ("a.ply", PLY.replace("vertex 4", "vertex 4000000000"), "cut short"),
            ("a.ply", PLY.replace("0 0 .5", "0 nan .5"), "vertex 0 has a place that is not finite"),
            ("a.ply", PLY.replace("float x", "float u"), "no x"),
            ("a.ply", PLY.replace("ascii", "utf-8"), "utf-8"),
            ("a.ply", PLY[..60].to_owned(), "end_header"),
            ("a.obj", "v 0 0 0\nf 1 2\n".to_owned(), "no triangle"),
            ("a.obj", "v 0 0 0\nf 1 2 0\n".to_owned(), "line 2"),
            ("a.obj", "v 0 0\n".to_owned(), "line 1"),
            ("a.stl", "solid a\nendsolid a\n".to_owned(), "no triangle"),
            ("a.stl", "solid a\nfacet\nvertex 0 0 x\n".to_owned(), "line 3"),
            ("a.txt", "a picture".to_owned(), "no mesh"),
        ] {
            let error = refusal(name, bytes.as_bytes());
            assert!(error.contains(reason), "{error}: expected {reason}");
        }
        assert!(load("missing.ply").unwrap_err().to_string().contains("missing.ply"));
    }
}
