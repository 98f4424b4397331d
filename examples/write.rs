//! A built-in volume as a MetaImage file, which VTK, ITK and F3D read:
//! `cargo run --release --example write -- [demo:NAME[:SIZE] [FILE.mha]]`

use std::io::Write;

use voxsplat::load;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut arguments = std::env::args().skip(1);
    let source = arguments.next().unwrap_or_else(|| "demo:nautilus".to_owned());
    let file = arguments.next().unwrap_or_else(|| "nautilus.mha".to_owned());

    let volume = load(&source, &Default::default())?;
    let [x, y, z] = volume.grid().dims();
    // The middle of a built-in volume is the origin of the world, and its voxels are 1 apart.
    let [left, front, bottom] = [x, y, z].map(|n| f64::from(n - 1) / -2.0);
    let samples = volume.in_memory()?;
    let mut out = std::io::BufWriter::new(std::fs::File::create(file)?);
    write!(out, "ObjectType = Image\nNDims = 3\nBinaryData = True\nBinaryDataByteOrderMSB = False\n")?;
    write!(out, "Offset = {left} {front} {bottom}\nElementSpacing = 1 1 1\nDimSize = {x} {y} {z}\n")?;
    write!(out, "ElementType = MET_FLOAT\nElementDataFile = LOCAL\n")?;
    for index in 0..samples.samples().len() {
        out.write_all(&(samples.value(index) as f32).to_le_bytes())?;
    }
    Ok(out.flush()?)
}
