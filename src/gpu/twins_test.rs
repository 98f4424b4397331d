//! The CPU twins of the GPU's stages, on the same structs: the expected result of each stage, written the plain way.

use glam::{DVec2, DVec3};

use super::layout::{Frame, Splat};
use super::splat::SplatLight;
use crate::kernel::FootprintTable;
use crate::splats::words::NO_NORMAL;
use crate::transfer::TransferFunction;
use crate::volume::{BRICK_EDGE, Volume};

/// A classified voxel.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Voxel {
    pub(crate) point: [u32; 3],
    pub(crate) color: [f64; 3],
    /// Extinction times unit distance of the voxel.
    pub(crate) density: f64,
}

/// Classifies, as the stage classify: returns every voxel of some opacity, brick by brick, in lattice order inside
/// each.
pub(crate) fn classify(volume: &Volume, transfer: &TransferFunction) -> Vec<Voxel> {
    let memory = volume.in_memory().unwrap();
    let [nx, ny, nz] = volume.grid().dims();
    let bricks = |n: u32| (0..n).step_by(BRICK_EDGE);
    let inside = |at: u32, n: u32| at..n.min(at + BRICK_EDGE as u32);
    let origins = bricks(nz).flat_map(|z| bricks(ny).flat_map(move |y| bricks(nx).map(move |x| [x, y, z])));
    let points = origins.flat_map(|[x, y, z]| {
        let row = move |y, z| inside(x, nx).map(move |x| [x, y, z]);
        inside(z, nz).flat_map(move |z| inside(y, ny).flat_map(move |y| row(y, z)))
    });
    points
        .filter_map(|point @ [x, y, z]| {
            let index = (x + nx * (y + ny * z)) as usize;
            let (color, opacity) = transfer.sample(memory.value(index));
            (opacity > 0.0).then(|| Voxel { point, color, density: TransferFunction::extinction(opacity, 1.0) })
        })
        .collect()
}

/// Unpacks the words of a splat as the shaders do; `origins` belong to the bricks of its store.
pub(crate) fn unpack(splat: &Splat, origins: &[[u32; 3]]) -> Voxel {
    let [x, y, z] = origins[(splat.place >> 15) as usize];
    let part = |shift: u32| splat.place >> shift & 31;
    let blue = splat.color >> 27 | (splat.density_blue & 0xff) << 5;
    let color = [splat.color & 0x1fff, splat.color >> 13 & 0x3fff, blue].map(f64::from);
    Voxel {
        point: [x + part(0), y + part(5), z + part(10)],
        color: [color[0] / 8191.0, color[1] / 16383.0, color[2] / 8191.0],
        density: f64::from(f32::from_bits(splat.density_blue & 0xffff_ff00)),
    }
}

/// Returns the colour of a splat at a lattice point with all light, as lit_splat.wgsl.
pub(crate) fn lit(light: &SplatLight, color: [f64; 3], normal: u32, point: [u32; 3]) -> [f64; 3] {
    let SplatLight { lighting, lights, to_eye, .. } = light;
    let at = DVec3::from_array(point.map(f64::from));
    let [x, y, z] = to_eye.view.map(v3);
    let from_eye = at - v3(to_eye.eye);
    let towards = -(x * from_eye.x + y * from_eye.y + z * from_eye.z);
    let eye = if to_eye.perspective { towards.normalize() } else { DVec3::NEG_Z };
    if normal == NO_NORMAL {
        return color;
    }
    // Octahedral coordinates of 16 bits.
    let [px, py] = [normal << 16, normal].map(|bits| (f64::from(bits as i32 >> 16) / 32767.0).max(-1.0));
    let sign = |v: f64| if v >= 0.0 { 1.0 } else { -1.0 };
    let pz = 1.0 - px.abs() - py.abs();
    let folded = DVec3::new((1.0 - py.abs()) * sign(px), (1.0 - px.abs()) * sign(py), pz);
    let direction = if pz >= 0.0 { DVec3::new(px, py, pz) } else { folded };
    let across = [lighting.right, lighting.up, lighting.forward].map(|axis| v3(axis).dot(direction));
    let gradient = DVec3::from_array(across).normalize_or_zero();
    let facing = if gradient.dot(eye) < 0.0 { -gradient } else { gradient };
    let (mut diffuse, mut specular) = (DVec3::ZERO, DVec3::ZERO);
    for (&[x, y, z, w], intensity) in lighting.lights[..*lights as usize].iter().zip(&lighting.colors) {
        let place = v3([x, y, z]);
        let [along_x, along_y, along_z, origin] =
            lighting.from_lattice.map(|column| v3([column[0], column[1], column[2]]));
        let way = place - (along_x * at.x + along_y * at.y + along_z * at.z + origin);
        let towards = match (w > 0.0, place == DVec3::ZERO) {
            (true, _) => way.try_normalize().unwrap_or(eye),
            (_, true) => eye,
            _ => place,
        };
        let cosine = facing.dot(towards);
        if cosine > 0.0 {
            let intensity = v3([intensity[0], intensity[1], intensity[2]]);
            diffuse += intensity * cosine;
            specular += intensity * facing.dot((eye + towards).normalize_or_zero()).powf(f64::from(lighting.shininess));
        }
    }
    let [ambient, of_diffuse, of_specular] = [lighting.ambient, lighting.diffuse, lighting.specular].map(f64::from);
    [0, 1, 2].map(|c| (color[c] * (ambient + of_diffuse * diffuse[c]) + of_specular * specular[c]).clamp(0.0, 1.0))
}

/// Returns exclusive prefix sums, as the stage scan.
pub(crate) fn scan(values: &[u32]) -> Vec<u32> {
    values
        .iter()
        .scan(0_u32, |sum, v| {
            let before = *sum;
            *sum += v;
            Some(before)
        })
        .collect()
}

fn v3(v: [f32; 3]) -> DVec3 {
    DVec3::from_array(v.map(f64::from))
}

fn lattice(frame: &Frame, splat: &Voxel) -> DVec3 {
    DVec3::from_array(splat.point.map(f64::from)) - v3(frame.lattice_center)
}

/// The variant of compositing in which splats go into sheets.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(crate) struct Mode {
    pub(crate) perspective: bool,
    pub(crate) axis: bool,
    pub(crate) additive: bool,
}

/// Returns the growth of the kernel of a splat at view depth `z`.
fn growth(frame: &Frame, z: f64) -> f64 {
    (f64::from(frame.growth[0]) + f64::from(frame.growth[1]) * z).max(1.0)
}

/// Returns the voxel plane of a splat, front to back.
fn plane(frame: &Frame, splat: &Voxel) -> u32 {
    let p = lattice(frame, splat) + v3(frame.lattice_center);
    (v3(frame.plane_axis).dot(p) + f64::from(frame.plane_offset)).round() as u32
}

/// Returns the splats of each batch of `sheets_per_batch` sheets, in their order, as the stage sort.
pub(crate) fn sort(frame: &Frame, splats: &[Voxel], mode: Mode, sheets_per_batch: u32) -> Vec<Vec<u32>> {
    let batches = frame.sheets.div_ceil(sheets_per_batch);
    let mut sorted = vec![Vec::new(); batches as usize];
    for (index, splat) in (0..).zip(splats) {
        // In f32 and in the order of the shader: a reach that ends on a plane falls to the same side.
        let p = lattice(frame, splat).as_vec3();
        let z = frame.view_z[0] * p.x + frame.view_z[1] * p.y + frame.view_z[2] * p.z;
        let extent = frame.depth_extent * (frame.growth[0] + frame.growth[1] * z).max(1.0);
        let cut = |z: f32| ((z - frame.sheet_origin) * frame.inverse_sheet_step).floor();
        let (first, last) = (cut(z - extent), cut(z + extent));
        if mode.axis {
            if last >= 0.0 {
                sorted[(plane(frame, splat) / sheets_per_batch) as usize].push(index);
            }
            continue;
        }
        if last < 0.0 || first >= frame.sheets as f32 {
            continue;
        }
        let last = (last as u32).min(frame.sheets - 1);
        for batch in first.max(0.0) as u32 / sheets_per_batch..=last / sheets_per_batch {
            sorted[batch as usize].push(index);
        }
    }
    sorted
}

/// Returns the sums of each sheet of a pixel, as the stage splat: (colour, 1) times optical depth or opacity. `round`
/// rounds a sum to the sheet's format.
pub(crate) fn splat(
    frame: &Frame,
    table: &FootprintTable,
    splats: &[Voxel],
    pixel: DVec2,
    mode: Mode,
    round: impl Fn(f64) -> f64,
) -> Vec<[f64; 4]> {
    let mut sheets = vec![[0.0; 4]; frame.sheets as usize];
    let f2 = |v: [f32; 2]| DVec2::from_array(v.map(f64::from));
    let at = pixel * f2(frame.pixel_scale) + f2(frame.pixel_offset);
    let slope = at + f2(frame.home_slope);
    let (right, up, forward) = (v3(frame.grid_right), v3(frame.grid_up), v3(frame.grid_forward));
    let step = f64::from(frame.sheet_step);
    for s in splats {
        let p = lattice(frame, s);
        let center = DVec3::new(
            v3(frame.view_x).dot(p) + f64::from(frame.offset_x),
            v3(frame.view_y).dot(p) + f64::from(frame.offset_y),
            v3(frame.view_z).dot(p),
        );
        let growth = growth(frame, center.z);
        let (ray, offset, length) = if mode.perspective {
            let depth = center.z + f64::from(frame.eye_depth);
            (forward + right * at.x + up * at.y, at * depth - center.truncate(), (1.0 + slope.length_squared()).sqrt())
        } else {
            (forward, at - center.truncate(), 1.0)
        };
        // The grown kernel is the kernel in a lattice as much wider.
        let (ray, q) = (ray / growth, (right * offset.x + up * offset.y) / growth);
        let per_depth = ray.length();
        let along = q.dot(ray) / per_depth;
        let r2 = q.length_squared() - along * along;
        let density = s.density;
        let weight = if mode.additive { -(-density).exp_m1() } else { density };
        let scale = weight * f64::from(frame.section_scale) / growth.powi(3) * length / per_depth;
        let t = |z: f64| (z - center.z) * per_depth + along;
        let origin = f64::from(frame.sheet_origin);
        let section = |from: f64, to: f64| scale * table.section(f64::from(frame.radius), r2, t(from), t(to));
        for (k, sheet) in (0_u32..).zip(&mut sheets) {
            let depth = if !mode.axis {
                section(origin + f64::from(k) * step, origin + f64::from(k + 1) * step)
            } else if k == plane(frame, s) {
                section(origin, f64::INFINITY)
            } else {
                continue;
            };
            for (sum, c) in sheet.iter_mut().zip(s.color.into_iter().chain([1.0])) {
                *sum = round(*sum + c * depth);
            }
        }
    }
    sheets.iter().map(|sheet| sheet.map(|v| v * f64::from(frame.inverse_sheet_scale))).collect()
}

/// Composites sheets front to back to premultiplied RGBA, as the stages composite and resolve.
pub(crate) fn composite(sheets: &[[f64; 4]], additive: bool) -> [f64; 4] {
    let (mut color, mut depth) = (DVec3::ZERO, 0.0_f64);
    for &[r, g, b, sum] in sheets {
        if sum > 0.0 {
            let opacity = if additive { sum.min(1.0) } else { -(-sum).exp_m1() };
            color += DVec3::new(r, g, b) / sum * (-depth).exp() * opacity;
            depth -= (-opacity).ln_1p();
        }
    }
    [color.x, color.y, color.z, -(-depth).exp_m1()]
}
