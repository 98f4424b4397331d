//! Shaders checked without a device: every one parses and validates, and its structs are those of `layout.rs`.

use std::mem::{offset_of, size_of};

use super::layout::{
    Area, Batch, Classify, ControlPoint, Frame, Lighting, Pack, Present, Rays, Shade, Sort, Terminate,
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

/// Members of a WGSL struct as (name, offset), and its size.
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

/// Compares a Rust struct, its named fields in order, with the WGSL struct of the same name.
macro_rules! same_layout {
    ($t:ident { $($field:ident),* $(,)? }) => {{
        let rust = [$((stringify!($field).to_owned(), offset_of!($t, $field))),*];
        let (wgsl, size) = reflected(stringify!($t));
        assert_eq!(rust.as_slice(), wgsl.as_slice(), "fields of {}", stringify!($t));
        assert_eq!(size_of::<$t>(), size, "size of {}", stringify!($t));
    }};
}

#[test]
fn structs_are_laid_out_alike() {
    same_layout!(Classify {
        dims,
        bricks,
        gradient_x,
        points,
        gradient_y,
        sample_origin,
        gradient_z,
        first_brick,
        gradient_points,
        base,
        faintest
    });
    same_layout!(ControlPoint { color, sample, opacity });
    same_layout!(Sort { blocks, batches, sheets_per_batch });
    same_layout!(Batch { depth, first_sheet });
    same_layout!(Shade { depth, previous, current, gradient_lookup, invisible, lookup, low, high, to_light });
    same_layout!(Area { low, high });
    same_layout!(Present { corner, row });
    same_layout!(Terminate { first, count });
    same_layout!(Pack {
        low,
        first_splat,
        axes,
        rows,
        columns,
        row_texels,
        width,
        first_row,
        row_count,
        scale,
        end_splat,
        planes,
        eye,
        across,
        view_x,
        view_y,
        view_z
    });
    same_layout!(Rays {
        origin,
        step_x,
        step_y,
        shear,
        direction,
        stretch,
        heading,
        density_scale,
        heading_x,
        opaque_depth,
        heading_y,
        radius2,
        middle,
        row_half,
        box_low,
        row_slope,
        box_high,
        samples,
        gradient_x,
        unskipped,
        gradient_y,
        run_slots,
        gradient_z,
        flipped,
        voxels,
        columns,
        footprint_half,
        phases,
        footprint,
        footprint_high,
        slope_origin,
        slope_step,
        invisible,
        lookup,
        size,
        tiles,
        clip_low,
        clip_high,
        pixel_origin,
        pixel_x,
        pixel_y,
        picture,
        brightest,
        row_texels,
        share,
        least_refined,
        fineness,
        eye_plane,
        growth_slope,
        growth_middle,
        growth_most,
        growth_around,
        fade_in,
        fade_out,
        gradient_lookup,
        attenuation,
        to_light,
        to_lattice,
        model,
        sections,
        clip_planes
    });
    same_layout!(Lighting {
        right,
        ambient,
        up,
        diffuse,
        forward,
        specular,
        lights,
        colors,
        from_lattice,
        shininess,
        faintest
    });
    same_layout!(Frame {
        lattice_center,
        radius,
        view_x,
        offset_x,
        view_y,
        offset_y,
        view_z,
        eye_depth,
        grid_right,
        depth_extent,
        grid_up,
        sheet_origin,
        grid_forward,
        sheet_step,
        pixel_scale,
        pixel_offset,
        clip_scale,
        clip_offset,
        quad_pad,
        section_scale,
        inverse_sheet_scale,
        region,
        sheets,
        inverse_sheet_step,
        plane_axis,
        plane_offset,
        box_half,
        opaque_depth,
        growth,
        home_slope,
        tiles,
        tile_size,
        model,
        clip_planes,
    });
}

#[test]
fn constants_are_those_of_the_host() {
    // (shader, constant, the host's value)
    let expected = [
        ("classify", "EDGE", crate::volume::BRICK_EDGE as u64),
        ("scan", "RUN", super::scan::RUN),
        ("terminate", "RUN", crate::painters::quads::terminate::RUN),
        ("scan", "WORKGROUP", super::scan::WORKGROUP),
    ];
    for (name, constant, value) in expected {
        let shader = ALL.iter().find(|s| s.name == name).unwrap();
        assert!(
            shader.source().contains(&format!("const {constant}: u32 = {value}u;")),
            "{name}: {constant} is not {value}"
        );
    }
    let planes = format!("const MAX_CLIP_PLANES: u32 = {}u;", crate::clip::Clip::MAX_PLANES);
    assert!(super::shaders::SPLAT.source().contains(&planes), "MAX_CLIP_PLANES");
    for (constant, value) in [("MARGIN", super::layout::MARGIN), ("MACROCELL", super::layout::MACROCELL)] {
        assert!(super::shaders::SKIP.source().contains(&format!("const {constant}: i32 = {value};")), "{constant}");
    }
    let max_opacity = crate::transfer::TransferFunction::MAX_OPACITY.to_string();
    assert!(super::shaders::CLASSIFY.source().contains(&max_opacity), "classify: MAX_OPACITY is not {max_opacity}");
}
