//! The WGSL of each stage: the stage's own file first, so that error lines are those of the file, then what it shares.

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
const NORMAL: &str = include_str!("../../shaders/common/normal.wgsl");
const RAY: &str = include_str!("../../shaders/common/ray.wgsl");
const ABSORBED: &str = include_str!("../../shaders/common/absorbed.wgsl");
const DISPATCH: &str = include_str!("../../shaders/common/dispatch.wgsl");
const FRAME: &str = include_str!("../../shaders/common/frame.wgsl");
const PACKING: &str = include_str!("../../shaders/common/packing.wgsl");
const RASTER: &str = include_str!("../../shaders/common/raster.wgsl");
const COURSE: &str = include_str!("../../shaders/common/course.wgsl");
const PLANE: &str = include_str!("../../shaders/common/plane.wgsl");
const VECTORS: &str = include_str!("../../shaders/voxels/vectors.wgsl");
const SCALARS: &str = include_str!("../../shaders/voxels/scalars.wgsl");
const TRANSFER: &str = include_str!("../../shaders/common/transfer.wgsl");
const SPLAT: &str = include_str!("../../shaders/common/splat.wgsl");

pub(crate) const CLASSIFY: Shader =
    Shader { name: "classify", parts: &[include_str!("../../shaders/classify.wgsl"), SPLAT, NORMAL, DISPATCH] };
pub(crate) const SCAN: Shader = Shader { name: "scan", parts: &[include_str!("../../shaders/scan.wgsl"), DISPATCH] };
pub(crate) const SORT: Shader =
    Shader { name: "sort", parts: &[include_str!("../../shaders/sort.wgsl"), FRAME, SPLAT, BOUNDS, DISPATCH] };
pub(crate) const SPLATTING: Shader = Shader {
    name: "splat",
    parts: &[include_str!("../../shaders/splat.wgsl"), FRAME, SPLAT, BOUNDS, LIGHTING, NORMAL, ABSORBED],
};
pub(crate) const TERMINATE: Shader = Shader {
    name: "terminate",
    parts: &[include_str!("../../shaders/terminate.wgsl"), FRAME, SPLAT, BOUNDS, DISPATCH],
};
pub(crate) const COMPOSITE: Shader =
    Shader { name: "composite", parts: &[include_str!("../../shaders/composite.wgsl"), FRAME, ABSORBED] };
pub(crate) const SHADE: Shader = Shader {
    name: "shade",
    parts: &[include_str!("../../shaders/shade.wgsl"), FRAME, RAY, TRANSFER, LIGHTING, ABSORBED],
};
pub(crate) const RESOLVE: Shader =
    Shader { name: "resolve", parts: &[include_str!("../../shaders/resolve.wgsl"), FRAME, ABSORBED] };
pub(crate) const PACK: Shader = Shader {
    name: "pack",
    parts: &[include_str!("../../shaders/pack.wgsl"), PACKING, SPLAT, LIGHTING, NORMAL, DISPATCH],
};
pub(crate) const GRADIENTS: Shader =
    Shader { name: "gradients", parts: &[include_str!("../../shaders/gradients.wgsl"), PACKING] };
pub(crate) const SKIP: Shader =
    Shader { name: "skip", parts: &[include_str!("../../shaders/skip.wgsl"), RASTER, PACKING] };
pub(crate) const GATHER: Shader = Shader {
    name: "gather",
    parts: &[include_str!("../../shaders/gather.wgsl"), COURSE, PLANE, VECTORS, RASTER, PACKING, ABSORBED],
};
const SCALAR_RAYS: &str = include_str!("../../shaders/gather_scalars.wgsl");
pub(crate) const GATHER_SCALARS: Shader = Shader {
    name: "gather-scalars",
    parts: &[SCALAR_RAYS, COURSE, PLANE, SCALARS, RASTER, PACKING, TRANSFER, LIGHTING, ABSORBED],
};
pub(crate) const GATHER_GRADIENTS: Shader = Shader {
    name: "gather-gradients",
    parts: &[SCALAR_RAYS, COURSE, PLANE, VECTORS, RASTER, PACKING, TRANSFER, LIGHTING, ABSORBED],
};
pub(crate) const PREFILTER: Shader =
    Shader { name: "prefilter", parts: &[include_str!("../../shaders/prefilter.wgsl")] };
pub(crate) const ENLARGE: Shader =
    Shader { name: "enlarge", parts: &[include_str!("../../shaders/enlarge.wgsl"), RASTER] };
pub(crate) const PRESENT: Shader = Shader { name: "present", parts: &[include_str!("../../shaders/present.wgsl")] };

/// Every shader there is.
#[cfg(test)]
pub(crate) const ALL: [Shader; 17] = [
    CLASSIFY,
    SCAN,
    SORT,
    SPLATTING,
    TERMINATE,
    COMPOSITE,
    SHADE,
    RESOLVE,
    PACK,
    GRADIENTS,
    SKIP,
    GATHER,
    GATHER_SCALARS,
    GATHER_GRADIENTS,
    PREFILTER,
    ENLARGE,
    PRESENT,
];
