//! Files written by nibabel, pynrrd, SimpleITK and NumPy (tests/data/volumes/make.py), and broken ones.

use std::path::{Path, PathBuf};

use glam::{DAffine3, DMat3, DVec3};
use voxsplat::volume::{LoadOptions, SampleType, Volume, load};

fn fixture(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/volumes").join(name)
}

fn read(name: &str) -> Volume {
    load(&fixture(name).to_string_lossy(), &LoadOptions::default()).unwrap_or_else(|e| panic!("{name}: {e}"))
}

/// Axes turned 30 degrees about z with spacing 0.5, 0.75, 2; the first sample at (7, -8, 9).
fn oriented() -> DAffine3 {
    let (s, c) = 30.0_f64.to_radians().sin_cos();
    let turned = DMat3::from_cols(DVec3::new(c, s, 0.0), DVec3::new(-s, c, 0.0), DVec3::Z);
    DAffine3::from_mat3_translation(
        turned * DMat3::from_diagonal(DVec3::new(0.5, 0.75, 2.0)),
        DVec3::new(7.0, -8.0, 9.0),
    )
}

/// The same in a space whose x and y run the other way.
fn from_ras() -> DAffine3 {
    DAffine3::from_scale(DVec3::new(-1.0, -1.0, 1.0)) * oriented()
}

fn spacings_only() -> DAffine3 {
    DAffine3::from_scale(DVec3::new(0.5, 0.75, 2.0))
}

/// Checks lattice, type, orientation and every sample, whose values are `value(1 + x + 10 y + 50 z)`.
fn check(name: &str, volume: &Volume, sample_type: &str, to_world: DAffine3, known: bool, value: impl Fn(i64) -> f64) {
    assert_eq!(volume.grid().dims(), [3, 4, 5], "{name}");
    assert_eq!(volume.samples().type_name(), sample_type, "{name}");
    assert_eq!(volume.is_oriented(), known, "{name}");
    let got = volume.grid().to_world();
    assert!(got.abs_diff_eq(to_world, 1e-6), "{name}: {got} is not {to_world}");
    for (index, (z, y, x)) in (0..5).flat_map(|z| (0..4).flat_map(move |y| (0..3).map(move |x| (z, y, x)))).enumerate()
    {
        assert_eq!(volume.value(index), value(1 + x + 10 * y + 50 * z), "{name} at ({x}, {y}, {z})");
    }
}

#[test]
fn nifti_of_every_type() {
    let types = [
        ("int8", "i8"),
        ("uint8", "u8"),
        ("int16", "i16"),
        ("uint16", "u16"),
        ("int32", "i32"),
        ("uint32", "u32"),
        ("int64", "i64"),
        ("uint64", "u64"),
        ("float32", "f32"),
        ("float64", "f64"),
    ];
    for (name, sample_type) in types {
        let file = format!("n1_{name}.nii");
        let halved = name.ends_with("int8");
        check(&file, &read(&file), sample_type, from_ras(), true, |v| (if halved { v / 2 } else { v }) as f64);
    }
}

#[test]
fn nifti_pairs_versions_orders_and_orientations() {
    let same = |v: i64| v as f64;
    check("n2", &read("n2.nii.gz"), "i16", from_ras(), true, same);
    check("pair by image", &read("n1_pair.img"), "i16", from_ras(), true, same);
    check("pair by header", &read("n1_pair.hdr"), "i16", from_ras(), true, same);
    let mut left_handed = from_ras();
    left_handed.matrix3.z_axis *= -1.0;
    check("qform", &read("n1_qform.nii"), "i16", left_handed, true, same);
    check("big", &read("n1_big_rescaled.nii"), "i16", from_ras(), true, |v| 2.0 * v as f64 - 100.0);
    // Neither form: nibabel's base affine, x to the left of the patient, which is +x here; middle at the origin.
    let base = DAffine3::from_mat3_translation(
        DMat3::from_diagonal(DVec3::new(0.5, -0.75, 2.0)),
        DVec3::new(-0.5, 1.125, -4.0),
    );
    check("plain", &read("n1_plain.nii"), "i16", base, false, same);
}

#[test]
fn nrrd_encodings_and_spaces() {
    let same = |v: i64| v as f64;
    check("raw", &read("raw.nrrd"), "i16", oriented(), true, same);
    check("gzip", &read("gzip.nrrd"), "f32", oriented(), true, same);
    check("ascii", &read("ascii.nrrd"), "i32", oriented(), true, same);
    check("big", &read("big.nrrd"), "u16", oriented(), true, same);
    check("ras", &read("ras.nrrd"), "i16", from_ras(), true, same);
    check("spacings", &read("spacings.nrrd"), "i16", spacings_only(), false, same);
    check("detached", &read("split.nhdr"), "f64", oriented(), true, same);
}

#[test]
fn metaimage_local_detached_and_compressed() {
    let same = |v: i64| v as f64;
    check("local", &read("local.mha"), "i16", oriented(), true, same);
    check("packed", &read("packed.mha"), "i16", oriented(), true, same);
    check("detached", &read("detached.mhd"), "f32", oriented(), true, same);
    check("packed detached", &read("packed.mhd"), "u32", oriented(), true, same);
}

#[test]
fn numpy_orders() {
    let same = |v: i64| v as f64;
    check("c", &read("c.npy"), "f32", DAffine3::IDENTITY, false, same);
    check("fortran", &read("fortran.npy"), "u16", DAffine3::IDENTITY, false, same);
    check("big", &read("big.npy"), "i32", DAffine3::IDENTITY, false, same);
}

#[test]
fn raw_files_are_described_by_options() {
    let options = LoadOptions {
        dims: Some([3, 4, 5]),
        sample_type: Some(SampleType::F64),
        spacing: Some([0.5, 0.75, 2.0]),
        ..LoadOptions::default()
    };
    // The data file of the detached header is such a file.
    let volume = load(&fixture("detached.raw").to_string_lossy(), &options);
    let error = volume.unwrap_err().to_string();
    assert!(error.contains("truncated: expected 480 bytes of samples, found 240"), "{error}");
    let options = LoadOptions { sample_type: Some(SampleType::F32), ..options };
    let volume = load(&fixture("detached.raw").to_string_lossy(), &options).unwrap();
    check("raw", &volume, "f32", spacings_only(), false, |v| v as f64);
    let error = load(&fixture("detached.raw").to_string_lossy(), &LoadOptions::default()).unwrap_err().to_string();
    assert!(error.contains("--dims X,Y,Z and --type"), "{error}");
    let error = load(&fixture("raw.nrrd").to_string_lossy(), &options).unwrap_err().to_string();
    assert!(error.contains("--dims is for raw files"), "{error}");
}

#[test]
fn spacing_replaces_that_of_the_header_and_keeps_its_axes() {
    let options = LoadOptions { spacing: Some([1.0, 1.5, 4.0]), ..LoadOptions::default() };
    let volume = load(&fixture("raw.nrrd").to_string_lossy(), &options).unwrap();
    let mut expected = oriented();
    expected.matrix3 *= 2.0;
    assert!(volume.grid().to_world().abs_diff_eq(expected, 1e-9));
}

#[test]
fn nan_is_refused_or_replaced() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("nan.raw");
    let values = [1.0_f32, f32::NAN, 3.0, f32::INFINITY];
    std::fs::write(&path, bytemuck::cast_slice(&values)).unwrap();
    let options = LoadOptions { dims: Some([2, 2, 1]), sample_type: Some(SampleType::F32), ..LoadOptions::default() };
    let error = load(&path.to_string_lossy(), &options).unwrap_err().to_string();
    assert!(error.contains("2 samples are NaN or infinite, the first at (1, 0, 0)"), "{error}");
    let options = LoadOptions { replace_nan: Some(-1.0), ..options };
    let volume = load(&path.to_string_lossy(), &options).unwrap();
    assert_eq!([0, 1, 2, 3].map(|i| volume.value(i)), [1.0, -1.0, 3.0, -1.0]);
}

#[test]
fn lying_headers_are_one_line() {
    let cases: [(&str, &str, &str); 10] = [
        (
            "truncated.nrrd",
            "NRRD0004\ntype: u8\ndimension: 3\nsizes: 9 9 9\nencoding: raw\n\nabc",
            "expected 729 bytes of samples, found 3",
        ),
        (
            "huge.nrrd",
            "NRRD0004\ntype: double\ndimension: 3\nsizes: 60000 60000 60000\nencoding: gzip\nendian: little\n\nabc",
            "truncated: expected 1728000000000000",
        ),
        (
            "zero.nrrd",
            "NRRD0004\ntype: u8\ndimension: 3\nsizes: 0 9 9\nencoding: raw\n\n",
            "not positive whole numbers",
        ),
        (
            "flat.nrrd",
            "NRRD0004\ntype: u8\ndimension: 3\nsizes: 1 1 1\nspacings: 1 0 1\nencoding: raw\n\na",
            "do not span space",
        ),
        (
            "bzip.nrrd",
            "NRRD0004\ntype: u8\ndimension: 3\nsizes: 1 1 1\nencoding: bzip2\n\na",
            "save it as raw, gzip or ascii",
        ),
        ("color.nrrd", "NRRD0004\ntype: u8\ndimension: 4\nsizes: 3 2 2 2\nencoding: raw\n\na", "extract one component"),
        ("text.nrrd", "NRRD0004\ntype: u8\ndimension: 3\nsizes: 2 1 1\nencoding: ascii\n\n1 x", "sample 2 is \"x\""),
        (
            "short.mha",
            "NDims = 3\nDimSize = 2 2 2\nElementType = MET_UCHAR\nElementDataFile = LOCAL\nabc",
            "expected 8 bytes of samples, found 3",
        ),
        (
            "gone.mhd",
            "NDims = 3\nDimSize = 2 2 2\nElementType = MET_UCHAR\nElementDataFile = gone.raw\n",
            "cannot read",
        ),
        ("empty.nii", "", "the file is empty"),
    ];
    let directory = tempfile::tempdir().unwrap();
    for (name, content, part) in cases {
        let path = directory.path().join(name);
        std::fs::write(&path, content).unwrap();
        let error = load(&path.to_string_lossy(), &LoadOptions::default()).unwrap_err().to_string();
        assert!(error.contains(part) && !error.contains('\n'), "{name}: {error}");
    }
    let error = load(&directory.path().to_string_lossy(), &LoadOptions::default()).unwrap_err().to_string();
    assert!(error.contains("directory"), "{error}");
}

/// Flips, cuts and repeats bytes of every fixture: whatever comes out, it is a volume or an error, never a panic.
#[test]
fn damaged_files_never_panic() {
    let directory = tempfile::tempdir().unwrap();
    let mut state = 0x2545_f491_4f6c_dd1d_u64;
    let mut random = move |below: usize| {
        state ^= state << 13;
        state ^= state >> 7;
        state ^= state << 17;
        (state % below.max(1) as u64) as usize
    };
    let entries = std::fs::read_dir(fixture("")).unwrap();
    let mut names: Vec<String> = entries.map(|e| e.unwrap().file_name().into_string().unwrap()).collect();
    names.sort();
    for name in names.iter().filter(|n| !n.ends_with(".py")) {
        let original = std::fs::read(fixture(name)).unwrap();
        let path = directory.path().join(name);
        for _ in 0..40 {
            let mut bytes = original.clone();
            for _ in 0..=random(4) {
                let at = random(bytes.len().min(360));
                match random(3) {
                    0 => bytes[at] = random(256) as u8,
                    1 => bytes.truncate(at.max(1)),
                    _ => bytes[at] ^= 1 << random(8),
                }
            }
            std::fs::write(&path, &bytes).unwrap();
            if let Err(e) = load(&path.to_string_lossy(), &LoadOptions::default()) {
                assert!(!e.to_string().contains('\n'), "{e}");
            }
        }
    }
}
