//! Files as users reported them: headers that other programs accept.

use std::path::{Path, PathBuf};

use voxsplat::appearance::suggest;
use voxsplat::error::Hint;
use voxsplat::formats::{ComplexPart, LoadOptions, load};
use voxsplat::volume::{Samples, Statistics, Volume};

use super::fixtures::{affine, path};

/// A copy of a fixture in which bytes are replaced.
fn changed(folder: &Path, file: &str, changes: &[(usize, Vec<u8>)]) -> PathBuf {
    let mut bytes = std::fs::read(path(file)).unwrap();
    for (at, new) in changes {
        bytes[*at..at + new.len()].copy_from_slice(new);
    }
    written(folder, file, &bytes)
}

fn written(folder: &Path, name: &str, bytes: &[u8]) -> PathBuf {
    let path = folder.join(name);
    std::fs::write(&path, bytes).unwrap();
    path
}

fn read(path: &Path) -> Volume {
    load(path, &LoadOptions::default()).unwrap_or_else(|error| panic!("{error:#}"))
}

fn floats(numbers: &[f32]) -> Vec<u8> {
    numbers.iter().flat_map(|n| n.to_le_bytes()).collect()
}

fn bytes_of(volume: &Volume) -> Vec<u8> {
    match volume.in_memory().unwrap().samples() {
        Samples::U8(bytes) => bytes.clone(),
        other => panic!("{:?}", other.sample_type()),
    }
}

fn labels(volume: &Volume) -> Vec<String> {
    volume.contents().labels.iter().filter_map(|label| label.name.clone()).collect()
}

#[test]
fn tiles_with_several_sections_are_put_together() {
    for file in ["tiles-3d.tif", "tiles-3d-big.tif"] {
        let volume = read(Path::new(&path(file)));
        assert_eq!(volume.grid().dims(), [20, 18, 33]);
        let expected = (0..33).flat_map(|z| (0..18).flat_map(move |y| (0..20).map(move |x| x + 20 * y + 360 * z)));
        assert_eq!(volume.in_memory().unwrap().samples(), &Samples::U16(expected.collect()), "{file}");
    }
}

#[test]
fn bits_of_tiff_are_0_and_1() {
    let expected: Vec<u8> = (0..60).map(|n| u8::from(3 * n + 5 > 90)).collect();
    assert_eq!(bytes_of(&read(Path::new(&path("bits.tif")))), expected);
    // The last bit of a byte first (FillOrder).
    let folder = tempfile::tempdir().unwrap();
    let mut bytes = std::fs::read(path("bits.tif")).unwrap();
    let word = |bytes: &[u8], at: usize| u32::from_le_bytes(bytes[at..at + 4].try_into().unwrap()) as usize;
    let mut directory = word(&bytes, 4);
    while directory > 0 {
        let count = usize::from(u16::from_le_bytes(bytes[directory..directory + 2].try_into().unwrap()));
        let entries: Vec<usize> = (0..count).map(|n| directory + 2 + 12 * n).collect();
        let tag = |bytes: &[u8], entry: usize| u16::from_le_bytes(bytes[entry..entry + 2].try_into().unwrap());
        let strip = entries.iter().find(|entry| tag(&bytes, **entry) == 273).map(|entry| word(&bytes, entry + 8));
        let strip = strip.unwrap();
        bytes[strip..strip + 4].iter_mut().for_each(|byte| *byte = byte.reverse_bits());
        // Compression, which is none in any case, makes room.
        let entry = *entries.iter().find(|entry| tag(&bytes, **entry) == 259).unwrap();
        bytes[entry..entry + 12].copy_from_slice(&[10, 1, 3, 0, 1, 0, 0, 0, 2, 0, 0, 0]);
        directory = word(&bytes, directory + 2 + 12 * count);
    }
    assert_eq!(bytes_of(&read(&written(folder.path(), "a.tif", &bytes))), expected);
}

#[test]
fn an_image_of_a_tiff_file_is_chosen_by_its_number() {
    let file = path("images.ome.tif");
    let error = load(&file, &LoadOptions::default()).unwrap_err();
    let listed = "holds 2 series: 1 is \"first\" of 3 x 4 x 5 i16, 2 is \"second\" of 2 x 4 x 3 u8";
    assert!(error.to_string().ends_with(listed), "{error}");
    assert_eq!(error.hint(), Some(Hint::ChooseSeries));
    let of = |series| load(&file, &LoadOptions { series: Some(series), ..LoadOptions::default() });
    let [first, second] = [1, 2].map(|series| of(series).unwrap());
    assert_eq!((first.grid().dims(), first.grid().spacing()), ([3, 4, 5], [0.5, 0.75, 2.0]));
    assert_eq!(second.contents().origin.description.as_deref(), Some("second"));
    let expected = (0..36).filter(|n| n % 3 < 2).map(|n| 3 * n + 5).collect::<Vec<u8>>();
    assert_eq!((second.grid().dims(), bytes_of(&second)), ([2, 4, 3], expected));
    for series in [0, 3] {
        let error = of(series).unwrap_err().to_string();
        assert!(
            error.starts_with(&format!("series: {series}, but ")) && error.ends_with("has series 1 to 2"),
            "{error}"
        );
    }
}

#[test]
fn a_palette_that_is_no_look_up_table_is_noted() {
    let folder = tempfile::tempdir().unwrap();
    let mut bytes = std::fs::read(path("look-up-table.tif")).unwrap();
    assert_eq!(read(Path::new(&path("look-up-table.tif"))).contents().notes, Vec::<String>::new());
    let at = bytes.windows(7).position(|window| window == b"ImageJ=").unwrap();
    bytes[at] = b'i';
    let volume = read(&written(folder.path(), "a.tif", &bytes));
    assert_eq!(volume.grid().dims(), [3, 4, 5]);
    assert_eq!(volume.contents().notes, ["values are numbers of a palette, whose colours are not used"]);
}

#[test]
fn an_sform_that_does_not_span_space_is_none() {
    let folder = tempfile::tempdir().unwrap();
    // Places of fields as in nifti1.h: pixdim, the codes of both forms, the sform.
    let (pixdim, codes, sform) = (76, 252, 280);
    let expected = read(Path::new(&path("qform.nii")));
    for row in [[0.0; 12], [f32::NAN; 12]] {
        let zero = [(codes + 2, vec![1, 0]), (sform, floats(&row))];
        let volume = read(&changed(folder.path(), "qform.nii", &zero));
        assert_eq!((affine(&volume), volume.is_oriented()), (affine(&expected), true));
        assert_eq!(volume.contents().notes, ["using the qform because the axes of the sform do not span space"]);
    }
    // Without a qform the spacing is left.
    let neither = [(codes, vec![0, 0, 1, 0]), (sform, floats(&[0.0; 12])), (pixdim + 4, floats(&[2.0, 3.0, 4.0]))];
    let volume = read(&changed(folder.path(), "qform.nii", &neither));
    assert_eq!((volume.grid().spacing(), volume.is_oriented()), ([2.0, 3.0, 4.0], false));
    assert_eq!(volume.contents().notes, ["using spacings alone because the axes of the sform do not span space"]);
}

#[test]
fn spacings_of_nifti_that_are_no_lengths_become_lengths() {
    let folder = tempfile::tempdir().unwrap();
    let (pixdim, codes) = (76, 252);
    for forms in [[1, 0, 0, 0], [0; 4]] {
        for (stated, used) in [(0.0, 1.0), (-2.0, 2.0), (f32::NAN, 1.0), (f32::INFINITY, 1.0)] {
            let changes = [(codes, forms.to_vec()), (pixdim + 4, floats(&[stated, 0.75, 2.0]))];
            let file = changed(folder.path(), "qform.nii", &changes);
            let volume = read(&file);
            let [x, y, z] = volume.grid().spacing();
            let near = |a: f64, b: f64| (a - b).abs() < 1e-6;
            assert!(near(x, used) && near(y, 0.75) && near(z, 2.0), "{stated}: {x} {y} {z}");
            let note = format!("using {used} as the spacing of axis 1 because the header states {stated}");
            assert_eq!(volume.contents().notes, [note]);
            let given = LoadOptions { spacing: Some([5.0; 3]), ..LoadOptions::default() };
            assert!(load(&file, &given).unwrap().contents().notes.is_empty());
        }
    }
}

#[test]
fn gaps_of_a_statistic_are_not_in_its_range() {
    let folder = tempfile::tempdir().unwrap();
    let mut numbers: Vec<f32> = (0..60).map(|n| n as f32 * 0.25 - 7.0).collect();
    numbers[..20].fill(f32::NAN);
    let bytes = std::fs::read(path("raw-f32.nii")).unwrap();
    let start = bytes.len() - 240;
    let mut changes = vec![(start, floats(&numbers))];
    changes.push((148, b"SPM{T_[12.0]} - contrast 1: x\0".to_vec()));
    let volume = read(&changed(folder.path(), "raw-f32.nii", &changes));
    let statistics = Statistics::of(&volume).unwrap();
    assert_eq!((statistics.min, statistics.max, statistics.mean), (-2.0, 7.75, 2.875));
    assert_eq!(statistics.non_finite, 20);
    assert_eq!(volume.contents().notes, ["nothing is drawn of 20 of 60 samples because they are NaN or infinite"]);
    assert_eq!(suggest(&volume, &statistics).name, "activation");
}

#[test]
fn a_part_of_complex_samples_is_read_if_it_is_chosen() {
    let folder = tempfile::tempdir().unwrap();
    // 3 - 4i, 6 - 8i and so on.
    let (re, im): (Vec<f32>, Vec<f32>) = (1..=60).map(|n| (3.0 * n as f32, -4.0 * n as f32)).unzip();
    let pairs: Vec<f32> = re.iter().zip(&im).flat_map(|(re, im)| [*re, *im]).collect();
    let mut nifti = std::fs::read(path("raw-f32.nii")).unwrap();
    nifti.truncate(nifti.len() - 240);
    nifti[70..72].copy_from_slice(&32_i16.to_le_bytes());
    nifti.extend(floats(&pairs));
    let wide: Vec<u8> = pairs.iter().flat_map(|n| f64::from(*n).to_le_bytes()).collect();
    let mut double = nifti[..nifti.len() - 480].to_vec();
    double[70..72].copy_from_slice(&1792_i16.to_le_bytes());
    double.extend(wide);
    let dict = "{'descr': '<c8', 'fortran_order': False, 'shape': (5, 4, 3), }";
    let npy = [b"\x93NUMPY\x01\0".as_slice(), &(dict.len() as u16).to_le_bytes(), dict.as_bytes(), &floats(&pairs)];
    let nrrd = "NRRD0005\ntype: float\ndimension: 4\nsizes: 2 3 4 5\nencoding: raw\nendian: little\n\
                kinds: complex space space space\n\n";
    let files = [
        written(folder.path(), "a.nii", &nifti),
        written(folder.path(), "b.nii", &double),
        written(folder.path(), "a.npy", &npy.concat()),
        written(folder.path(), "a.nrrd", &[nrrd.as_bytes(), &floats(&pairs)].concat()),
        path("complex.tif").into(),
    ];
    let phase = f64::from((-4.0_f32).atan2(3.0));
    for file in files {
        if file.extension().is_none_or(|extension| extension != "nrrd") {
            let error = load(&file, &LoadOptions::default()).unwrap_err();
            assert!(error.to_string().contains("complex numbers"), "{error}");
            assert_eq!(error.hint(), Some(Hint::ChooseComplexPart), "{error}");
        }
        let parts = [(ComplexPart::Abs, 5.0), (ComplexPart::Real, 3.0), (ComplexPart::Imag, -4.0)];
        let of = |part| load(&file, &LoadOptions { complex: Some(part), ..LoadOptions::default() }).unwrap();
        for (part, factor) in parts {
            let volume = of(part);
            assert_eq!((volume.grid().dims(), volume.contents().channels), ([3, 4, 5], 1), "{file:?}");
            let values = volume.in_memory().unwrap();
            assert!((0..60).all(|n| values.value(n) == factor * (n as f64 + 1.0)), "{file:?}, {part}");
        }
        let values = of(ComplexPart::Phase).in_memory().unwrap();
        assert!((0..60).all(|n| (values.value(n) - phase).abs() < 1e-6), "{file:?}");
    }
}

/// A legacy file of 4 x 3 x 2 bytes, as VTK's own samples have blank lines.
const LEGACY: &str = "# vtk DataFile Version 1.0\nIron protein\n\nBINARY\n\nDATASET STRUCTURED_POINTS\n\
                      DIMENSIONS 4 3 2\nASPECT_RATIO 1.0 1.0 1.0\nORIGIN 0.0 0.0 0.0\n\nPOINT_DATA 24\n\
                      SCALARS scalars unsigned_char\n\nLOOKUP_TABLE default\n";

#[test]
fn blank_lines_of_legacy_vtk_are_skipped() {
    let folder = tempfile::tempdir().unwrap();
    let numbers: Vec<u8> = (0..24).collect();
    let text: String = numbers.iter().map(|n| format!("{n} ")).collect();
    let lower = LEGACY.replace("BINARY", " binary").replace("DATASET", "dataset").replace("SCALARS", "scalars");
    let windows = LEGACY.replace("BINARY", "ASCII").replace('\n', "\r\n");
    for bytes in [
        [LEGACY.as_bytes(), &numbers].concat(),
        [lower.as_bytes(), &numbers].concat(),
        [windows.as_bytes(), text.as_bytes()].concat(),
    ] {
        let volume = read(&written(folder.path(), "a.vtk", &bytes));
        assert_eq!((volume.grid().dims(), bytes_of(&volume)), ([4, 3, 2], numbers.clone()));
    }
    let error = load(written(folder.path(), "a.vtk", b"# vtk DataFile Version 1.0\nx\n\n\n"), &LoadOptions::default());
    assert!(error.unwrap_err().to_string().contains("the line after its title is \"\", expected ASCII or BINARY"));
}

#[test]
fn an_array_of_vtk_is_chosen_by_its_name() {
    let folder = tempfile::tempdir().unwrap();
    let array = |name: &str, components: usize, first: u8| {
        let text: String = (0..8 * components).map(|n| format!("{} ", n + usize::from(first))).collect();
        let of = format!("Name=\"{name}\" NumberOfComponents=\"{components}\" format=\"ascii\"");
        format!("<DataArray type=\"UInt8\" {of}>\n{text}</DataArray>")
    };
    let xml = |active: &str| {
        let arrays = [array("p", 1, 0), array("T at 1", 1, 100), array("velocity", 3, 9), array("c", 4, 0)].concat();
        format!(
            "<VTKFile type=\"ImageData\" byte_order=\"LittleEndian\"><ImageData WholeExtent=\"0 1 0 1 0 1\">\
             <Piece Extent=\"0 1 0 1 0 1\"><PointData{active}>{arrays}</PointData></Piece></ImageData></VTKFile>"
        )
    };
    let field = |name: &str, components: usize, first: u8| {
        let text: String = (0..8 * components).map(|n| format!("{} ", n + usize::from(first))).collect();
        format!("{name} {components} 8 unsigned_char\n{text}\n")
    };
    let fields = [field("p", 1, 0), field("T", 1, 100), field("velocity", 3, 9), field("c", 4, 0)].concat();
    let legacy = format!(
        "# vtk DataFile Version 3.0\nx\nASCII\nDATASET STRUCTURED_POINTS\nDIMENSIONS 2 2 2\nPOINT_DATA 8\n\
         FIELD FieldData 4\n{fields}"
    );
    let vti = written(folder.path(), "a.vti", xml("").as_bytes());
    let active = written(folder.path(), "b.vti", xml(" Scalars=\"c\"").as_bytes());
    let vtk = written(folder.path(), "a.vtk", legacy.as_bytes());
    for (file, second) in [(&vti, "T at 1"), (&active, "T at 1"), (&vtk, "T")] {
        let of = |name: &str, channel| {
            let inside = format!("{}:{name}", file.display());
            load(inside, &LoadOptions { channel, ..LoadOptions::default() })
        };
        assert_eq!(bytes_of(&of("p", None).unwrap()), (0..8).collect::<Vec<u8>>());
        assert_eq!(bytes_of(&of(second, None).unwrap()), (100..108).collect::<Vec<u8>>());
        let velocity = of("velocity", Some(1)).unwrap();
        assert_eq!(bytes_of(&velocity), (0..8).map(|n| 10 + 3 * n).collect::<Vec<u8>>());
        let opacity = of("c", Some(3)).unwrap();
        assert_eq!(bytes_of(&opacity), (0..8).map(|n| 3 + 4 * n).collect::<Vec<u8>>());
        assert_eq!(labels(&opacity), ["red", "green", "blue", "alpha"]);
        let error = of("t", None).unwrap_err().to_string();
        assert!(error.contains(&format!("has no array \"t\": there are p, {second}, velocity, c")), "{error}");
    }
    assert_eq!(bytes_of(&read(&vti)), (0..8).collect::<Vec<u8>>());
    let first = load(&active, &LoadOptions { channel: Some(0), ..LoadOptions::default() }).unwrap();
    assert_eq!(labels(&first), ["red", "green", "blue", "alpha"]);
}

#[test]
fn channels_that_the_file_calls_colours_are_colours() {
    let folder = tempfile::tempdir().unwrap();
    let nrrd = |kind: &str, of: &str, channels: usize, size: usize| {
        let head = format!(
            "NRRD0005\ntype: {of}\ndimension: 4\nsizes: {channels} 5 5 5\nencoding: raw\nendian: little\n\
             kinds: {kind} space space space\n\n"
        );
        let bytes = [head.as_bytes(), &vec![7; 125 * channels * size]].concat();
        let file = written(folder.path(), "a.nrrd", &bytes);
        labels(&load(file, &LoadOptions { channel: Some(0), ..LoadOptions::default() }).unwrap())
    };
    let (rgb, rgba) = (["red", "green", "blue"].as_slice(), ["red", "green", "blue", "alpha"].as_slice());
    assert_eq!(nrrd("RGB-color", "uchar", 3, 1), rgb);
    assert_eq!(nrrd("RGB-color", "ushort", 3, 2), rgb);
    assert_eq!(nrrd("RGBA-color", "uchar", 4, 1), rgba);
    assert_eq!(nrrd("RGBA-color", "float", 4, 4), rgba);
    assert_eq!(nrrd("4-color", "uchar", 4, 1), rgba);
    for (kind, of, channels, size) in
        [("4-color", "ushort", 4, 2), ("4-vector", "uchar", 4, 1), ("vector", "uchar", 3, 1), ("list", "uchar", 4, 1)]
    {
        assert_eq!(nrrd(kind, of, channels, size), Vec::<String>::new(), "{kind}");
    }
}

#[test]
fn spacings_of_nrrd_that_are_not_known_are_1() {
    let folder = tempfile::tempdir().unwrap();
    let head = "NRRD0005\ntype: uchar\ndimension: 3\nsizes: 2 2 2\nencoding: raw\nspacings: NaN 0.5 nan\n\n";
    let volume = read(&written(folder.path(), "a.nrrd", &[head.as_bytes(), &[1; 8]].concat()));
    assert_eq!(volume.grid().spacing(), [1.0, 0.5, 1.0]);
    let note = |axis| format!("using 1 as the spacing of axis {axis} because the header states NaN");
    assert_eq!(volume.contents().notes, [note(1), note(3)]);
}

#[test]
fn arrays_of_metaimage_are_channels() {
    let folder = tempfile::tempdir().unwrap();
    let file = |of: &str, size: usize| {
        let head = format!(
            "ObjectType = Image\nNDims = 3\nDimSize = 2 2 2\nElementType = {of}\nElementNumberOfChannels = 3\n\
             ElementDataFile = LOCAL\n"
        );
        let samples: Vec<u8> = (0..24 * size).map(|n| n as u8).collect();
        written(folder.path(), "a.mha", &[head.as_bytes(), &samples].concat())
    };
    let second = LoadOptions { channel: Some(1), ..LoadOptions::default() };
    let bytes = load(file("MET_UCHAR_ARRAY", 1), &second).unwrap();
    assert_eq!(bytes_of(&bytes), (0..8).map(|n| 1 + 3 * n).collect::<Vec<u8>>());
    assert_eq!((bytes.contents().channels, labels(&bytes).len()), (3, 3));
    let shorts = load(file("MET_SHORT_ARRAY", 2), &second).unwrap();
    assert_eq!((shorts.contents().channels, labels(&shorts).len()), (3, 0));
}

#[test]
fn a_raw_file_has_the_lattice_of_its_name() {
    let folder = tempfile::tempdir().unwrap();
    let numbers: Vec<u8> = (0..48).collect();
    let file = written(folder.path(), "neuron_4x3x2_uint16.raw", &numbers);
    let volume = read(&file);
    let expected: Vec<u16> = (0..24).map(|n| 2 * n + 256 * (2 * n + 1)).collect();
    assert_eq!(volume.grid().dims(), [4, 3, 2]);
    assert_eq!(volume.in_memory().unwrap().samples(), &Samples::U16(expected));
    assert_eq!(volume.contents().notes, ["using 4 x 3 x 2 samples of u16 because the name states them"]);
    // Options go before the name.
    let options = LoadOptions {
        dims: Some([6, 4, 2]),
        sample_type: Some(voxsplat::volume::SampleType::U8),
        ..LoadOptions::default()
    };
    let volume = load(&file, &options).unwrap();
    assert_eq!((volume.grid().dims(), bytes_of(&volume)), ([6, 4, 2], numbers.clone()));
    let short = written(folder.path(), "neuron_4x3x2_float32.raw", &numbers);
    let error = load(short, &LoadOptions::default()).unwrap_err().to_string();
    assert!(error.contains("has 48 bytes, and 4 x 3 x 2 samples of f32 need 96"), "{error}");
}

#[test]
fn broken_slc_files_say_what_is_wrong() {
    let folder = tempfile::tempdir().unwrap();
    let refused = |file: &str, from: &str, to: &str, words: &str| {
        let bytes = std::fs::read(path(file)).unwrap();
        let at = bytes.windows(from.len()).position(|window| window == from.as_bytes()).unwrap();
        let bytes = [&bytes[..at], to.as_bytes(), &bytes[at + from.len()..]].concat();
        let error = load(written(folder.path(), "a.slc", &bytes), &LoadOptions::default()).unwrap_err().to_string();
        assert!(error.contains(words), "{words}: {error}");
    };
    refused("raw-u8.slc", "11111", "11112", "begins with \"11112\", expected 11111");
    refused("raw-u8.slc", "\n8\n", "\n16\n", "has samples of 16 bits, expected 8");
    refused("raw-u8.slc", "3 4 5", "3 4 6", "is cut short");
    refused("raw-u8.slc", "3 4 5", "3 four 5", "its header has \"four\" as the size");
    refused("raw-u8.slc", "0.5 0.75", "0.5 0", "spacing of axis 2 is 0");
    refused("raw-u8.slc", "2 1 X", "2 1 Y", "expected X");
    refused("raw-u8.slc", "2 1 X", "2000000 1 X", "ends before byte");
    refused("raw-u8.slc", "2 0 0\n", "2 0 7\n", "has the compression 7, expected 0 or 1");
    refused("runs-u8.slc", "3 4 5", "3 3 5", "a plane has 12 samples, expected 9");
    refused("runs-u8.slc", "25 X", "25 Y", "a plane begins with no number of bytes");
    let whole = std::fs::read(path("runs-u8.slc")).unwrap();
    let error = load(written(folder.path(), "a.slc", &whole[..90]), &LoadOptions::default()).unwrap_err().to_string();
    assert!(error.contains("is damaged") || error.contains("cut short"), "{error}");
}
