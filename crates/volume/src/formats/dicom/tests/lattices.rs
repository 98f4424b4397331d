//! Places and distances of slices.

use std::slice;

use super::*;
use crate::formats::MissingSlices;

/// Makes a mosaic of five slices of 2 x 1 pixels in 3 x 3 tiles; slice n has the values `start + n`.
fn mosaic(start: u16) -> File {
    let tile = |x: usize, y: usize| if 3 * y + x / 2 < 5 { start + (3 * y + x / 2) as u16 } else { 0 };
    let samples: Vec<u16> = (0..18).map(|n| tile(n % 6, n / 6)).collect();
    File::default()
        .text(0x0008_0008, "CS", "ORIGINAL\\PRIMARY\\M\\ND\\MOSAIC")
        .text(0x0018_0088, "DS", "3")
        .text(0x0020_0012, "IS", &start.to_string())
        .at([-6.0, -3.0, 7.0])
        .picture([6, 3], &samples)
        .text(0x0028_0030, "DS", "4\\2")
}

/// Makes a CSA header of the second or the first kind with one element before these.
fn csa(is_second: bool, elements: &[(&str, &[&str])]) -> Vec<u8> {
    let mut out = if is_second { b"SV10\x04\x03\x02\x01".to_vec() } else { Vec::new() };
    out.extend([(elements.len() as u32 + 1).to_le_bytes(), 77_u32.to_le_bytes()].concat());
    let first: (&str, &[&str]) = ("EchoLinePosition", &["64"]);
    for (name, values) in std::iter::once(&first).chain(elements) {
        let mut head = [0; 84];
        head[..name.len()].copy_from_slice(name.as_bytes());
        head[76] = values.len() as u8;
        out.extend(head);
        for value in *values {
            let length = value.len() as u32 + 1;
            // The older header adds the number of items of its first element.
            let stated = if is_second { [0, length] } else { [length + 1, 0] };
            out.extend(stated.into_iter().chain([77, 205]).flat_map(u32::to_le_bytes));
            out.extend(value.bytes().chain(std::iter::repeat_n(0, 1 + (3 - value.len() % 4))));
        }
    }
    out
}

#[test]
fn the_tiles_of_a_mosaic_are_slices() {
    let numbered = |file: File| file.text(0x0019_0010, "LO", "SIEMENS MR HEADER").words(0x0019_100a, &[5]);
    let expected = |start: u16| (0..5).flat_map(|n| [f64::from(start + n); 2]).collect::<Vec<f64>>();
    let folder = folder(&[numbered(mosaic(100)), numbered(mosaic(200))]);
    for (time, start) in [(0, 100), (1, 200)] {
        let volume = at_time(folder.path(), time);
        assert_eq!((volume.grid().dims(), volume.contents().times), ([2, 1, 5], 2));
        assert_eq!(values(&volume), expected(start));
        // The corner is half of the missing width and height inside of the stated one.
        let ahead = [[2.0, 0.0, 0.0], [0.0, 4.0, 0.0], [0.0, 0.0, 3.0], [-2.0, 1.0, 7.0]];
        assert_eq!(lattice(&volume), ahead);
    }
    // Without the number, a CSA header states it, and the direction of the slices.
    for is_second in [true, false] {
        let elements: [(&str, &[&str]); 2] =
            [("NumberOfImagesInMosaic", &["5"]), ("SliceNormalVector", &["0.0", "0.0", "-1.00000000"])];
        let header = csa(is_second, &elements);
        let file = mosaic(100).text(0x0029_0011, "LO", "SIEMENS CSA HEADER").bytes(0x0029_1110, "OB", &header);
        let volume = read(slice::from_ref(&file));
        let reversed: Vec<f64> = expected(100).into_iter().rev().collect();
        assert_eq!((volume.grid().dims(), values(&volume)), ([2, 1, 5], reversed), "{is_second}");
        assert_eq!(lattice(&volume)[2..], [[0.0, 0.0, 3.0], [-2.0, 1.0, -5.0]]);
        // A header that is cut anywhere is read or says nothing.
        for end in (0..header.len()).step_by(9) {
            read(&[file.clone().bytes(0x0029_1110, "OB", &header[..end])]);
        }
    }
    let volume = read(&[mosaic(100)]);
    assert_eq!(volume.grid().dims(), [6, 3, 1]);
    assert!(volume.contents().notes[0].contains("mosaic without a number of tiles"), "{:?}", volume.contents().notes);
    let many = super::folder(&[numbered(mosaic(100)).words(0x0019_100a, &[10])]);
    assert!(error(many.path()).contains("is a mosaic of 10 tiles, which 6 x 3 pixels do not hold"));
}

#[test]
fn frames_of_nuclear_medicine_lie_along_the_normal_of_the_detector() {
    let detector = File::default().at([-19.0, -15.0, 100.0]);
    let file = |gap: &str| {
        File::default()
            .text(0x0008_0060, "CS", "NM")
            .text(0x0018_0088, "DS", gap)
            .picture([1, 1], &[1, 2, 3])
            .items(0x0054_0022, &[detector.clone(), File::default().at([0.0; 3])])
    };
    for (gap, first, expected) in [("4", 100.0, [1.0, 2.0, 3.0]), ("-4", 92.0, [3.0, 2.0, 1.0])] {
        let volume = read(&[file(gap)]);
        assert_eq!((values(&volume).as_slice(), volume.is_oriented()), (&expected[..], true), "{gap}");
        assert_eq!(lattice(&volume)[2..], [[0.0, 0.0, 4.0], [-19.0, -15.0, first]], "{gap}");
    }
    // The frames of a gated study state their slices: those of two moments share them.
    let gated = file("4").picture([1, 1], &[1, 2, 3, 11, 12, 13]).words(0x0054_0080, &[1, 2, 3, 1, 2, 3]);
    let folder = folder(&[gated]);
    for (time, expected) in [(0, [1.0, 2.0, 3.0]), (1, [11.0, 12.0, 13.0])] {
        let volume = at_time(folder.path(), time);
        assert_eq!((values(&volume).as_slice(), volume.contents().times), (&expected[..], 2));
    }
}

#[test]
fn frames_without_positions_are_as_far_apart_as_the_file_states() {
    let file = || File::default().picture([1, 1], &[1, 2, 3]).text(0x0028_0030, "DS", "2\\2");
    let placed = || file().at([-5.0, -4.0, 50.0]);
    for (file, gap, place) in [
        (file().text(0x0018_0050, "DS", "3"), 3.0, [0.0; 3]),
        (file().text(0x0018_0050, "DS", "3").text(0x0018_0088, "DS", "5"), 5.0, [0.0; 3]),
        (placed().text(0x0018_0050, "DS", "3"), 3.0, [-5.0, -4.0, 50.0]),
        // Outside of nuclear medicine the sign says nothing.
        (placed().text(0x0018_0088, "DS", "-5"), 5.0, [-5.0, -4.0, 50.0]),
    ] {
        let volume = read(&[file]);
        assert_eq!(lattice(&volume)[2..], [[0.0, 0.0, gap], place]);
        assert_eq!((values(&volume), volume.contents().notes.len()), (vec![1.0, 2.0, 3.0], 0));
    }
    let unstated = read(&[placed()]);
    assert_eq!(lattice(&unstated)[2..], [[0.0, 0.0, 1.0], [-5.0, -4.0, 50.0]]);
    assert!(unstated.contents().notes[0].starts_with("the file states no distance of slices"));
    // Captures follow one another by their numbers.
    let capture = |n: u16| {
        let class = "1.2.840.10008.5.1.4.1.1.7";
        let file = File::default().text(0x0008_0016, "UI", class).text(0x0020_0013, "IS", &n.to_string());
        file.picture([1, 1], &[n]).text(0x0018_0050, "DS", "3")
    };
    assert_eq!(lattice(&read(&[capture(2), capture(1)]))[2], [0.0, 0.0, 3.0]);
    // A position that all frames share is one place: the frames are points in time.
    let shared = File::default().items(0x0020_9113, &[File::default().at([1.0, 2.0, 3.0])]);
    let volume = read(&[file().items(0x5200_9229, &[shared])]);
    assert_eq!((volume.grid().dims(), volume.contents().times), ([1, 1, 1], 3));
}

#[test]
fn other_elements_stand_in_for_the_spacing_of_pixels() {
    let section = |z: f64| File::default().at([0.0, 0.0, z]).picture([2, 2], &[1, 2, 3, 4]).without(0x0028_0030);
    let region = File::default().words(0x0018_6024, &[3]).words(0x0018_6026, &[3]);
    let region = region.double(0x0018_602c, 0.02).double(0x0018_602e, 0.04);
    type Change = fn(File, &File) -> File;
    let cases: [(Change, [f64; 2], &str); 6] = [
        (|file, _| file.text(0x0018_1164, "DS", "0.4\\0.2"), [0.2, 0.4], "ImagerPixelSpacing, as measured at"),
        (|file, _| file.text(0x0018_2010, "DS", "0.4\\0.2"), [0.2, 0.4], "NominalScannedPixelSpacing"),
        (|file, _| file.text(0x3002_0011, "DS", "0.4\\0.2"), [0.2, 0.4], "ImagePlanePixelSpacing"),
        (|file, region| file.items(0x0018_6011, slice::from_ref(region)), [0.2, 0.4], "ultrasound region"),
        (|file, _| file.text(0x0028_0034, "IS", "3\\2"), [1.0, 1.5], "states no pixel spacing"),
        (|file, _| file, [1.0, 1.0], "states no pixel spacing: pixels are taken to be 1 apart"),
    ];
    for (change, [x, y], note) in cases {
        let files = [0.0, 0.5].map(|z| change(section(z), &region));
        let volume = read(&files);
        assert_eq!(lattice(&volume), [[x, 0.0, 0.0], [0.0, y, 0.0], [0.0, 0.0, 0.5], [0.0; 3]], "{note}");
        let notes = &volume.contents().notes;
        assert!(notes.len() == 1 && notes[0].contains(note), "{notes:?}");
        // Pixels whose spacing is stated need no other.
        let stated = read(&files.map(|file| file.text(0x0028_0030, "DS", "5\\5")));
        assert_eq!((lattice(&stated)[0], stated.contents().notes.len()), ([5.0, 0.0, 0.0], 0));
        let options = LoadOptions { spacing: Some([1.0; 3]), ..LoadOptions::default() };
        let given = load(folder(&[section(0.0), section(1.0)]).path(), &options).unwrap();
        assert!(given.contents().notes.is_empty());
    }
}

#[test]
fn unequally_spaced_slices_are_interpolated_on_request() {
    // The value of a slice is its place.
    let series = |places: &[u16]| {
        let slice = |z: &u16| File::default().at([0.0, 0.0, f64::from(*z)]).picture([1, 1], &[*z]);
        folder(&places.iter().map(slice).collect::<Vec<File>>())
    };
    let options = LoadOptions { missing_slices: MissingSlices::Interpolate, ..LoadOptions::default() };
    let uneven = series(&[0, 20, 40, 60, 110, 160]);
    let refused = load(uneven.path(), &LoadOptions::default()).unwrap_err();
    assert!(refused.to_string().contains("slices are unequally spaced: 50.0000 between 03.dcm and 04.dcm"));
    assert_eq!(refused.hint(), Some(crate::error::Hint::InterpolateSlices));
    let volume = load(uneven.path(), &options).unwrap();
    assert_eq!(values(&volume), [0.0, 20.0, 40.0, 60.0, 80.0, 100.0, 120.0, 140.0, 160.0]);
    assert_eq!(lattice(&volume)[2..], [[0.0, 0.0, 20.0], [0.0; 3]]);
    let note = "6 slices are 20.0000 to 50.0000 apart: interpolated to 9 slices, 20 apart";
    assert_eq!(volume.contents().notes, [note]);
    // Coarse first, and a length that the least gap does not divide: 95 are five steps of 19.
    let volume = load(series(&[0, 50, 75, 95]).path(), &options).unwrap();
    assert_eq!(values(&volume), [0.0, 19.0, 38.0, 57.0, 76.0, 95.0]);
    // Missing slices alone keep the others as they are.
    let volume = load(series(&[0, 20, 40, 80]).path(), &options).unwrap();
    assert_eq!(values(&volume), [0.0, 20.0, 40.0, 60.0, 80.0]);
    let far = load(series(&[0, 1, 40, 800]).path(), &options).unwrap_err().to_string();
    assert!(far.ends_with("slices are 1.0000 to 760.0000 apart, which is too unequal to interpolate"), "{far}");
}
