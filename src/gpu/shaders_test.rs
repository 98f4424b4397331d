//! Shaders checked without a device: every one parses and validates, and its structs are those of `layout.rs`.

use super::layout::{
    Batch, CellBox, CellTexels, Classify, ControlPoint, Converging, Extent, Frame, LightBox, Lighting, List, Occluders,
    Pack, PageTable, PagedBrick, Present, Rays, Reached, ScalarSums, Scalars, Shade, Sort, Sweep, Tables, Terminate,
    VoxelBox,
};
use super::shaders::{ALL, Shader};

fn parsed(shader: &Shader) -> naga::Module {
    let source = shader.source();
    match naga::front::wgsl::parse_str(&source) {
        Ok(module) => module,
        Err(e) => panic!("{}: {}", shader.name, e.emit_to_string(&source)),
    }
}

#[test]
fn every_shader_validates() {
    for shader in ALL {
        let module = parsed(shader);
        let flags = naga::valid::ValidationFlags::all();
        // Packed f16: wgpu has it wherever WebGPU is whole.
        let capabilities = naga::valid::Capabilities::SHADER_FLOAT16_IN_FLOAT32;
        let result = naga::valid::Validator::new(flags, capabilities).validate(&module);
        if let Err(e) = result {
            panic!("{}: {}", shader.name, e.emit_to_string(&shader.source()));
        }
    }
}

/// Returns the members of a WGSL struct as (name, offset), and its size.
fn reflected(name: &str) -> (Vec<(String, usize)>, usize) {
    for shader in ALL {
        let module = parsed(shader);
        for (_, ty) in module.types.iter() {
            if ty.name.as_deref() == Some(name)
                && let naga::TypeInner::Struct { members, span } = &ty.inner
            {
                let members = members.iter().map(|m| (m.name.clone().unwrap_or_default(), m.offset as usize)).collect();
                return (members, *span as usize);
            }
        }
    }
    panic!("no shader has a struct {name}");
}

#[test]
fn structs_are_laid_out_alike() {
    macro_rules! compare {
        ($($name:ident),*) => {$(
            let (wgsl, size) = reflected(stringify!($name));
            // WGSL has no fields for padding.
            let rust = $name::FIELDS.iter().filter(|(field, _)| !field.starts_with("_pad"));
            let rust: Vec<_> = rust.map(|&(field, offset)| (field.to_owned(), offset)).collect();
            assert_eq!(rust, wgsl, "fields of {}", stringify!($name));
            assert_eq!(size_of::<$name>(), size, "size of {}", stringify!($name));
        )*};
    }
    compare!(Classify, List, VoxelBox, CellBox, ControlPoint, Sort, Batch, Shade, Reached, Present, Terminate);
    compare!(
        Extent, Occluders, PagedBrick, PageTable, Pack, Tables, Scalars, ScalarSums, CellTexels, Rays, Lighting, Frame,
        LightBox, Sweep, Converging
    );
}

#[test]
fn constants_are_those_of_the_host() {
    // (shader, constant, the host's value)
    let expected = [
        ("classify", "EDGE", crate::volume::BRICK_EDGE as u64),
        ("extents", "EDGE", crate::volume::BRICK_EDGE as u64),
        ("gather", "PAGE_BITS", crate::splats::brick::PAGE.ilog2().into()),
        ("page_table", "PER_BRICK", crate::volume::BRICK_EDGE as u64 / u64::from(crate::splats::brick::PAGE)),
        ("cells", "EDGE", crate::volume::BRICK_EDGE as u64),
        ("lit_rows", "ABSENT", super::held_samples::ABSENT.into()),
        ("lit_rows", "NODES", super::cells::NODES as u64),
        ("lit_rows", "TILE_ROWS", super::cells::TILE_ROWS as u64),
        ("lit_rows", "OPEN", super::cells::OPEN as u64),
        ("scan", "RUN", super::scan::RUN),
        ("terminate", "RUN", crate::painters::quads::terminate::RUN),
        ("scan", "WORKGROUP", super::scan::WORKGROUP),
        ("filter", "ENDS", super::shadows::ENDS as u64),
        ("converging", "TABLE_ROWS", crate::lighting::shadow::plan::TABLE[0].into()),
        ("converging", "TABLE_TERMS", crate::lighting::shadow::plan::TABLE[1].into()),
    ];
    for (name, constant, value) in expected {
        let shader = ALL.iter().find(|s| s.name == name).unwrap();
        assert!(
            shader.source().contains(&format!("const {constant}: u32 = {value}u;")),
            "{name}: {constant} is not {value}"
        );
    }
    let planes = format!("const MAX_CLIP_PLANES: u32 = {}u;", crate::camera::clip::Clip::MAX_PLANES);
    assert!(super::shaders::SPLAT.source().contains(&planes), "MAX_CLIP_PLANES");
    for (constant, value) in [("MACROCELL", super::layout::MACROCELL), ("CELL", super::layout::CELL)] {
        assert!(super::shaders::SKIP.source().contains(&format!("const {constant}: i32 = {value};")), "{constant}");
    }
    let max_opacity = crate::transfer::TransferFunction::MAX_OPACITY.to_string();
    assert!(super::shaders::CLASSIFY.source().contains(&max_opacity), "classify: MAX_OPACITY is not {max_opacity}");
}
