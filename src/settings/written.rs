//! Light and kernels as they are serialised, field by field.

use glam::DVec3;
use serde::{Deserialize, Deserializer, Serialize, Serializer};

use crate::kernel::Kernel;
use crate::lighting::{Light, Lighting, Source};

#[derive(Serialize, Deserialize)]
#[serde(remote = "Kernel")]
pub(super) enum WrittenKernel {
    Gaussian { sigma: f64, radius: f64 },
    KaiserBessel { radius: f64, alpha: f64 },
}

#[derive(Serialize, Deserialize)]
enum WrittenSource {
    Eye,
    Direction(DVec3),
    Point(DVec3),
}

#[derive(Serialize, Deserialize)]
struct WrittenLight {
    source: WrittenSource,
    color: [f64; 3],
    size: f64,
}

#[derive(Serialize, Deserialize)]
struct Written {
    ambient: f64,
    diffuse: f64,
    specular: f64,
    shininess: f64,
    lights: Vec<WrittenLight>,
    shadows: f64,
    shadow_bias: f64,
    occlusion: Option<f64>,
    exact_shadows: bool,
}

pub(super) fn serialize<S: Serializer>(lighting: &Option<Lighting>, serializer: S) -> Result<S::Ok, S::Error> {
    let light = |&Light { source, color, size }: &Light| {
        let source = match source {
            Source::Eye => WrittenSource::Eye,
            Source::Direction(towards) => WrittenSource::Direction(towards),
            Source::Point(place) => WrittenSource::Point(place),
        };
        WrittenLight { source, color, size }
    };
    let written = lighting.as_ref().map(|lighting| {
        let Lighting { ambient, diffuse, specular, shininess, lights, shadows, shadow_bias, occlusion, exact_shadows } =
            lighting;
        Written {
            ambient: *ambient,
            diffuse: *diffuse,
            specular: *specular,
            shininess: *shininess,
            lights: lights.iter().map(light).collect(),
            shadows: *shadows,
            shadow_bias: *shadow_bias,
            occlusion: *occlusion,
            exact_shadows: *exact_shadows,
        }
    });
    written.serialize(serializer)
}

pub(super) fn deserialize<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Option<Lighting>, D::Error> {
    let light = |WrittenLight { source, color, size }| {
        let source = match source {
            WrittenSource::Eye => Source::Eye,
            WrittenSource::Direction(towards) => Source::Direction(towards),
            WrittenSource::Point(place) => Source::Point(place),
        };
        Light { source, color, size }
    };
    let written = Option::<Written>::deserialize(deserializer)?;
    Ok(written.map(|written| Lighting {
        ambient: written.ambient,
        diffuse: written.diffuse,
        specular: written.specular,
        shininess: written.shininess,
        lights: written.lights.into_iter().map(light).collect(),
        shadows: written.shadows,
        shadow_bias: written.shadow_bias,
        occlusion: written.occlusion,
        exact_shadows: written.exact_shadows,
    }))
}
