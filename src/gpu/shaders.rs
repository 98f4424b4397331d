//! The WGSL of each stage: the stage's own file, then the files that it uses. The stage's file is first so that the
//! line numbers of errors are those of the file.

/// A stage's shader.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Shader {
    /// The stage's name.
    pub name: &'static str,
    /// The stage's file and the files it uses, in that order.
    parts: &'static [&'static str],
}

impl Shader {
    /// The whole source.
    pub(crate) fn source(&self) -> String {
        self.parts.join("\n")
    }
}

const BOUNDS: &str = include_str!("../../shaders/common/bounds.wgsl");
const LIGHTING: &str = include_str!("../../shaders/common/lighting.wgsl");
const FLOOR: &str = include_str!("../../shaders/common/floor.wgsl");
const NORMAL: &str = include_str!("../../shaders/common/normal.wgsl");
const PIXEL_RAY: &str = include_str!("../../shaders/common/pixel_ray.wgsl");
const ABSORBED: &str = include_str!("../../shaders/common/absorbed.wgsl");
const RESPONSE: &str = include_str!("../../shaders/common/response.wgsl");
const DISPATCH: &str = include_str!("../../shaders/common/dispatch.wgsl");
const FRAME: &str = include_str!("../../shaders/common/frame.wgsl");
const CLIP: &str = include_str!("../../shaders/common/clip.wgsl");
const CLIP_VIEW: &str = include_str!("../../shaders/common/clip_view.wgsl");
const PACKING: &str = include_str!("../../shaders/common/packing.wgsl");
const RAYS: &str = include_str!("../../shaders/common/rays.wgsl");
const RAY_GEOMETRY: &str = include_str!("../../shaders/common/ray_geometry.wgsl");
const MARCH_PLANES: &str = include_str!("../../shaders/common/march_planes.wgsl");
const MARCH_PARABOLA: &str = include_str!("../../shaders/common/march_parabola.wgsl");
const LIT_SPLAT: &str = include_str!("../../shaders/common/lit_splat.wgsl");
const PLANE: &str = include_str!("../../shaders/common/plane.wgsl");
const VECTORS: &str = include_str!("../../shaders/voxels/vectors.wgsl");
const SCALARS: &str = include_str!("../../shaders/voxels/scalars.wgsl");
const SCALARS_SOFTWARE: &str = include_str!("../../shaders/voxels/scalars_software.wgsl");
const SCALAR_PAIRS: &str = include_str!("../../shaders/voxels/scalar_pairs.wgsl");
const LIGHT_VOLUME: &str = include_str!("../../shaders/common/light_volume.wgsl");
const TRANSFER: &str = include_str!("../../shaders/common/transfer.wgsl");
const STORED_SPLAT: &str = include_str!("../../shaders/common/splat.wgsl");

pub(crate) const CLASSIFY: Shader = Shader {
    name: "classify",
    parts: &[include_str!("../../shaders/classify.wgsl"), STORED_SPLAT, NORMAL, FLOOR, DISPATCH],
};
pub(crate) const SCAN: Shader = Shader { name: "scan", parts: &[include_str!("../../shaders/scan.wgsl"), DISPATCH] };
pub(crate) const SORT: Shader = Shader {
    name: "sort",
    parts: &[include_str!("../../shaders/sort.wgsl"), FRAME, CLIP, STORED_SPLAT, BOUNDS, DISPATCH],
};
pub(crate) const SPLAT: Shader = Shader {
    name: "splat",
    parts: &[
        include_str!("../../shaders/splat.wgsl"),
        FRAME,
        CLIP,
        CLIP_VIEW,
        STORED_SPLAT,
        BOUNDS,
        LIT_SPLAT,
        LIGHTING,
        NORMAL,
        FLOOR,
        ABSORBED,
    ],
};
pub(crate) const TERMINATE: Shader = Shader {
    name: "terminate",
    parts: &[include_str!("../../shaders/terminate.wgsl"), FRAME, CLIP, STORED_SPLAT, BOUNDS, DISPATCH],
};
pub(crate) const COMPOSITE: Shader =
    Shader { name: "composite", parts: &[include_str!("../../shaders/composite.wgsl"), FRAME, CLIP, ABSORBED] };
pub(crate) const SHADE: Shader = Shader {
    name: "shade",
    parts: &[
        include_str!("../../shaders/shade.wgsl"),
        FRAME,
        CLIP,
        CLIP_VIEW,
        PIXEL_RAY,
        MARCH_PARABOLA,
        TRANSFER,
        LIGHTING,
        FLOOR,
        LIGHT_VOLUME,
        ABSORBED,
    ],
};
pub(crate) const RESOLVE: Shader =
    Shader { name: "resolve", parts: &[include_str!("../../shaders/resolve.wgsl"), FRAME, CLIP, RESPONSE, ABSORBED] };
pub(crate) const PACK: Shader = Shader {
    name: "pack",
    parts: &[
        include_str!("../../shaders/pack.wgsl"),
        PACKING,
        STORED_SPLAT,
        LIT_SPLAT,
        LIGHTING,
        NORMAL,
        FLOOR,
        DISPATCH,
    ],
};
pub(crate) const SKIP: Shader =
    Shader { name: "skip", parts: &[include_str!("../../shaders/skip.wgsl"), RAYS, CLIP, PACKING] };
pub(crate) const GATHER: Shader = Shader {
    name: "gather",
    parts: &[
        include_str!("../../shaders/gather.wgsl"),
        MARCH_PLANES,
        RAY_GEOMETRY,
        PLANE,
        VECTORS,
        RAYS,
        CLIP,
        PACKING,
        RESPONSE,
        ABSORBED,
    ],
};
const GATHER_SCALARS_FILE: &str = include_str!("../../shaders/gather_scalars.wgsl");
pub(crate) const GATHER_SCALARS: Shader = Shader {
    name: "gather-scalars",
    parts: &[
        GATHER_SCALARS_FILE,
        MARCH_PLANES,
        RAY_GEOMETRY,
        PLANE,
        SCALARS,
        SCALAR_PAIRS,
        RAYS,
        CLIP,
        PACKING,
        MARCH_PARABOLA,
        TRANSFER,
        LIGHTING,
        FLOOR,
        LIGHT_VOLUME,
        ABSORBED,
    ],
};
pub(crate) const GATHER_SCALARS_SOFTWARE: Shader = Shader {
    name: "gather-scalars-software",
    parts: &[
        GATHER_SCALARS_FILE,
        MARCH_PLANES,
        RAY_GEOMETRY,
        PLANE,
        SCALARS_SOFTWARE,
        SCALAR_PAIRS,
        RAYS,
        CLIP,
        PACKING,
        MARCH_PARABOLA,
        TRANSFER,
        LIGHTING,
        FLOOR,
        LIGHT_VOLUME,
        ABSORBED,
    ],
};
pub(crate) const GATHER_GRADIENTS: Shader = Shader {
    name: "gather-gradients",
    parts: &[
        GATHER_SCALARS_FILE,
        MARCH_PLANES,
        RAY_GEOMETRY,
        PLANE,
        VECTORS,
        RAYS,
        CLIP,
        PACKING,
        MARCH_PARABOLA,
        TRANSFER,
        LIGHTING,
        FLOOR,
        LIGHT_VOLUME,
        ABSORBED,
    ],
};
pub(crate) const PREFILTER: Shader =
    Shader { name: "prefilter", parts: &[include_str!("../../shaders/prefilter.wgsl")] };
pub(crate) const ESTIMATE: Shader =
    Shader { name: "estimate", parts: &[include_str!("../../shaders/estimate.wgsl"), RAYS, CLIP] };
pub(crate) const RESAMPLE: Shader =
    Shader { name: "resample", parts: &[include_str!("../../shaders/resample.wgsl"), RAYS, CLIP] };
pub(crate) const PRESENT: Shader = Shader { name: "present", parts: &[include_str!("../../shaders/present.wgsl")] };

/// Every shader there is.
#[cfg(test)]
pub(crate) const ALL: [Shader; 18] = [
    CLASSIFY,
    SCAN,
    SORT,
    SPLAT,
    TERMINATE,
    COMPOSITE,
    SHADE,
    RESOLVE,
    PACK,
    SKIP,
    GATHER,
    GATHER_SCALARS,
    GATHER_SCALARS_SOFTWARE,
    GATHER_GRADIENTS,
    PREFILTER,
    ESTIMATE,
    RESAMPLE,
    PRESENT,
];
