//! Headers lie: whatever a file contains, loading it returns a volume or an error of one line.

use std::io::Write;
use std::path::Path;

use voxsplat::error::InputError;
use voxsplat::formats::{AxisOrder, LoadOptions, load};
use voxsplat::volume::{SampleType, Samples};

use crate::formats::fixtures::{copy_as_another, folder_of, path};
use crate::hostile::fuzz::targets::assert_one_line;

/// Loads `bytes` from a file of that name and returns the error's message.
fn refused(name: &str, bytes: &[u8]) -> String {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join(name);
    std::fs::write(&file, bytes).unwrap();
    message(&file, &LoadOptions::default())
}

fn message(file: &Path, options: &LoadOptions) -> String {
    let error = load(file, options).expect_err("a file that should be refused was read");
    let text = one_line(&error);
    assert!(!text.contains(" --"), "flags are the command line's: {text:?}");
    text
}

/// Returns the message of an error, after checking that it is a loading error of one line of bearable length.
fn one_line(error: &InputError) -> String {
    assert_one_line(error);
    format!("{error:#}")
}

fn assert_refused(name: &str, bytes: &[u8], words: &str) {
    let message = refused(name, bytes);
    assert!(message.contains(words), "{name}: {message:?} does not say {words:?}");
}

fn nrrd(lines: &str, data: &[u8]) -> Vec<u8> {
    [b"NRRD0004\n", lines.as_bytes(), b"\n\n", data].concat()
}

/// A header of one-byte samples, in the number that `sizes` states.
const NRRD: &str = "type: uchar\ndimension: 3\nsizes: 2 2 2\nencoding: raw";

#[test]
fn files_that_are_no_volume_are_named() {
    assert_refused("empty.nrrd", b"", "is empty");
    assert_refused("a.dat", b"some bytes", "set LoadOptions::dims and LoadOptions::sample_type");
    assert_refused("a.nrrd", b"some bytes", "expected NRRD0001");
    assert_refused("a.nii", &[0; 400], "not a NIfTI file");
    assert_refused("a.npy", b"some bytes", "not a NumPy file");
    assert_refused("a.mha", b"some bytes", "not \"Field = value\"");
    assert_refused("a.nrrd", b"NRRD0009\n", "NRRD0001 to NRRD0005");
    let dicom = [vec![0; 128], b"DICM".to_vec(), vec![0; 500]].concat();
    assert_refused("a.dcm", &dicom, "is damaged");
    // The first 128 bytes of DICOM are free, and may look like another format.
    for preamble in [&b"II*\0"[..], b"NRRD0004", b"\x93NUMPY"] {
        let file = [preamble, &vec![0; 128 - preamble.len()], b"DICM", &[0; 500]].concat();
        assert_refused("a.dcm", &file, "is damaged: an element of the type");
    }
    let analyze = [348_u32.to_le_bytes().to_vec(), vec![0; 344]].concat();
    assert_refused("a.hdr", &analyze, "ANALYZE");

    let folder = tempfile::tempdir().unwrap();
    assert!(message(folder.path(), &LoadOptions::default()).contains("directory"));
    let missing = message(&folder.path().join("none.nrrd"), &LoadOptions::default());
    assert!(missing.contains("cannot read") && missing.contains("none.nrrd"), "{missing}");
}

#[test]
fn data_files_longer_than_their_samples_need_a_place_to_begin() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("a.raw"), [7; 12]).unwrap();
    let file = folder.path().join("a.nhdr");
    let write = |more: &str| std::fs::write(&file, nrrd(&format!("{NRRD}{more}\ndata file: a.raw"), b"")).unwrap();
    write("");
    let refused = message(&file, &LoadOptions::default());
    assert!(refused.contains("4 bytes more") && refused.contains("byte skip"), "{refused}");
    for skip in ["0", "4", "-1"] {
        write(&format!("\nbyte skip: {skip}"));
        assert!(load(&file, &LoadOptions::default()).is_ok(), "{skip}");
    }
}

#[test]
fn options_for_bare_samples_are_refused_elsewhere() {
    let file = path("raw-i16.nrrd");
    let options = [
        ("dims", LoadOptions { dims: Some([3, 4, 5]), ..LoadOptions::default() }),
        ("sample_type", LoadOptions { sample_type: Some(SampleType::I16), ..LoadOptions::default() }),
        ("endian", LoadOptions { endian: Some("big".parse().unwrap()), ..LoadOptions::default() }),
        ("offset", LoadOptions { offset: 1, ..LoadOptions::default() }),
        ("axis_order", LoadOptions { axis_order: Some(AxisOrder::Zyx), ..LoadOptions::default() }),
    ];
    for (name, options) in options {
        for source in [file.as_str(), "demo:sphere:8"] {
            let error = load(source, &options).unwrap_err();
            assert!(one_line(&error).contains(name), "{name}: {error}");
        }
    }
    for spacing in [[0.0, 1.0, 1.0], [1.0, -1.0, 1.0], [1.0, 1.0, f64::NAN]] {
        let error = load(&file, &LoadOptions { spacing: Some(spacing), ..LoadOptions::default() }).unwrap_err();
        assert!(one_line(&error).contains("spacing"), "{error}");
    }
}

#[test]
fn bare_samples_need_both_options_and_enough_bytes() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("a.raw");
    std::fs::write(&file, [1; 16]).unwrap();
    let full = LoadOptions { dims: Some([2; 3]), sample_type: Some(SampleType::U16), ..LoadOptions::default() };
    assert!(load(file.to_str().unwrap(), &full).is_ok());
    let says = |options: LoadOptions, words: &str| {
        let message = message(&file, &options);
        assert!(message.contains(words), "{message:?} does not say {words:?}");
    };
    says(LoadOptions { dims: None, ..full }, "set LoadOptions::dims");
    says(LoadOptions { sample_type: None, ..full }, "set LoadOptions::sample_type");
    says(LoadOptions { offset: 1, ..full }, "has 15 bytes after the offset, and 2 x 2 x 2 samples of u16 need 16");
    says(LoadOptions { offset: u64::MAX, ..full }, "ends before byte");
    says(LoadOptions { dims: Some([65_535; 3]), sample_type: Some(SampleType::F64), ..full }, "need 2251696");
    says(LoadOptions { dims: Some([65_536, 1, 1]), ..full }, "dimension 1 is 65536");
    says(LoadOptions { dims: Some([1, 0, 1]), ..full }, "dimension 2 is 0");
}

#[test]
fn broken_nrrd_headers_say_what_is_wrong() {
    let data = [7; 8];
    let cases = [
        ("type: uchar", "# nothing", "field \"type\""),
        ("encoding: raw", "# nothing", "field \"encoding\""),
        ("sizes: 2 2 2", "# nothing", "field \"sizes\""),
        ("dimension: 3", "# nothing", "field \"dimension\""),
        ("dimension: 3", "dimension: 3\ndimension: 3", "given twice"),
        ("dimension: 3", "dimension: 17", "expected 1 to 16"),
        ("dimension: 3", "dimension: three", "not a number"),
        ("dimension: 3", "dimension", "not \"field: value\""),
        ("sizes: 2 2 2", "sizes: 2 2", "expected 3 numbers"),
        ("sizes: 2 2 2", "sizes: 2 0 2", "dimension 2 is 0"),
        ("sizes: 2 2 2", "sizes: 2 2 -2", "dimension 3 is -2"),
        ("sizes: 2 2 2", "sizes: 2 2 99999999999999999999", "not a number"),
        ("sizes: 2 2 2", "sizes: 60000 60000 60000", "216000000000000 bytes, 8 are there"),
        ("sizes: 2 2 2", "sizes: 2 2 3", "12 bytes, 8 are there"),
        ("dimension: 3\nsizes: 2 2 2", "dimension: 2\nsizes: 4 2", "are not volumes"),
        ("dimension: 3\nsizes: 2 2 2", "dimension: 6\nsizes: 2 2 2 2 2 2", "are not volumes"),
        ("sizes: 2 2 2", "sizes: 2 2 2\nkinds: RGB-color domain domain", "are not volumes"),
        ("type: uchar", "type: block", "type \"block\""),
        ("type: uchar", "type: short", "endian: little"),
        ("type: uchar", "type: uchar\nendian: middle", "expected little or big"),
        ("encoding: raw", "encoding: bzip2", "is damaged: bzip2"),
        ("encoding: raw", "encoding: text\nbyte skip: -1", "-1 goes with encoding raw, gzip or bzip2"),
        ("encoding: raw", "encoding: zstd", "unknown"),
        ("encoding: raw", "encoding: gzip", "cut short"),
        ("encoding: raw", "encoding: text", "is cut short"),
        ("encoding: raw", "encoding: raw\nspacings: 1 0 1", "spacing of axis 2 is 0"),
        ("encoding: raw", "encoding: raw\nspacings: 1 1 -1", "spacing of axis 3 is -1"),
        ("encoding: raw", "encoding: raw\nspacings: 1 inf 1", "spacing of axis 2 is inf"),
        ("encoding: raw", "encoding: raw\nspace directions: (1,0,0) (0,1,0) (1,1,0)", "do not span space"),
        ("encoding: raw", "encoding: raw\nspace directions: (1,0,0) none (0,0,1)", "are not volumes"),
        ("encoding: raw", "encoding: raw\nspace directions: (1,0) (0,1) (1,1)", "(x,y,z)"),
        ("encoding: raw", "encoding: raw\nspace directions: (1,0,0) (0,1,0", "(x,y,z)"),
        ("encoding: raw", "encoding: raw\nspace: elsewhere", "space \"elsewhere\""),
        ("encoding: raw", "encoding: raw\nspace dimension: 2", "expected 3"),
        ("encoding: raw", "encoding: raw\nspace: RAST\nspace dimension: 3", "expected 4"),
        ("encoding: raw", "encoding: raw\nspace: rast\nspace directions: (1,0,0) (0,1,0) (0,0,1)", "(x,y,z,t)"),
        (
            "encoding: raw",
            "encoding: raw\nspace: lpst\nspace directions: (1,0,0,0) (0,1,0,0) (0,0,1,7)",
            "slices at unlike times",
        ),
        ("encoding: raw", "encoding: raw\nbyte skip: 1", "8 bytes, 7 are there"),
        ("encoding: raw", "encoding: raw\nbyte skip: 100", "ends before byte 100"),
        ("encoding: raw", "encoding: raw\nbyte skip: -2", "expected -1 or more"),
        ("encoding: raw", "encoding: raw\nline skip: 1", "ends before line 1"),
        ("encoding: raw", "encoding: raw\ndata file: none.raw", "none.raw"),
        ("encoding: raw", "encoding: raw\ndata file: s%d.raw 1 3 1", "3 data files cannot share 8"),
        ("encoding: raw", "encoding: raw\ndata file: s%d.raw 1 3 0", "step"),
        ("encoding: raw", "encoding: raw\ndata file: LIST", "control characters"),
    ];
    assert!(load_ok(&nrrd(NRRD, &data)), "the header that the cases change is good");
    for (from, to, words) in cases {
        assert!(NRRD.contains(from), "{from}");
        let data: &[u8] = if to.contains("line skip") { &[] } else { &data };
        let data = if to.contains("text") { b"1 2 3 4 5 6 7" } else { data };
        assert_refused("a.nrrd", &nrrd(&NRRD.replace(from, to), data), words);
    }
    assert_refused("a.nrrd", &nrrd(&NRRD.replace("raw", "gzip"), &[7; 100]), "damaged");
    assert_refused("a.nhdr", &nrrd(&format!("{NRRD}\ndata file: LIST"), b""), "lists no data files");
    assert_refused("a.nrrd", &nrrd(&NRRD.replace("raw", "text"), b"1 2 3 x 5 6 7 8"), "sample 4 is \"x\"");
    assert_refused("a.nrrd", &nrrd(&NRRD.replace("raw", "text"), b"1 2 3 4 256 6 7 8"), "sample 5 is \"256\"");
    assert_refused("a.nrrd", &nrrd(&NRRD.replace("raw", "hex"), b"0102030405060708".map(|c| c + 20).as_slice()), "hex");
}

fn load_ok(bytes: &[u8]) -> bool {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("a");
    std::fs::write(&file, bytes).unwrap();
    load(file.to_str().unwrap(), &LoadOptions::default()).is_ok()
}

fn gzip(data: &[u8]) -> Vec<u8> {
    let mut encoder = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::default());
    encoder.write_all(data).unwrap();
    encoder.finish().unwrap()
}

#[test]
fn what_is_harmless_is_accepted() {
    let data = [7; 8];
    assert!(load_ok(&nrrd(NRRD, &[7; 100])), "bytes after the samples");
    assert!(load_ok(&nrrd(&NRRD.replace('\n', " \r\n"), &data)), "CRLF and blanks at line ends");
    assert!(load_ok(&nrrd(&format!("{NRRD}\n# \u{fc}\nkey:=1\nkey:=2"), &data)), "comments and repeated keys");
    let latin1 = [b"NRRD0004\ncontent: M\xfcller\n".as_slice(), NRRD.as_bytes(), b"\n\n", &data].concat();
    assert!(load_ok(&latin1), "a header that is not UTF-8");
    let header = NRRD.replace("raw", "gzip");
    assert!(load_ok(&nrrd(&header, &[gzip(&data), b"more".to_vec()].concat())), "bytes after the gzip stream");
    assert!(load_ok(&nrrd(&header, &[gzip(&data[..3]), gzip(&data[3..])].concat())), "two gzip members");
    let mut damaged = gzip(&data);
    let checksum = damaged.len() - 8;
    damaged[checksum] ^= 1;
    assert_refused("a.nrrd", &nrrd(&header, &damaged), "checksum");
    let claims = header.replace("2 2 2", "60000 60000 60000");
    assert_refused("a.nrrd", &nrrd(&claims, &gzip(&data)), "however compressed");
    let short = header.replace("2 2 2", "20 20 20");
    assert_refused("a.nrrd", &nrrd(&short, &gzip(&data)), "8000 bytes, 8 are there");
}

fn bzip2(data: &[u8]) -> Vec<u8> {
    let mut encoder = bzip2::write::BzEncoder::new(Vec::new(), bzip2::Compression::best());
    encoder.write_all(data).unwrap();
    encoder.finish().unwrap()
}

#[test]
fn samples_of_nrrd_are_found_behind_bytes_and_lines() {
    let data: Vec<u8> = (1..=8).collect();
    let folder = tempfile::tempdir().unwrap();
    type Pack = fn(&[u8]) -> Vec<u8>;
    let packers: [(&str, Pack); 4] = [
        ("raw", <[u8]>::to_vec),
        ("gzip", gzip),
        ("bzip2", bzip2),
        // Two streams in one.
        ("bz2", |data| [bzip2(&data[..3]), bzip2(&data[3..])].concat()),
    ];
    for (encoding, pack) in packers {
        for (skip, before, lines) in [
            ("byte skip: -1", 0, ""),
            ("byte skip: -1", 5, ""),
            // More than the samples, so that the buffer wraps around.
            ("byte skip: -1", 9_999, ""),
            ("byte skip: 5", 5, ""),
            ("line skip: 2", 0, "first\nsecond\n"),
            ("line skip: 1\nbyte skip: -1", 7, "first\n"),
        ] {
            let header = format!("{}\n{skip}", NRRD.replace("raw", encoding));
            let content = [lines.as_bytes(), &pack(&[vec![9; before], data.clone()].concat())].concat();
            let what = format!("{encoding}, {skip}, {before} bytes before");
            let (attached, detached) = (folder.path().join("a.nrrd"), folder.path().join("b.nhdr"));
            std::fs::write(&attached, nrrd(&header, &content)).unwrap();
            std::fs::write(folder.path().join("b.data"), &content).unwrap();
            std::fs::write(&detached, nrrd(&format!("{header}\ndata file: b.data"), b"")).unwrap();
            for file in [attached, detached] {
                let volume = load(&file, &LoadOptions::default()).unwrap_or_else(|error| panic!("{what}: {error}"));
                assert_eq!(volume.in_memory().unwrap().samples(), &Samples::U8(data.clone()), "{what}");
            }
        }
    }
}

#[test]
fn damaged_bzip2_says_what_is_wrong() {
    let data: Vec<u8> = (1..=8).collect();
    let header = NRRD.replace("raw", "bzip2");
    let whole = bzip2(&data);
    for end in 0..whole.len() - 10 {
        assert_refused("a.nrrd", &nrrd(&header, &whole[..end]), "");
    }
    // The checksum of the block, which follows its mark.
    let mut damaged = whole.clone();
    damaged[10] ^= 1;
    assert_refused("a.nrrd", &nrrd(&header, &damaged), "is damaged: bzip2: invalid data");
    let last = format!("{header}\nbyte skip: -1");
    assert_refused("a.nrrd", &nrrd(&last, &damaged), "is damaged: bzip2: invalid data");
    for (encoding, content) in [("bzip2", bzip2(&data)), ("gzip", gzip(&data))] {
        let last = last.replace("bzip2", encoding);
        let claims = |sizes: &str| nrrd(&last.replace("2 2 2", sizes), &content);
        assert_refused("a.nrrd", &claims("2 2 3"), "is cut short: its samples need 12 bytes, 8 are there");
        assert_refused("a.nrrd", &claims("60000 60000 60000"), "is cut short");
    }
    // Far more than any writer puts before samples.
    assert_refused("a.nrrd", &nrrd(&last, &bzip2(&vec![0; 1_000_000])), "bytes before its samples");
    let far = format!("{header}\nbyte skip: 1000000000000");
    assert_refused("a.nrrd", &nrrd(&far, &whole), "ends before byte 1000000000000");
}

#[test]
fn whole_files_may_be_in_bzip2() {
    let folder = tempfile::tempdir().unwrap();
    let of = |file: &Path| load(file, &LoadOptions::default()).unwrap();
    for name in ["gzip-i8.nrrd", "oblique-cell.map", "nifti2-i16.nii", "fortran-i16.npy", "big-f64.mha"] {
        let packed = folder.path().join(format!("{name}.bz2"));
        std::fs::write(&packed, bzip2(&std::fs::read(path(name)).unwrap())).unwrap();
        let (found, expected) = (of(&packed), of(Path::new(&path(name))));
        assert_eq!(found.in_memory().unwrap().samples(), expected.in_memory().unwrap().samples(), "{name}");
        assert_eq!(found.grid(), expected.grid(), "{name}");
    }
}

#[test]
fn a_section_of_no_thickness_has_that_of_its_columns() {
    let mut content = std::fs::read(path("oblique-cell.map")).unwrap();
    let sections = 5;
    let length = content.len();
    content.truncate(length - length.saturating_sub(1024) * (sections - 1) / sections);
    let big = content[212] == 0x11;
    let word = |number: u32| if big { number.to_be_bytes() } else { number.to_le_bytes() };
    // One section, one interval of the cell along its edge, which has the length 0.
    let edge = (0..3).find(|n| content[64..76][4 * 2..] == word(n + 1)).unwrap() as usize;
    content[8..12].copy_from_slice(&word(1));
    content[40 + 4 * edge..44 + 4 * edge].copy_from_slice(&[0; 4]);
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("a.map");
    std::fs::write(&file, content).unwrap();
    let volume = load(&file, &LoadOptions::default()).unwrap();
    let axes = volume.grid().to_world().matrix3;
    assert_eq!(volume.grid().dims()[2], 1);
    assert!((axes.z_axis.length() / axes.x_axis.length() - 1.0).abs() < 1e-6, "{axes}");
}

/// A fixture with some bytes replaced.
fn changed(file: &str, at: usize, bytes: &[u8]) -> Vec<u8> {
    let mut content = std::fs::read(path(file)).unwrap();
    content[at..at + bytes.len()].copy_from_slice(bytes);
    content
}

#[test]
fn broken_nifti_headers_say_what_is_wrong() {
    let i16s = |numbers: &[i16]| numbers.iter().flat_map(|n| n.to_le_bytes()).collect::<Vec<u8>>();
    // Offsets as in nifti1.h.
    let (dim, datatype, vox_offset, slope, quatern) = (40, 70, 108, 112, 256);
    let nan = f32::NAN.to_le_bytes();
    let cases: [(&str, usize, Vec<u8>, &str); 11] = [
        ("raw-i16.nii", dim, i16s(&[0]), "dim[0] is 0"),
        ("raw-i16.nii", dim, i16s(&[6, 3, 4, 5, 1, 1, 2]), "dim[6] is 2"),
        ("raw-i16.nii", dim, i16s(&[3, -1]), "dimension 1 is -1"),
        ("raw-i16.nii", dim, i16s(&[3, 3, 4, 6]), "144 bytes, 120 are there"),
        ("raw-i16.nii", datatype, i16s(&[128]), "3 channels"),
        ("raw-i16.nii", datatype, i16s(&[32]), "complex"),
        ("raw-i16.nii", datatype, i16s(&[3]), "datatype 3"),
        ("raw-i16.nii", vox_offset, nan.to_vec(), "vox_offset is NaN"),
        ("raw-i16.nii", vox_offset, 348_f32.to_le_bytes().to_vec(), "inside the header"),
        ("scaled.nii", slope + 4, nan.to_vec(), "scl_inter is NaN"),
        ("qform.nii", quatern, 2_f32.to_le_bytes().to_vec(), "no rotation"),
    ];
    for (file, at, bytes, words) in cases {
        assert_refused("a.nii", &changed(file, at, &bytes), words);
    }
    assert_refused("a.nii", &changed("nifti2-i16.nii", 8, b"\n\n"), "text mode");
    assert_refused("a.hdr", &std::fs::read(path("pair-i16.hdr")).unwrap(), "a.img");
    // A slope of 0 means no scaling, whatever the intercept.
    assert!(load_ok(&changed("scaled.nii", slope, &[0; 4])));
}

#[test]
fn broken_mrc_headers_say_what_is_wrong() {
    let word = |number: i32| number.to_le_bytes();
    let cases: [(usize, [u8; 4], &str); 10] = [
        (0, word(0), "dimension 1 is 0"),
        (8, word(-5), "dimension 3 is -5"),
        (8, word(6), "144 bytes, 120 are there"),
        (8, word(60_000), "1440000 bytes, 120 are there"),
        (12, word(4), "complex"),
        (12, word(16), "3 channels"),
        (12, word(5), "mode 5 is not read"),
        (92, word(-1), "extended header of -1 bytes"),
        (92, word(1000), "ends before byte 1000"),
        (68, word(1), "axes 1, 1, 3"),
    ];
    for (at, bytes, words) in cases {
        assert_refused("a.mrc", &changed("raw-i16.mrc", at, &bytes), words);
    }
    assert_refused("a.mrc", &changed("raw-i16.mrc", 28, &[0; 4]), "spacing of axis 1 is inf");
    assert_refused("a.mrc", &changed("oblique-cell.map", 52, &10_f32.to_le_bytes()), "do not span space");
    let volumes = [word(401), word(0)].concat();
    let mut stack = changed("raw-i16.mrc", 88, &volumes);
    stack[36] = 2;
    assert_refused("a.mrc", &stack, "5 sections in volumes of 2");
    assert_refused("a.mrc", &std::fs::read(path("raw-i16.mrc")).unwrap()[..1000], "header has 1000 of 1024 bytes");
    assert_refused("a.mrc", &[0xff; 2000], "not an MRC file");
}

#[test]
fn broken_vtk_files_say_what_is_wrong() {
    let replaced = |file: &str, from: &str, to: &str| {
        let bytes = std::fs::read(path(file)).unwrap();
        let at = bytes.windows(from.len()).position(|window| window == from.as_bytes()).expect(from);
        [&bytes[..at], to.as_bytes(), &bytes[at + from.len()..]].concat()
    };
    let cases = [
        ("raw-i16.vti", "ImageData", "UnstructuredGrid", "expected ImageData"),
        ("raw-i16.vti", "LittleEndian", "Middle", "byte_order is \"Middle\""),
        ("raw-i16.vti", "UInt64", "UInt16", "header_type is \"UInt16\""),
        ("raw-i16.vti", "header_type", "compressor=\"vtkLZMADataCompressor\" a", "save it with ZLib"),
        ("raw-i16.vti", "Extent=\"0 2 0 3 0 4\"", "Extent=\"0 2 0 3\"", "WholeExtent is \"0 2 0 3\""),
        ("raw-i16.vti", "WholeExtent=\"0 2 0 3 0 4\"", "WholeExtent=\"0 2 0 3 0 5\"", "several pieces"),
        ("raw-i16.vti", "0.5 0.75 2", "0.5 0 2", "spacing of axis 2 is 0"),
        ("raw-i16.vti", "1 0 0 0 1 0", "1 0 0 1 0 0", "do not span space"),
        ("raw-i16.vti", "type=\"Int16\"", "type=\"String\"", "type \"String\""),
        ("raw-i16.vti", "format=\"appended\"", "format=\"\"", "format \"\""),
        ("raw-i16.vti", "Name=\"", "NumberOfComponents=\"3\" Name=\"", "has 3 channels per sample"),
        ("raw-i16.vti", "Name=\"", "Name=\"a", "no array of scalars"),
        ("raw-i16.vti", "offset=\"0\"", "offset=\"x\"", "offset is \"x\""),
        ("raw-i16.vti", "offset=\"0\"", "offset=\"999\"", "ends before byte 999"),
        ("raw-i16.vti", "AppendedData", "Appended", "no appended data"),
        ("ascii-i16.vti", "-28000", "x", "\"x\", which is not a number"),
        ("ascii-i16.vti", "-28000", "", "which is not a number"),
        ("base64-i16.vti", "eAAAA", "e!", "no digit of base64"),
        ("raw-i16.vtk", "BINARY", "OCTAL", "expected ASCII or BINARY"),
        ("raw-i16.vtk", "STRUCTURED_POINTS", "POLYDATA", "expected STRUCTURED_POINTS"),
        ("raw-i16.vtk", "DIMENSIONS 3 4 5", "DIMENSIONS 3 4 6", "144 bytes, 12"),
        ("raw-i16.vtk", "DIMENSIONS 3 4 5", "DIMENSIONS 3 4", "not understood"),
        ("raw-i16.vtk", "DIMENSIONS 3 4 5", "", "dimension 1 is 0"),
        ("raw-i16.vtk", " short", " bit", "type \"bit\""),
        ("raw-i16.vtk", "LOOKUP_TABLE", "TABLE", "expected LOOKUP_TABLE"),
    ];
    for (file, from, to, words) in cases {
        assert_refused("a", &replaced(file, from, to), words);
    }
    // An array before the scalars, as bytes and as text.
    let header = |coding: &str| {
        format!(
            "# vtk DataFile Version 3.0\n\n{coding}\nDATASET STRUCTURED_POINTS\nDIMENSIONS 2 1 1\nPOINT_DATA 2\n\
             FIELD FieldData 2\nflow 3 2 short\n"
        )
    };
    assert!(load_ok(&[header("BINARY").as_bytes(), &[0; 12], b"\nct 1 2 char\n", &[7, 9]].concat()));
    assert!(load_ok(&[header("ASCII").as_bytes(), b"1 2 3 4 5 6\nct 1 2 char\n7 9\n"].concat()));
    // Blocks that are cut short, changed, or claim more than they can hold.
    let blocks = std::fs::read(path("zlib-i16.vti")).unwrap();
    let start = blocks.windows(2).rposition(|window| window == b" _").unwrap() + 2 + 216;
    let changed = |at: usize, bytes: &[u8]| {
        let mut blocks = blocks.clone();
        blocks[start + at..start + at + bytes.len()].copy_from_slice(bytes);
        blocks
    };
    assert!(load_ok(&changed(0, &[])));
    assert_refused("a", &changed(0, &[0xff; 8]), "compressed blocks");
    assert_refused("a", &changed(8, &[0xff; 7]), "decompress to");
    assert_refused("a", &changed(24, &[0xff; 7]), "cut short");
    assert_refused("a", &changed(16, &[5]), "a block of 6 bytes, expected 5");
    assert_refused("a", &blocks[..blocks.len() - 60], "cut short");
}

#[test]
fn broken_tiff_files_say_what_is_wrong() {
    // Changes the value of a tag in every directory of a little-endian file.
    let tagged = |file: &str, tag: u16, value: u32| {
        let mut bytes = std::fs::read(path(file)).unwrap();
        let word = |bytes: &[u8], at: usize| u32::from_le_bytes(bytes[at..at + 4].try_into().unwrap()) as usize;
        let mut directory = word(&bytes, 4);
        while directory > 0 {
            let count = usize::from(u16::from_le_bytes(bytes[directory..directory + 2].try_into().unwrap()));
            for entry in (0..count).map(|n| directory + 2 + 12 * n) {
                if bytes[entry..entry + 2] == tag.to_le_bytes() {
                    bytes[entry + 8..entry + 12].copy_from_slice(&value.to_le_bytes());
                }
            }
            directory = word(&bytes, directory + 2 + 12 * count);
        }
        bytes
    };
    let (width, bits, compression, photometric, channels, strip) = (256, 258, 259, 262, 277, 273);
    let cases = [
        ("deflate-i16.tif", width, 0, "not read"),
        ("deflate-i16.tif", width, 60_000, "cut short"),
        ("deflate-f32.tif", width, 1_000_000, "dimension 1 is 1000000"),
        ("raw-i16.tif", bits, 12, "samples of 12 bits"),
        ("raw-i16.tif", compression, 34_712, "not read"),
        ("raw-i16.tif", photometric, 5, "the photometric interpretation 5"),
        ("raw-i16.tif", channels, 3, "3 x 4 samples need 72 bytes, 24 are there"),
        ("raw-i16.tif", strip, 4_000_000, ""),
    ];
    for (file, tag, value, words) in cases {
        assert_refused("a.tif", &tagged(file, tag, value), words);
    }
    let with_text = |file: &str, from: &str, to: &str| {
        let mut bytes = std::fs::read(path(file)).unwrap();
        let at = bytes.windows(from.len()).position(|window| window == from.as_bytes()).expect(from);
        bytes[at..at + from.len()].copy_from_slice(to.as_bytes());
        bytes
    };
    assert_refused(
        "a.tif",
        &with_text("ome-i16.ome.tif", "SizeC=\"1\"", "SizeC=\"2\""),
        "5 pages, but its OME-XML states 10",
    );
    assert_refused("a.tif", &with_text("ome-i16.ome.tif", "SizeZ=\"5\"", "SizeZ=\"4\""), "states 4: save it");
    assert_refused("a.tif", &with_text("one-directory.tif", "slices=5", "frames=4"), "for 1 channel at 4 points");
    assert_refused("a.tif", &with_text("one-directory.tif", "images=5", "images=9"), "216 bytes, 120 are there");
    let whole = std::fs::read(path("deflate-i16.tif")).unwrap();
    assert_refused("a.tif", &whole[..whole.len() / 2], "cut short");
    assert_refused("a.tif", b"II*\0\x08\0\0\0\0\0\0\0\0\0", "");
    assert_refused("a.tif", &gzip(&whole), "decompressed");
}

#[test]
fn broken_dicom_files_say_what_is_wrong() {
    let whole = std::fs::read(path("enhanced-i16.dcm")).unwrap();
    let replaced = |from: &[u8], to: &[u8]| {
        let at = whole.windows(from.len()).rposition(|window| window == from).unwrap();
        [&whole[..at], to, &whole[at + from.len()..]].concat()
    };
    let syntax = b"1.2.840.10008.1.2.1\0";
    let grey = b"\x28\0\x04\0CS\x0c\0MONOCHROME2 ";
    let cases: [(&[u8], &[u8], &str); 9] = [
        (grey, b"\x28\0\x04\0CS\x0e\0PALETTE COLOR ", "is in a palette of colours without a descriptor"),
        (syntax, b"1.2.840.10008.1.2.5\0", "compressed by RLE, but its pixels are in no fragments"),
        (syntax, b"1.2.840.10008.1.2.9\0", ""),
        (b"\x28\0\x10\0US\x02\0\x04", b"\x28\0\x10\0US\x02\0\x05", "150 bytes, 120 are there"),
        (b"\x28\0\x10\0US\x02\0\x04", b"\x28\0\x10\0US\x02\0\0", "dimension 2 is 0"),
        (b"\x28\0\x02\0US\x02\0\x01", b"\x28\0\x02\0US\x02\0\x03", "3 samples per pixel of the kind \"MONOCHROME2\""),
        (b"34.5", b"32.5", "two slices at one position"),
        (b"38.5", b"40.5", "1 slice is missing between"),
        (b"38.5", b"39.5", "unequally spaced: 2.4000"),
    ];
    for (from, to, words) in cases {
        let bytes = replaced(from, to);
        if words.is_empty() {
            // An unknown transfer syntax counts as uncompressed.
            assert!(load_ok(&bytes));
        } else {
            assert_refused("a.dcm", &bytes, words);
        }
    }
    assert_refused("a.dcm", &whole[..whole.len() - 1], "cut short");
    let changed = |file: &str, from: &[u8], to: &[u8]| {
        let bytes = std::fs::read(path(file)).unwrap();
        let at = bytes.windows(from.len()).rposition(|window| window == from).unwrap();
        [&bytes[..at], to, &bytes[at + from.len()..]].concat()
    };
    let ls = changed("jpeg2000-u8.dcm", b"1.2.840.10008.1.2.4.90", b"1.2.840.10008.1.2.4.80");
    assert_refused("a.dcm", &ls, "frame 1: JPEG-LS: invalid data");
    assert_refused("a.dcm", &changed("ybr-u8.dcm", b"YBR_FULL", b"HSV     "), "of the kind \"HSV\": expected grey");
    let high = changed("ybr-u8.dcm", b"\x28\0\x01\x01US\x02\0\x08", b"\x28\0\x01\x01US\x02\0\x07");
    assert_refused("a.dcm", &high, "has 7 bits of YBR_FULL, expected 8 without sign");
    // The number of frames is the number of fragments, or a table states it.
    let end = [0xfe, 0xff, 0xdd, 0xe0];
    assert_refused(
        "a.dcm",
        &changed("rle-i16.dcm", &end, &[0; 4]),
        "is damaged: (0000,0000) where a fragment should begin",
    );
    let more = changed("rle-i16.dcm", b"\x28\0\x08\0IS\x02\x005 ", b"\x28\0\x08\0IS\x02\x006 ");
    assert_refused("a.dcm", &more, "6 frames in 5 fragments");
    let rows = b"\x28\0\x10\0US\x02\0\x04";
    let longer = b"\x28\0\x10\0US\x02\0\x05";
    for (file, words) in [
        ("rle-i16.dcm", "frame 1: RLE: a segment is cut short"),
        ("lossless-u16.dcm", "frame 1: JPEG lossless: a picture of 3 x 4"),
        ("jpeg2000-i16.dcm", "frame 1: JPEG 2000: a picture of 3 x 4"),
    ] {
        assert_refused("a.dcm", &changed(file, rows, longer), words);
    }
    assert_refused("a.dcm", &whole[..1000], "");
    // In the order of their positions: c, e, b, a, d.
    let folder = folder_of(&["ct-a.dcm", "ct-c.dcm", "ct-d.dcm", "ct-e.dcm"]);
    let says = message(folder.path(), &LoadOptions::default());
    assert!(says.contains("1 slice is missing between ct-e.dcm and ct-a.dcm"), "{says}");
    copy_as_another("ct-a.dcm", &folder.path().join("ct-b.dcm"));
    let says = message(folder.path(), &LoadOptions::default());
    assert!(says.contains("two slices at one position: ct-a.dcm and ct-b.dcm"), "{says}");
    std::fs::copy(path("raw-u8.tif"), folder.path().join("a.tif")).unwrap();
    assert!(message(folder.path(), &LoadOptions::default()).contains("DICOM and TIFF"));
}

#[test]
fn broken_metaimage_and_numpy_headers_say_what_is_wrong() {
    let good = "NDims = 3\nDimSize = 2 2 2\nElementType = MET_UCHAR\nElementDataFile = LOCAL\n";
    let file = |text: &str| [text.as_bytes(), &[7; 8]].concat();
    assert!(load_ok(&file(good)));
    let cases = [
        ("NDims = 3", "NDims = 5", "NDims is 5"),
        ("NDims = 3", "NDims = 4", "expected 4 numbers"),
        ("DimSize = 2 2 2", "", "\"DimSize\""),
        ("DimSize = 2 2 2", "DimSize = 2 2 2\nDimSize = 2 2 2", "given twice"),
        ("DimSize = 2 2 2", "DimSize = 2 2 3", "12 bytes, 8 are there"),
        ("DimSize = 2 2 2", "DimSize = 2 2 2\nElementSpacing = 1 1 0", "spacing of axis 3 is 0"),
        ("DimSize = 2 2 2", "DimSize = 2 2 2\nTransformMatrix = 1 0 0 1 0 0 0 0 1", "do not span space"),
        ("DimSize = 2 2 2", "DimSize = 2 2 2\nTransformMatrix = 1 0 0", "expected 9 numbers"),
        ("DimSize = 2 2 2", "DimSize = 2 2 2\nElementNumberOfChannels = 3", "3 channels"),
        ("DimSize = 2 2 2", "DimSize = 2 2 2\nCompressedData = Maybe", "expected True or False"),
        ("DimSize = 2 2 2", "DimSize = 2 2 2\nCompressedData = True", "damaged"),
        ("DimSize = 2 2 2", "DimSize = 2 2 2\nHeaderSize = -5", "HeaderSize is -5"),
        ("DimSize = 2 2 2", "DimSize = 2 2 2\nObjectType = Tube", "expected Image"),
        ("DimSize = 2 2 2", "DimSize = 2 2 2\nElementToIntensityFunctionSlope = 0", "no value"),
        ("MET_UCHAR", "MET_STRING", "MET_STRING"),
        ("ElementDataFile = LOCAL\n", "ElementDataFiles", "not \"Field = value\""),
        ("LOCAL", "", "is empty"),
        ("LOCAL", "none.raw", "none.raw"),
    ];
    for (from, to, words) in cases {
        assert!(good.contains(from), "{from}");
        assert_refused("a.mha", &file(&good.replacen(from, to, 1)), words);
    }

    let npy = |header: &str, version: u8| {
        let length = header.len() as u16;
        [b"\x93NUMPY", [version, 0].as_slice(), &length.to_le_bytes(), header.as_bytes(), &[7; 8]].concat()
    };
    let good = "{'descr': '|u1', 'fortran_order': False, 'shape': (2, 2, 2), }";
    assert!(load_ok(&npy(good, 1)));
    assert_refused("a.npy", &npy(good, 7), "version");
    assert_refused("a.npy", &npy(good, 2), "header of");
    let cases = [
        ("(2, 2, 2)", "(2, 4)", "expected (z, y, x)"),
        ("(2, 2, 2)", "()", "not read"),
        ("(2, 2, 2)", "(2, 2, 3)", "12 bytes, 8 are there"),
        ("(2, 2, 2)", "(4294967296, 4294967296, 4294967296)", "dimension 1 is 4294967296"),
        ("'|u1'", "'<c8'", "complex numbers"),
        ("'|u1'", "'|O'", "type \"|O\""),
        ("'|u1'", "[('a', '<u1')]", "not read"),
        ("'|u1'", "''", "type \"\""),
        ("'|u1'", "'\u{e4}'", "type"),
    ];
    for (from, to, words) in cases {
        assert_refused("a.npy", &npy(&good.replacen(from, to, 1), 1), words);
    }
}
