// A classified voxel as it is stored: 16 bytes. Lattice indices in 16 bits each, colour in 16-bit unsigned
// normalised channels (step 1.5e-5), density in f32.
struct Splat {
    xy: u32,
    z_red: u32,
    green_blue: u32,
    // Extinction times unit distance, -ln(1 - opacity): a pure number, whatever the unit of length.
    density: f32,
}

fn splat_lattice(s: Splat) -> vec3f {
    return vec3f(f32(s.xy & 0xffffu), f32(s.xy >> 16u), f32(s.z_red & 0xffffu));
}

fn splat_color(s: Splat) -> vec3f {
    return vec3f(f32(s.z_red >> 16u), f32(s.green_blue & 0xffffu), f32(s.green_blue >> 16u)) * (1.0 / 65535.0);
}

// An entry of the sorted list is the index of a splat; its top bit tells that the splat was terminated.
const TERMINATED: u32 = 0x80000000u;

fn is_terminated(entry: u32) -> bool {
    return (entry & TERMINATED) != 0u;
}
