//! Names that state a lattice, as the open volume collections write them: `aneurism_256x256x128_uint8.raw`.

use std::path::Path;

use crate::volume::SampleType;

/// The number of samples along x, y and z, and their type; `None` if a name states none.
pub(super) fn stated(path: &Path) -> Option<([u32; 3], SampleType)> {
    let name = path.file_name()?.to_str()?.to_ascii_lowercase();
    let name = name.strip_suffix(".gz").or_else(|| name.strip_suffix(".bz2")).unwrap_or(&name);
    let (rest, sample_type) = name.strip_suffix(".raw")?.rsplit_once('_')?;
    let sizes = rest.rsplit('_').next()?.split('x').map(str::parse);
    let sizes: Vec<u32> = sizes.collect::<Result<_, _>>().ok()?;
    Some((sizes.try_into().ok()?, SampleType::from_name(sample_type)?))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_lattice_is_two_words_of_a_name() {
        let stated = |name: &str| stated(Path::new(name));
        assert_eq!(stated("volumes/aneurism_256x255x128_uint8.raw"), Some(([256, 255, 128], SampleType::U8)));
        assert_eq!(stated("a_b_4x3x2_float32.raw.gz"), Some(([4, 3, 2], SampleType::F32)));
        assert_eq!(stated("4x3x2_int16.RAW"), Some(([4, 3, 2], SampleType::I16)));
        for name in ["a_4x3_uint8.raw", "a_4x3x2x1_uint8.raw", "a_4x3x2_rgb.raw", "a_4x3x2.raw", "a_4x3x2_uint8.bin"] {
            assert_eq!(stated(name), None, "{name}");
        }
    }
}
