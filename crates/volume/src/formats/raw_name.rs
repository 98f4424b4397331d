//! Names that state a lattice, as the open volume collections write them: `aneurism_256x256x128_uint8.raw`, maybe with
//! the order of bytes: `bunny_512x512x361_uint16_be.raw`.

use std::path::Path;

use crate::volume::{Endian, SampleType};

/// The samples that a name states.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Stated {
    /// The number of samples along x, y and z.
    pub(super) dims: [u32; 3],
    pub(super) sample_type: SampleType,
    pub(super) endian: Option<Endian>,
}

/// Returns the name of a file without the extensions of bare samples, in small letters; `None` if it has another
/// extension.
fn stem(path: &Path) -> Option<String> {
    let name = path.file_name()?.to_str()?.to_ascii_lowercase();
    let name = name.strip_suffix(".gz").or_else(|| name.strip_suffix(".bz2")).unwrap_or(&name);
    name.strip_suffix(".raw").map(str::to_owned)
}

/// Returns the samples that a name states; `None` if it states none.
pub(super) fn stated(path: &Path) -> Option<Stated> {
    let stem = stem(path)?;
    let orders = [("_be", Endian::Big), ("_le", Endian::Little)];
    let order = orders.into_iter().find_map(|(suffix, endian)| Some((stem.strip_suffix(suffix)?, Some(endian))));
    let (stem, endian) = order.unwrap_or((&stem, None));
    let (rest, sample_type) = stem.rsplit_once('_')?;
    let sizes = rest.rsplit('_').next()?.split('x').map(str::parse);
    let sizes: Vec<u32> = sizes.collect::<Result<_, _>>().ok()?;
    Some(Stated { dims: sizes.try_into().ok()?, sample_type: SampleType::from_name(sample_type)?, endian })
}

/// Returns three numbers in a name that may be a lattice, such as 64, 64, 32 of `ct_64_64_32.raw`.
pub(super) fn maybe_dims(path: &Path) -> Option<[u32; 3]> {
    let stem = stem(path)?;
    let words: Vec<Option<u32>> = stem.split(['_', '-', 'x', '.']).map(|word| word.parse().ok()).collect();
    words.windows(3).rev().find_map(|three| Some([three[0]?, three[1]?, three[2]?]))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_lattice_is_two_words_of_a_name() {
        let stated =
            |name: &str| stated(Path::new(name)).map(|stated| (stated.dims, stated.sample_type, stated.endian));
        assert_eq!(stated("volumes/aneurism_256x255x128_uint8.raw"), Some(([256, 255, 128], SampleType::U8, None)));
        assert_eq!(stated("a_b_4x3x2_float32.raw.gz"), Some(([4, 3, 2], SampleType::F32, None)));
        assert_eq!(stated("4x3x2_int16.RAW"), Some(([4, 3, 2], SampleType::I16, None)));
        assert_eq!(stated("a_4x3x2_int16_BE.raw"), Some(([4, 3, 2], SampleType::I16, Some(Endian::Big))));
        assert_eq!(stated("a_4x3x2_int16_le.raw"), Some(([4, 3, 2], SampleType::I16, Some(Endian::Little))));
        for name in ["a_4x3_uint8.raw", "a_4x3x2x1_uint8.raw", "a_4x3x2_rgb.raw", "a_4x3x2.raw", "a_4x3x2_uint8.bin"] {
            assert_eq!(stated(name), None, "{name}");
        }
    }

    #[test]
    fn three_numbers_may_be_a_lattice() {
        for (name, dims) in [
            ("ct_64_63_32.raw", Some([64, 63, 32])),
            ("scan-2-64x63x32.raw", Some([64, 63, 32])),
            ("uint8_5.64.63.32.raw.gz", Some([64, 63, 32])),
            ("ct_64_63.raw", None),
            ("ct_64_63_32.dat", None),
        ] {
            assert_eq!(maybe_dims(Path::new(name)), dims, "{name}");
        }
    }
}
