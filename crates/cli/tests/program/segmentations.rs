//! Volumes of labels by the program: those that it recognises, tables in their files, legends.

use std::fs;
use std::path::Path;

use voxsplat::formats::{LoadOptions, load};
use voxsplat::image::{Background, Image};
use voxsplat::layers::{Labels, recognised};
use voxsplat::volume::Segment;

use crate::cli::{complaint, folder, stdout, volume_file, voxsplat};

const N: usize = 16;

/// A ball of two labels in a shell of nothing.
fn label(i: usize) -> u8 {
    let [x, y, z] = [i % N, i / N % N, i / N / N].map(|p| p as f64 - 7.5);
    match (x * x + y * y + z * z).sqrt() {
        r if r > 6.5 => 0,
        _ if x > 1.0 => 9,
        _ => 4,
    }
}

/// A NRRD in patient space: fields, and the samples.
fn nrrd(dir: &Path, name: &str, fields: &str, dims: &str, samples: &[u8]) {
    let axes = if dims.split(' ').count() == 4 { "none (1,0,0) (0,1,0) (0,0,1)" } else { "(1,0,0) (0,1,0) (0,0,1)" };
    let header = format!(
        "NRRD0004\ntype: uint8\ndimension: {}\nspace: left-posterior-superior\nsizes: {dims}\n\
         space directions: {axes}\nencoding: raw\n{fields}\n",
        dims.split(' ').count()
    );
    fs::write(dir.join(name), [header.as_bytes(), samples].concat()).unwrap();
}

fn labels() -> Vec<u8> {
    (0..N * N * N).map(label).collect()
}

/// What the program said, and the picture.
fn drawn(dir: &Path, options: &str) -> (Image, String) {
    let output = voxsplat(dir, &format!("render {options} --reference -o a.png"));
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(output.status.success(), "{options}: {said}");
    (Image::load(dir.join("a.png")).unwrap(), said)
}

const SEGMENTS: &str = "Segment0_ID:=Segment_1\nSegment0_Name:=Left kidney\nSegment0_Color:=1 0.25 0\n\
    Segment0_LabelValue:=4\nSegment0_Layer:=0\nSegment1_Name:=tumour\nSegment1_Color:=0 0 1\n\
    Segment1_LabelValue:=9\nSegment1_Layer:=0\n";

#[test]
fn segmentations_are_recognised_and_drawn_as_labels() {
    let dir = folder();
    let dir = dir.path();
    nrrd(dir, "plain.nrrd", "", "16 16 16", &labels());
    nrrd(dir, "kidney.seg.nrrd", SEGMENTS, "16 16 16", &labels());
    let (suggested, said) = drawn(dir, "plain.nrrd --size 16");
    assert!(said.contains("note: using --transfer labels because 2 whole numbers fill regions"), "{said}");
    assert!(said.contains("(show values: --transfer grayscale)"), "{said}");
    let (asked, said) = drawn(dir, "plain.nrrd --size 16 --transfer labels");
    assert!(asked == suggested && !said.contains("using --transfer labels"), "{said}");
    // The light that is taken is said as one would ask for it.
    assert!(
        said.contains(
            "note: using --light studio --tune shadow-bias=4 because labels have surfaces (disable: --light off)"
        ),
        "{said}"
    );
    let lit = "plain.nrrd --size 16 --transfer labels --light studio --tune shadow-bias=";
    assert!(drawn(dir, &format!("{lit}4")).0 == asked && drawn(dir, &format!("{lit}0")).0 != asked);
    // One option undoes it.
    let (values, said) = drawn(dir, "plain.nrrd --size 16 --transfer grayscale");
    assert!(values != suggested && !said.contains("labels"), "{said}");
    // What labels are not drawn by is not refused but drawn of the values.
    for of_values in ["--model mip", "--gradient-opacity 0:0.5"] {
        let (_, said) = drawn(dir, &format!("plain.nrrd --size 16 {of_values}"));
        assert!(!said.contains("labels"), "{said}");
    }
    // The colours of a file are those of its labels.
    let (named, said) = drawn(dir, "kidney.seg.nrrd --size 16 --light off");
    assert!(said.contains("because the file names its labels"), "{said}");
    let [left, right] = [3, 12].map(|x| named.pixels()[8 * 16 + x]);
    assert!(left[0] > 0.8 && left[2] < 0.1 && right[2] > 0.8 && right[0] < 0.1, "{left:?} {right:?}");
    let off = "kidney.seg.nrrd --size 16 --light off --transfer labels --label tumour:off --frame volume";
    let black = drawn(dir, off).0.pixels()[8 * 16 + 13];
    assert!(black[..3].iter().all(|channel| *channel < 0.02), "{black:?}");
}

#[test]
fn info_suggests_labels() {
    let dir = folder();
    let dir = dir.path();
    nrrd(dir, "plain.nrrd", "", "16 16 16", &labels());
    nrrd(dir, "kidney.seg.nrrd", SEGMENTS, "16 16 16", &labels());
    let text = stdout(&voxsplat(dir, "info plain.nrrd"));
    assert!(text.contains("labels: 2 whole numbers fill regions with sharp borders"), "{text}");
    assert!(text.contains("voxsplat render plain.nrrd --transfer labels -o plain.png"), "{text}");
    let json = voxsplat(dir, "info kidney.seg.nrrd --json");
    let found: serde_json::Value = serde_json::from_slice(&json.stdout).unwrap();
    assert_eq!((&found["preset"], &found["reason"]), (&"labels".into(), &"the file names its labels".into()));
    let listed = stdout(&voxsplat(dir, "info kidney.seg.nrrd --labels"));
    assert!(listed.lines().any(|l| l.contains("#ff4000") && l.ends_with("Left kidney")), "{listed}");
}

#[test]
fn what_files_say_of_labels_is_read() {
    let dir = folder();
    let dir = dir.path();
    nrrd(dir, "kidney.seg.nrrd", SEGMENTS, "16 16 16", &labels());
    let volume = load(dir.join("kidney.seg.nrrd"), &LoadOptions::default()).unwrap();
    let segment = |label, name: &str, color| Segment { channel: 0, label, name: Some(name.to_owned()), color };
    let expected = [segment(4, "Left kidney", Some([255, 64, 0])), segment(9, "tumour", Some([0, 0, 255]))];
    assert_eq!(volume.contents().segments.as_deref(), Some(&expected[..]));
    // NIfTI with the intent of labels, of noise that would not be recognised.
    let mut nifti = vec![0_u8; 352];
    let mut put = |at: usize, bytes: &[u8]| nifti[at..at + bytes.len()].copy_from_slice(bytes);
    put(0, &348_i32.to_le_bytes());
    [3_i16, 8, 8, 8, 1, 1, 1, 1].iter().enumerate().for_each(|(i, n)| put(40 + 2 * i, &n.to_le_bytes()));
    put(68, &1002_i16.to_le_bytes());
    put(70, &2_i16.to_le_bytes());
    put(72, &8_i16.to_le_bytes());
    (0..4).for_each(|i| put(76 + 4 * i, &1_f32.to_le_bytes()));
    put(108, &352_f32.to_le_bytes());
    put(344, b"n+1\0");
    nifti.extend((0..512_u32).map(|i| (i.wrapping_mul(2_654_435_761) >> 24) as u8));
    fs::write(dir.join("labels.nii"), &nifti).unwrap();
    let said = |name: &str| recognised(&load(dir.join(name), &LoadOptions::default()).unwrap()).unwrap();
    assert_eq!(said("labels.nii").as_deref(), Some("the file says that its values are labels"));
    nifti[68..70].copy_from_slice(&0_i16.to_le_bytes());
    fs::write(dir.join("noise.nii"), &nifti).unwrap();
    assert_eq!(said("noise.nii"), None);
}

#[test]
fn segments_that_overlap_are_drawn_together() {
    let dir = folder();
    let dir = dir.path();
    // Two layers, the fastest axis: a ball, and a slab across it.
    let slab = |i: usize| u8::from((6..10).contains(&(i / N / N)));
    let both: Vec<u8> = (0..N * N * N).flat_map(|i| [u8::from(label(i) > 0), slab(i)]).collect();
    let fields = "kinds: list domain domain domain\nSegment0_Name:=ball\nSegment0_Color:=1 0 0\n\
        Segment0_LabelValue:=1\nSegment0_Layer:=0\nSegment1_Name:=slab\nSegment1_Color:=0 1 0\n\
        Segment1_LabelValue:=1\nSegment1_Layer:=1\n";
    nrrd(dir, "two.seg.nrrd", fields, "2 16 16 16", &both);
    nrrd(dir, "scan.nrrd", "", "16 16 16", &vec![0; N * N * N]);
    for options in
        ["two.seg.nrrd", "two.seg.nrrd --transfer labels", "scan.nrrd --transfer gray.json --labels two.seg.nrrd"]
    {
        let clear = r#"{"points": [{"value": 0, "color": [0, 0, 0], "opacity": 0}]}"#;
        fs::write(dir.join("gray.json"), clear).unwrap();
        let (image, _) =
            drawn(dir, &format!("{options} --size 32 --light off --frame volume --azimuth 0 --elevation 0"));
        let at = |x: usize, y: usize| image.pixels()[32 * y + x];
        let [ball, slab] = [at(16, 6), at(2, 16)];
        assert!(ball[0] > 0.8 && ball[1] < 0.1, "{options}: {ball:?}");
        assert!(slab[1] > 0.8 && slab[0] < 0.1, "{options}: {slab:?}");
    }
    let output = voxsplat(dir, "render scan.nrrd --transfer gray.json --mask two.seg.nrrd -o b.png");
    assert!(complaint(&output).contains("two.seg.nrrd has 2 layers of labels"));
    // A label of one layer is none of another.
    let of = |channel| {
        let options = LoadOptions { channel: Some(channel), ..LoadOptions::default() };
        Labels::stated(&load(dir.join("two.seg.nrrd"), &options).unwrap()).label(1)
    };
    assert_eq!([of(0), of(1)].map(|label| label.name), ["ball", "slab"]);
}

#[test]
fn labels_of_another_lattice_are_taken_with_a_word() {
    let dir = folder();
    let dir = dir.path();
    nrrd(dir, "scan.nrrd", "", "16 16 16", &(0..N * N * N).map(|i| (i % 251) as u8).collect::<Vec<_>>());
    nrrd(dir, "same.nrrd", "", "16 16 16", &labels());
    nrrd(dir, "moved.nrrd", "space origin: (4,0,0)\n", "16 16 16", &labels());
    nrrd(dir, "away.nrrd", "space origin: (400,0,0)\n", "16 16 16", &labels());
    // Of voxels moved by 4, those from 12 on along x.
    let count = |from: usize| (0..N * N * N).filter(|&i| label(i) > 0 && i % N >= from).count() as f64;
    let outside = format!("; {:.1} % of its labelled voxels lie outside", 100.0 * count(12) / count(0));
    let (_, said) = drawn(dir, "scan.nrrd --transfer gray --size 8 --labels same.nrrd");
    assert!(!said.contains("lattice"), "{said}");
    for option in ["labels", "mask"] {
        let (_, said) = drawn(dir, &format!("scan.nrrd --transfer gray --size 8 --{option} moved.nrrd"));
        let expected = format!("note: --{option} moved.nrrd: using the nearest label of each voxel because");
        assert!(said.contains(&expected) && said.contains(&outside), "{said}");
        let output =
            voxsplat(dir, &format!("render scan.nrrd --transfer gray --light off --{option} away.nrrd -o b.png"));
        let said = complaint(&output);
        assert!(said.starts_with(&format!("--{option}: away.nrrd: nothing of it lies in the volume")), "{said}");
        assert_eq!(output.status.code(), Some(2));
    }
}

#[test]
fn legends_name_what_shows() {
    let dir = folder();
    let dir = dir.path();
    nrrd(dir, "kidney.seg.nrrd", SEGMENTS, "16 16 16", &labels());
    nrrd(dir, "scan.nrrd", "", "16 16 16", &(0..N * N * N).map(|i| (i % 251) as u8).collect::<Vec<_>>());
    let data = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/data/volumes");
    for name in ["several.ome.tif", "rgb.nii"] {
        fs::copy(data.join(name), dir.join(name)).unwrap();
    }
    // How many pixels of a colour the upper left has: of a patch, all.
    let patch = |options: &str, color: [u8; 3]| {
        let (image, _) = drawn(dir, &format!("{options} --size 128 --frame volume --margin 0.4"));
        let bytes = image.to_rgba8(Background::default());
        let corner = (0..48).flat_map(|y| (0..48).map(move |x| 4 * (128 * y + x)));
        corner.filter(|&at| bytes[at..at + 3] == color).count()
    };
    let [kidney, tumour] = [[255, 64, 0], [0, 0, 255]];
    let base = "kidney.seg.nrrd --transfer labels --light off";
    assert_eq!(patch(base, kidney), 0);
    assert!(patch(&format!("{base} --legend"), kidney) >= 64 && patch(&format!("{base} --legend"), tumour) >= 64);
    // A label that is off, or cut away, is not named.
    assert_eq!(patch(&format!("{base} --legend --label 9:off"), tumour), 0);
    assert_eq!(patch(&format!("{base} --legend --clip voxels::6,:,:"), tumour), 0);
    assert!(patch(&format!("{base} --legend --clip voxels::6,:,:"), kidney) >= 64);
    assert!(patch("several.ome.tif --legend --channel 0:red --channel 1:lime", [255, 0, 0]) >= 64);
    let masked = "scan.nrrd --transfer gray --labels kidney.seg.nrrd --mask kidney.seg.nrrd:4 --legend";
    assert!(patch(masked, tumour) >= 64);
    let refused = |options: &str, reason: &str| {
        let output = voxsplat(dir, &format!("render {options} --legend -o b.png"));
        let said = complaint(&output);
        assert!(output.status.code() == Some(2) && said.contains(reason), "{options}: {said}");
        assert!(!dir.join("b.png").exists());
    };
    refused("scan.nrrd --transfer gray", "--legend names labels and channels, and there are none");
    refused("rgb.nii --reference", "--legend names labels and channels, and there are none");
    refused("kidney.seg.nrrd --transfer labels --size 64", "expected sides of 128");
    refused("kidney.seg.nrrd --transfer labels --model xray", "an X-ray is white");
    let output =
        voxsplat(dir, "render kidney.seg.nrrd --legend --transfer labels --label all:off --reference -o b.png");
    assert!(String::from_utf8_lossy(&output.stderr).contains("--legend: no label is visible"));
    // Nothing is written before a refusal.
    let output = voxsplat(dir, "render several.ome.tif -o b.png --save-transfer t.json --reference");
    assert!(
        String::from_utf8_lossy(&output.stderr).contains("not for several channels") && !dir.join("t.json").exists()
    );
}

/// An element of DICOM, little-endian with explicit types.
fn element(tag: u32, kind: &str, value: &[u8]) -> Vec<u8> {
    let padding = if value.len().is_multiple_of(2) { &[][..] } else { b" " };
    let length = (value.len() + padding.len()) as u16;
    let tag = [(tag >> 16) as u16, tag as u16].map(u16::to_le_bytes).concat();
    [&tag, kind.as_bytes(), &length.to_le_bytes(), value, padding].concat()
}

/// A slice of the scan that the segmentations of tests/data/volumes are of, in a series.
pub(crate) fn slice(series: u16, n: u32) -> Vec<u8> {
    let place = [10.0 - 1.2 * f64::from(n), -20.0 + 1.6 * f64::from(n), 30.5].map(|p| p.to_string()).join("\\");
    let word = |tag, word: u16| element(tag, "US", &word.to_le_bytes());
    let text = |tag, kind, text: &str| element(tag, kind, text.as_bytes());
    let samples: Vec<u8> = (0..120).flat_map(|n| if (36..84).contains(&n) { [0, 4] } else { [0; 2] }).collect();
    let pixels = [&[0xe0, 0x7f, 0x10, 0, b'O', b'W', 0, 0, 240, 0, 0, 0][..], &samples].concat();
    let elements = [
        text(0x0008_0021, "DA", "20261126"),
        text(0x0008_0060, "CS", "CT"),
        text(0x0008_103e, "LO", &format!("scan {series}")),
        text(0x0020_000e, "UI", &format!("1.2.3.4.5.6.7.8.{series}")),
        text(0x0020_0011, "IS", &series.to_string()),
        text(0x0020_0032, "DS", &place),
        text(0x0020_0037, "DS", "0.8\\0.6\\0\\0\\0\\-1"),
        word(0x0028_0010, 10),
        word(0x0028_0011, 12),
        text(0x0028_0030, "DS", "0.75\\0.5"),
        word(0x0028_0100, 16),
        pixels,
    ];
    [vec![0; 128], b"DICM".to_vec(), element(0x0002_0010, "UI", b"1.2.840.10008.1.2.1"), elements.concat()].concat()
}

#[test]
fn segmentations_of_dicom_lie_over_their_series() {
    let dir = folder();
    let dir = dir.path();
    fs::create_dir(dir.join("ct")).unwrap();
    (0..8).for_each(|n| fs::write(dir.join(format!("ct/{n}.dcm")), slice(1, n)).unwrap());
    for name in ["seg-binary.dcm", "seg-apart.dcm"] {
        fs::copy(volume_file(name), dir.join(name)).unwrap();
    }
    fs::write(dir.join("clear.json"), r#"{"points": [{"value": 0, "color": [0, 0, 0], "opacity": 0}]}"#).unwrap();
    let over = "ct --transfer clear.json --frame volume --light off --size 32 --labels";
    let (whole, said) = drawn(dir, &format!("{over} seg-apart.dcm"));
    assert!(!said.contains("lattice"), "{said}");
    // The first slice has no frame, so the lattice begins at the second.
    let (sparse, said) = drawn(dir, &format!("{over} seg-binary.dcm"));
    assert!(said.contains("(12 x 10 x 7); none of its labelled voxels lie outside"), "{said}");
    let shown = |image: &Image, color: [usize; 2]| {
        image.pixels().iter().filter(|pixel| pixel[color[0]] > 0.3 && pixel[color[1]] < 0.1).count()
    };
    // The kidney is orange, the tumour that overlaps with it blue.
    for image in [&whole, &sparse] {
        assert!(
            shown(image, [0, 2]) > 20 && shown(image, [2, 0]) > 20,
            "{} {}",
            shown(image, [0, 2]),
            shown(image, [2, 0])
        );
    }
    let (alone, said) = drawn(dir, "seg-binary.dcm --transfer labels --light off --size 32 --label tumour:off");
    assert!(!said.contains("using --transfer"), "{said}");
    assert!(shown(&alone, [0, 2]) > 20 && shown(&alone, [2, 0]) == 0);
    let listed = stdout(&voxsplat(dir, "info seg-apart.dcm --labels"));
    assert!(listed.lines().any(|l| l.contains("#ff4000") && l.ends_with("Left kidney")), "{listed}");
    // Of segments that overlap too, with the number of voxels of each.
    let listed = stdout(&voxsplat(dir, "info seg-binary.dcm --labels"));
    let lines: Vec<Vec<&str>> = listed.lines().skip(1).map(|line| line.split_whitespace().collect()).collect();
    let found: Vec<(&str, &str)> = lines.iter().map(|words| (words[0], words[3])).collect();
    assert_eq!(found, [("0", "748"), ("1", "90"), ("3", "2"), ("2", "40")], "{listed}");
    let output = voxsplat(dir, "render ct --transfer clear.json --mask seg-binary.dcm -o b.png");
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(output.status.code() == Some(2) && said.contains("seg-binary.dcm has 2 layers of labels"), "{said}");
}

#[test]
fn series_of_a_folder_are_listed() {
    let dir = folder();
    let dir = dir.path();
    fs::create_dir(dir.join("study")).unwrap();
    (0..8).for_each(|n| fs::write(dir.join(format!("study/a{n}.dcm")), slice(2, n)).unwrap());
    (0..3).for_each(|n| fs::write(dir.join(format!("study/b{n}.dcm")), slice(3, 2 * n)).unwrap());
    fs::copy(volume_file("seg-binary.dcm"), dir.join("study/c.dcm")).unwrap();
    let output = voxsplat(dir, "render study -o a.png");
    let said = complaint(&output);
    assert_eq!(output.status.code(), Some(1));
    assert_eq!(
        said,
        "study: holds 3 series: 1 is CT \"scan 2\" of 8 files, 2 is CT \"scan 3\" of 3 files, 3 is SEG \"organs\" of 1 \
         file: choose one with --series N (info lists them)"
    );
    let table = stdout(&voxsplat(dir, "info study"));
    let expected = "\
series  modality  files  lattice      spacing         date        uid            description
1       CT        8      12 x 10 x 8  0.5 x 0.75 x 2  2026-11-26  ….4.5.6.7.8.2  scan 2
2       CT        3      12 x 10 x 3  0.5 x 0.75 x 4  2026-11-26  ….4.5.6.7.8.3  scan 3
3       SEG       1      12 x 10 x 7  0.5 x 0.75 x 2  2026-11-26  …3.8.498.77.5  organs
describe one: voxsplat info study --series N
";
    assert_eq!(table, expected);
    let json: serde_json::Value = serde_json::from_slice(&voxsplat(dir, "info study --json").stdout).unwrap();
    assert_eq!(json["series"][1]["dims"], serde_json::json!([12, 10, 3]));
    assert_eq!(json["series"][2]["uid"], "1.2.826.0.1.3680043.8.498.77.5");
    assert!(stdout(&voxsplat(dir, "info study --series 2")).contains("lattice      12 x 10 x 3"));
    let many = dir.join("many");
    fs::create_dir(&many).unwrap();
    (10..90).for_each(|n| fs::write(many.join(format!("{n}.dcm")), slice(n, 0)).unwrap());
    let said = complaint(&voxsplat(dir, "render many -o a.png"));
    assert!(said.contains("4 is CT \"scan 13\" of 1 file, and 76 others: choose"), "{said}");
}
