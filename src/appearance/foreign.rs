//! Words of other programs, with the option of the command and the keyword of the Python package for each.

/// Words of other programs and of earlier versions; the text that names options of the command; the text that names
/// keywords of the Python package. An empty text: there is no such option. The programs are VTK, pyvista and ParaView,
/// matplotlib, 3D Slicer, niivue, MRIcroGL, napari, Blender, ffmpeg and ImageMagick.
const FOREIGN: [[&str; 3]; 44] = [
    [
        "preset tf transfer-function opacity-transfer-function lut opacity alpha alpha-coef color-transfer-function",
        "--transfer PRESET or FILE",
        "transfer=PRESET, FILE or points (VALUE, COLOUR, OPACITY)",
    ],
    [
        "colour-map color-map colormap colourmap cmap palette clut color-preset colorscale colors",
        "--transfer map:NAME",
        "transfer=\"map:NAME\"",
    ],
    [
        "isovalue isosurface contour contours surface",
        "--iso VALUE[:COLOUR[:OPACITY]]",
        "iso=VALUE or [(VALUE, COLOUR, OPACITY), ..]",
    ],
    [
        "threshold cal-min cal-max clim vmin vmax color-range range min max",
        "--window LEVEL,WIDTH, from LEVEL - WIDTH/2 to LEVEL + WIDTH/2",
        "window=(LEVEL, WIDTH), from LEVEL - WIDTH/2 to LEVEL + WIDTH/2",
    ],
    ["level-width ww wl wc contrast contrast-limits brightness", "--window LEVEL,WIDTH", "window=(LEVEL, WIDTH)"],
    [
        "slice slices slab cut cutplane clip-plane-depth section slice-type mosaic orthoslice",
        "voxsplat slice draws sections, --plane draws one in the volume, --clip cuts the volume",
        "voxsplat.slices draws sections, planes= draws them in the volume, clip= cuts the volume",
    ],
    [
        "crop roi bounds extract subset voi",
        "--clip voxels:I0:I1,J0:J1,K0:K1 keeps voxels",
        "clip=\"voxels:I0:I1,J0:J1,K0:K1\" keeps voxels",
    ],
    [
        "clip-box",
        "--clip box:X0,X1,Y0,Y1,Z0,Z1 keeps a box of the world",
        "clip=\"box:X0,X1,Y0,Y1,Z0,Z1\" keeps a box of the world",
    ],
    [
        "voxel-size voxelsize pixel-size pixel-spacing pixdim zooms sampling",
        "--spacing X,Y,Z",
        "spacing=(Z, Y, X), as the shape",
    ],
    ["length-unit", "--units length=UNIT", "units={\"length\": UNIT}"],
    ["value-unit", "--units value=UNIT", "units={\"value\": UNIT}"],
    [
        "label-opacity",
        "--label all:xF multiplies the opacities of labels",
        "label={\"all\": \"xF\"} multiplies the opacities of labels",
    ],
    ["footprint-table", "the option is removed; --tune table-error=E sets the accuracy of the table", ""],
    ["sheets-per-pass", "the option is removed; the adapter's best number is used", ""],
    [
        "view camera camera-position cpos rotate rotation rotate-camera orientation angle side",
        "--azimuth and --elevation turn the view, --direction X,Y,Z sets it",
        "azimuth= and elevation= turn the view, direction=(X, Y, Z) sets it",
    ],
    ["pitch tilt elev", "--elevation DEG raises the eye", "elevation=DEGREES raises the eye"],
    ["yaw azi azim heading", "--azimuth DEG turns the eye", "azimuth=DEGREES turns the eye"],
    ["view-up viewup up-vector", "--up X,Y,Z", "up=(X, Y, Z)"],
    [
        "focal-point center centre look-at lookat focus",
        "--target X,Y,Z is the middle of the picture",
        "target=(X, Y, Z) is the middle of the picture",
    ],
    [
        "parallel parallel-projection ortho perspective",
        "--projection orthographic or perspective",
        "projection=\"orthographic\" or \"perspective\"",
    ],
    [
        "field-of-view view-angle focal-length lens",
        "--fov DEG with --projection perspective",
        "fov=DEGREES with projection=\"perspective\"",
    ],
    [
        "parallel-scale scale magnification",
        "--zoom F magnifies, --view-height LENGTH sets the world height",
        "zoom=FACTOR magnifies, view_height=LENGTH sets the world height",
    ],
    [
        "resolution-xy width height image-size image-resolution geometry pixels window-size figsize dpi",
        "--size WxH, in pixels",
        "size=(WIDTH, HEIGHT), in pixels",
    ],
    ["bg background-colour back-color bgcolor clear-color", "--background COLOUR", "background=COLOUR"],
    [
        "out save save-bmp savebmp screenshot file filename o",
        "-o FILE is the picture",
        "image.save(FILE) writes the picture",
    ],
    [
        "blend blend-mode blending render-mode rendering mode volume-mapper technique projection-mode",
        "--model composite, xray, mip, minip or average",
        "model=\"composite\", \"xray\", \"mip\", \"minip\" or \"average\"",
    ],
    ["mip maximum maximum-intensity max-intensity", "--model mip", "model=\"mip\""],
    [
        "shade shader lighting illumination headlight",
        "--light studio, headlight, AZ,EL or @X,Y,Z",
        "light=\"studio\", \"headlight\", (AZIMUTH, ELEVATION) or \"@X,Y,Z\"",
    ],
    [
        "ambient diffuse specular specular-power shininess",
        "--material A,D,S,N of lit surfaces",
        "material=(AMBIENT, DIFFUSE, SPECULAR, SHININESS) of lit surfaces",
    ],
    ["ambient-occlusion ao ssao", "--occlusion RADIUS", "occlusion=RADIUS"],
    [
        "sample-distance step step-size samples quality lod",
        "--max-error E sets the accuracy",
        "shading=\"post\" is sharper",
    ],
    [
        "interpolation interpolate filter smooth linear",
        "--kernel and --sharpness reconstruct",
        "kernel= and sharpness= reconstruct",
    ],
    ["fps framerate frame-rate r", "--rate N, frames a second", ""],
    [
        "stat-map statmap activation fusion zmap layer",
        "--overlay FILE[:TRANSFER][@LO..HI]",
        "overlays=VOLUME or (VOLUME, LOOK, (LOW, HIGH))",
    ],
    ["stl ply obj polydata", "--mesh FILE[:COLOUR]", "meshes=MESH or (MESH, COLOUR)"],
    ["depth-buffer zbuffer z-buffer", "--depth FILE.exr", "depth=DEPTHS"],
    ["segmentation seg atlas labelmap label-map", "--labels FILE, --mask FILE", "labels=LABELS, mask=MASK"],
    ["colorbar scalar-bar scalarbar show-colorbar show-scalar-bar", "--colour-bar", ""],
    ["mesh overlay", "", "meshes= and overlays= take one or a list"],
    ["background-color bg-color", "", "background=COLOUR"],
    ["clip-plane", "", "clip=\"NX,NY,NZ[,D]\""],
    ["axis-order order", "", "axes=\"xyz\" or \"zyx\""],
    ["translate translation", "", "origin=(X, Y, Z)"],
    ["tune", "", "its knobs are options, such as termination="],
];

/// A row of the table of words of other programs.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ForeignWords {
    /// The words, in lower case with `-` between parts, parted by spaces.
    pub words: &'static str,
    /// The text that names options of the command; empty if it has none.
    pub option: &'static str,
    /// The text that names keywords of the Python package; empty if it has none.
    pub keyword: &'static str,
}

impl ForeignWords {
    /// Returns all rows. A word is in one of them.
    pub fn all() -> impl Iterator<Item = Self> {
        FOREIGN.into_iter().map(|[words, option, keyword]| Self { words, option, keyword })
    }

    /// Returns the row of a word in any case, with `_` or `-` between its parts.
    #[must_use]
    pub fn of(word: &str) -> Option<Self> {
        let word = word.to_lowercase().replace('_', "-");
        Self::all().find(|row| row.words.split(' ').any(|other| other == word))
    }
}
