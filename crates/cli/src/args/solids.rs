//! Opaque surfaces in a picture.

use std::path::PathBuf;

use voxsplat::program::PlaneSpec;

use crate::parse;

/// Opaque surfaces in a picture.
#[derive(Debug, clap::Args)]
#[command(next_help_heading = "Solids")]
pub(crate) struct SolidArgs {
    /// Draw a mesh too, opaque: PLY, STL, OBJ or VTP, in the world of the volume
    ///
    /// Matter behind the mesh is cut ray by ray. COLOUR takes the place of the colours of the file [default: ivory].
    /// The mesh has the light and the material of the picture, without shadows. A file that states SPACE=RAS, as 3D
    /// Slicer writes it, is turned to LPS, the world of patients. Repeat the option for several meshes.
    #[arg(long, value_name = "FILE[:COLOUR]")]
    pub(crate) mesh: Vec<PathBuf>,
    /// Draw a plane with the section of the volume on it: axial, coronal, sagittal (or xy, xz, yz), each maybe with a
    /// place along its axis such as axial:12.5; or NX,NY,NZ, NX,NY,NZ,D or NX,NY,NZ,X,Y,Z as --clip
    ///
    /// The plane is unlit, and hides the matter behind it, but is clear where its section is black. Its look is as in
    /// the command slice. Repeat the option for several planes; with --clip a plane fills the cut.
    #[arg(long, value_name = "PLANE", value_parser = parse::library::<PlaneSpec>)]
    pub(crate) plane: Vec<PlaneSpec>,
    /// Hide the matter behind the surfaces of another renderer: an .exr of the size of the picture with a channel of
    /// depths (Z, depth or Depth.V)
    ///
    /// A depth is a distance along the view, from the eye or, along parallel rays, from the plane through --target; a
    /// depth of 1e10 or more is no surface. Channels R, G, B and A are the surfaces' colours, premultiplied. Without
    /// them the picture shows only the matter before the surfaces.
    #[arg(long, value_name = "FILE.exr")]
    pub(crate) depth: Option<PathBuf>,
}
