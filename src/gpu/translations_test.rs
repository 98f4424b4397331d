//! Every shader with the values of any three of its override constants together, as the back ends of wgpu translate it:
//! to SPIR-V for Vulkan, to MSL for Metal and to HLSL for DX12. No device is needed. `spirv-val` judges the SPIR-V if
//! it is installed.

use std::collections::BTreeSet;
use std::io::Write;
use std::process::{Command, Stdio};

use naga::back::{PipelineConstants, hlsl, msl, spv};
use naga::proc::{BoundsCheckPolicies, BoundsCheckPolicy};
use naga::valid::{Capabilities, ModuleInfo, ValidationFlags, Validator};
use naga::{AddressSpace, Binding, ImageClass, Module, ShaderStage, StorageAccess, TypeInner};
use rayon::prelude::*;

use super::shaders::ALL;

/// Returns the possible values of an override constant of a shader. For numbers these are the ends of their range, and
/// values between them that take another path through the shader.
fn values(shader: &str, entry: &str, name: &str) -> &'static [f64] {
    const FLAG: [f64; 2] = [0.0, 1.0];
    match (shader, name) {
        // Post-shaded volumes are gathered as scalars only.
        ("gather", "SCALARS") => &FLAG[..1],
        ("gather", "ONE_WORD") => &FLAG[..1],
        ("gather_scalars", "SCALARS") => &FLAG[1..],
        ("pack-scalar-samples" | "pack-scalar-cells", "GRADIENTS") => &FLAG[..1],
        ("pack-gradient-samples" | "pack-gradient-cells", "GRADIENTS") => &FLAG[1..],
        // Vectors of four lights at most.
        (_, "LIGHTS") => &[0.0, 1.0, 4.0],
        ("classify" | "lit_rows" | "normals", "SAMPLE_TYPE") => &[0.0, 1.0, 2.0, 3.0, 4.0],
        ("cell_rows", "SAMPLE_TYPE") => &[0.0, 3.0, 4.0],
        (name, "SAMPLE_TYPE") if name.contains("samples") => &[0.0, 3.0, 4.0],
        // Texels of a row of the footprint table; a row of voxels.
        ("splat", "TEXELS") => &[1.0, 2.0, 3.0, 4.0],
        (_, "TEXELS") => &[3.0, 7.0],
        (_, "REACH") => &[2.0, 4.0],
        // It follows from REACH.
        (_, "FLUSH") => &[9.0],
        // Layers have an entry point of their own.
        ("gather", "LAYERED") if entry == "layer" => &FLAG[1..],
        (_, "LAYERED") => &FLAG[..1],
        (_, "CLIP_PLANES") => &[0.0, 8.0],
        ("splat", "ROWS") => &[2.0, 4096.0],
        (_, "SHEETS") => &[1.0, 4.0, 8.0],
        ("shade", "SAMPLES") => &[1.0, 2.0, 64.0],
        (_, "TERMS") => &[6.0, 8.0],
        // Every other one is a flag: a number would fail to be one.
        _ => &FLAG,
    }
}

/// A module and the result of its validation.
type Valid = (Module, ModuleInfo);

fn validated(module: Module) -> Result<Valid, String> {
    // Packed f16: wgpu has it wherever WebGPU is whole.
    let mut validator = Validator::new(ValidationFlags::all(), Capabilities::SHADER_FLOAT16_IN_FLOAT32);
    let info = validator.validate(&module).map_err(|e| format!("{e:?}"))?;
    Ok((module, info))
}

/// Returns the part of a shader that one entry point reaches, its override constants without values.
fn reached(module: &Module, entry: usize) -> Module {
    let mut module = module.clone();
    module.entry_points = vec![module.entry_points.swap_remove(entry)];
    naga::compact::compact(&mut module, naga::compact::KeepUnused::No);
    module
}

/// Returns every set of values of the override constants that an entry point uses.
fn sets(shader: &str, entry: &str, module: &Module) -> Vec<PipelineConstants> {
    let names = module.overrides.iter().filter_map(|(_, constant)| constant.name.clone());
    names.fold(vec![PipelineConstants::default()], |sets, name| {
        let with = |set: &PipelineConstants, value: f64| {
            let mut set = set.clone();
            set.insert(name.clone(), value);
            set
        };
        let all = sets.iter().flat_map(|set| values(shader, entry, &name).iter().map(move |&value| with(set, value)));
        all.filter(happens).collect()
    })
}

/// Returns some of the sets, in which the values of any three constants are together if they are in one of all sets.
/// All sets are thousands for a shader with many constants, and a translation fails by few of them.
fn covering(sets: Vec<PipelineConstants>) -> Vec<PipelineConstants> {
    let mut covered = BTreeSet::new();
    let is_new = |set: &PipelineConstants| {
        let mut values: Vec<_> = set.iter().map(|(name, value)| (name.clone(), value.to_bits())).collect();
        values.sort();
        let before = covered.len();
        for (third, c) in values.iter().enumerate() {
            for (second, b) in values[..=third].iter().enumerate() {
                covered.extend(values[..=second].iter().map(|a| [a.clone(), b.clone(), c.clone()]));
            }
        }
        // A set without constants covers nothing.
        values.is_empty() || covered.len() > before
    };
    sets.into_iter().filter(is_new).collect()
}

/// Returns whether the constants of a set go together: only composites are lit, only lit pictures have gradients, and
/// only an extreme has a depth.
fn happens(set: &PipelineConstants) -> bool {
    let is = |name: &str| set.get(name).map(|&value| value != 0.0);
    let lit = is("LIGHTS");
    let of_scalars = is("MAXIMUM").is_some() || is("SAMPLES").is_some();
    let of_light = ["GRADIENT_OPACITY", "SHADOWS"].map(is).contains(&Some(true));
    let projects = ["MAXIMUM", "MEAN", "DEPTH_CODED"].map(is).contains(&Some(true));
    // What cuts does not depend on how many numbers a loop before or behind it takes.
    let number = |name: &str, among: &[f64]| set.get(name).is_some_and(|value| among.contains(value));
    let other = number("TERMS", &[6.0]) || number("TEXELS", &[1.0, 3.0, 4.0]) || number("SAMPLES", &[1.0, 2.0]);
    let never = [
        is("CLIP_PLANES") == Some(true) && other,
        of_scalars && of_light && lit == Some(false),
        projects && lit == Some(true),
        is("MEAN") == Some(true) && is("MAXIMUM") == Some(true),
        is("DEPTH_CODED") == Some(true) && is("MAXIMUM") == Some(false),
        is("ATTENUATED") == Some(true) && (is("MAXIMUM") == Some(false) || is("MEAN") == Some(true)),
        // What clipping planes or solids cut; others translate alike.
        is("CUT").is_some_and(|cut| cut == (is("CLIP_PLANES") != Some(true) && is("SOLIDS") != Some(true))),
        is("SOLIDS") == Some(true) && (is("CLIP_PLANES") == Some(true) || other),
        is("HALF_DEPTH") == Some(true) && (other || projects || is("BRICK") == Some(true)),
        // Only what is lit has normals. Neither normals nor classification depend on how samples are stored.
        is("TENSOR") == Some(true) && (is("LIT") == Some(false) || number("SAMPLE_TYPE", &[1.0, 2.0, 3.0])),
        is("BAND_LIMITED") == Some(true) && number("SAMPLE_TYPE", &[1.0, 2.0, 3.0]),
        // With or without, of four lights: others translate alike.
        is("POINT_LIGHTS") == Some(true) && set.get("LIGHTS").is_some_and(|&lights| lights != 4.0),
    ];
    !never.contains(&true)
}

/// Translates an entry point to words of SPIR-V and to the text of MSL and HLSL, with the checks of indices that wgpu
/// requests. Returns the words.
fn translated((module, info): &Valid, stage: ShaderStage, entry: &str) -> Result<Vec<u32>, String> {
    let restrict = BoundsCheckPolicy::Restrict;
    let bounds = BoundsCheckPolicies { index: restrict, buffer: restrict, image_load: restrict, ..Default::default() };

    // Vulkan 1.1, the oldest that has drivers.
    let options = spv::Options { lang_version: (1, 3), bounds_check_policies: bounds, ..Default::default() };
    let pipeline = spv::PipelineOptions { shader_stage: stage, entry_point: entry.to_owned() };
    let words = spv::write_vec(module, info, &options, Some(&pipeline)).map_err(|e| format!("SPIR-V: {e}"))?;

    let options = msl::Options { lang_version: (2, 0), bounds_check_policies: bounds, ..Default::default() };
    let pipeline = msl::PipelineOptions { entry_point: Some((stage, entry.to_owned())), ..Default::default() };
    let (_, result) = msl::write_string(module, info, &options, &pipeline).map_err(|e| format!("MSL: {e}"))?;
    if let Some(Err(e)) = result.entry_point_names.first() {
        return Err(format!("MSL: {e}"));
    }

    // Shader model 5.1 is what the compiler that comes with Windows takes.
    for shader_model in [hlsl::ShaderModel::V5_1, hlsl::ShaderModel::V6_0] {
        let options = hlsl::Options { shader_model, ..Default::default() };
        let pipeline = hlsl::PipelineOptions { entry_point: Some((stage, entry.to_owned())) };
        let mut text = String::new();
        let mut writer = hlsl::Writer::new(&mut text, &options, &pipeline);
        let result = writer.write(module, info, None).map_err(|e| format!("HLSL: {e}"))?;
        if let Some(Err(e)) = result.entry_point_names.first() {
            return Err(format!("HLSL: {e}"));
        }
    }
    Ok(words)
}

/// Returns whether `spirv-val` can be run.
fn has_spirv_val() -> bool {
    Command::new("spirv-val").arg("--version").stdout(Stdio::null()).stderr(Stdio::null()).status().is_ok()
}

/// Refuses words of SPIR-V with the complaints of `spirv-val`.
fn judged(words: &[u32]) -> Result<(), String> {
    let mut file = tempfile::NamedTempFile::new().map_err(|e| e.to_string())?;
    file.write_all(bytemuck::cast_slice(words)).map_err(|e| e.to_string())?;
    let output = Command::new("spirv-val").args(["--target-env", "vulkan1.1"]).arg(file.path()).output();
    let output = output.map_err(|e| e.to_string())?;
    if output.status.success() { Ok(()) } else { Err(String::from_utf8_lossy(&output.stderr).into_owned()) }
}

#[test]
fn every_entry_point_is_translated() {
    translate(1, 55);
}

#[test]
#[ignore = "slow: many sets of override constants in three languages"]
fn every_shader_with_every_three_overrides_is_translated() {
    translate(usize::MAX, 200);
}

/// Translates every entry point with at most `most` sets of its override constants, `least` translations in all.
fn translate(most: usize, least: usize) {
    let judge = has_spirv_val();
    let mut jobs = Vec::new();
    for shader in ALL {
        let source = shader.source();
        let module = naga::front::wgsl::parse_str(&source).unwrap_or_else(|e| panic!("{}: {e}", shader.name));
        for entry in 0..module.entry_points.len() {
            let reached = reached(&module, entry);
            let sets = covering(sets(shader.name, &module.entry_points[entry].name, &reached));
            jobs.extend(sets.into_iter().take(most).map(|set| (shader.name, reached.clone(), set)));
        }
    }
    let failures: Vec<String> = jobs
        .par_iter()
        .filter_map(|(shader, module, set)| {
            let (stage, entry) = (module.entry_points[0].stage, module.entry_points[0].name.as_str());
            let run = || {
                let (module, info) = validated(module.clone())?;
                let (module, _) =
                    naga::back::pipeline_constants::process_overrides(&module, &info, Some((stage, entry)), set)
                        .map_err(|e| e.to_string())?;
                let words = translated(&validated(module.into_owned())?, stage, entry)?;
                if judge { judged(&words) } else { Ok(()) }
            };
            run().err().map(|e| format!("{shader}, {entry}, {set:?}: {e}"))
        })
        .collect();
    println!("{} sets, {}", jobs.len(), if judge { "judged by spirv-val" } else { "without spirv-val" });
    assert!(jobs.len() > least, "{} sets of override constants", jobs.len());
    assert!(failures.is_empty(), "{} of {} fail:\n{}", failures.len(), jobs.len(), failures.join("\n"));
}

/// The limits are those of a device without any feature (WebGPU, "Limits", the default of each).
#[test]
fn every_entry_point_keeps_to_the_limits_of_webgpu() {
    for shader in ALL {
        let source = shader.source();
        let module = naga::front::wgsl::parse_str(&source).unwrap_or_else(|e| panic!("{}: {e}", shader.name));
        for entry in 0..module.entry_points.len() {
            let module = reached(&module, entry);
            let point = &module.entry_points[0];
            let at = format!("{}, {}", shader.name, point.name);
            let count = |kind: &dyn Fn(AddressSpace, &TypeInner) -> bool| {
                let inner = |v: &naga::GlobalVariable| kind(v.space, &module.types[v.ty].inner);
                module.global_variables.iter().filter(|(_, v)| inner(v)).count()
            };
            let storage = |space, _: &TypeInner| matches!(space, AddressSpace::Storage { .. });
            assert!(count(&storage) <= 8, "{at}: {} storage buffers", count(&storage));
            let stored = |_, ty: &TypeInner| matches!(ty, TypeInner::Image { class: ImageClass::Storage { .. }, .. });
            assert!(count(&stored) <= 4, "{at}: {} storage textures", count(&stored));
            assert!(count(&|space, _| space == AddressSpace::Uniform) <= 12, "{at}: uniform buffers");
            // Pipelines are made without clearing workgroup memory: these write all of theirs before they read it.
            let clears = ["skip", "lit_rows", "extents_of_bricks"].contains(&point.name.as_str());
            let shared = |space, _: &TypeInner| space == AddressSpace::WorkGroup;
            assert!(clears || count(&shared) == 0, "{at}: workgroup memory is not cleared");
            let of = |v: &naga::GlobalVariable| module.types[v.ty].inner.size(module.to_ctx());
            let shares = module.global_variables.iter().filter(|(_, v)| v.space == AddressSpace::WorkGroup);
            let bytes: u32 = shares.map(|(_, v)| of(v)).sum();
            assert!(bytes <= 16_384, "{at}: {bytes} bytes of workgroup memory");
            for (_, variable) in module.global_variables.iter() {
                // WebGPU: 65 536 bytes of uniforms; wgpu's floor for old GPUs: 16 384.
                let bytes = of(variable);
                assert!(variable.space != AddressSpace::Uniform || bytes <= 16_384, "{at}: {bytes} bytes of uniforms");
                // One binding both written and read is more than drivers of some GPUs can do with textures.
                if let TypeInner::Image { class: ImageClass::Storage { access, .. }, .. } =
                    &module.types[variable.ty].inner
                {
                    let one_way = [StorageAccess::LOAD, StorageAccess::STORE].contains(access);
                    assert!(one_way, "{at}: a texture is read and written");
                }
            }
            let bindings: BTreeSet<_> =
                module.global_variables.iter().filter_map(|(_, v)| v.binding.map(|b| (b.group, b.binding))).collect();
            let bound = module.global_variables.iter().filter(|(_, v)| v.binding.is_some()).count();
            assert_eq!(bindings.len(), bound, "{at}: two variables at one binding");
            if point.stage == ShaderStage::Compute {
                let [x, y, z] = point.workgroup_size;
                assert!(x * y * z <= 256 && x.max(y) <= 256 && z <= 64, "{at}: workgroups of {x} x {y} x {z}");
            }
            let places = |ty, binding: &Option<Binding>| locations(&module, ty, binding.as_ref());
            let returned = point.function.result.iter().flat_map(|r| places(r.ty, &r.binding)).max();
            let given = point.function.arguments.iter().flat_map(|a| places(a.ty, &a.binding)).max();
            // Colour targets, or what goes from vertex to fragment.
            let most = if point.stage == ShaderStage::Fragment { 8 } else { 16 };
            assert!(returned.is_none_or(|location| location < most), "{at}: writes location {returned:?}");
            assert!(given.is_none_or(|location| location < 16), "{at}: reads location {given:?}");
            // The layers of a batch of sheets: one a sheet, or one for four sheets of scalars.
            let layers = match point.name.as_str() {
                "feed_depth" | "feed_1" | "scalars_4" => 1,
                "scalars_8" => 2,
                "feed_4" => 4,
                "feed_8" => 8,
                _ => continue,
            };
            assert_eq!(returned, Some(layers - 1), "{at}: does not fill its targets");
        }
    }
}

/// Returns the locations of the inputs or the outputs of an entry point.
fn locations(module: &Module, ty: naga::Handle<naga::Type>, binding: Option<&Binding>) -> Vec<u32> {
    match (&module.types[ty].inner, binding) {
        (TypeInner::Struct { members, .. }, _) => {
            members.iter().flat_map(|m| locations(module, m.ty, m.binding.as_ref())).collect()
        }
        (_, Some(Binding::Location { location, .. })) => vec![*location],
        _ => Vec::new(),
    }
}
