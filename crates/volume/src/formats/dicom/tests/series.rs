//! Series, kinds of slices, copies and discs.

use std::fs::create_dir;

use super::*;
use crate::formats::list_series;

/// Makes a slice of one pixel, with its number.
fn slice(z: u16, value: u16, number: u16) -> File {
    let file = File::default().at([0.0, 0.0, f64::from(z)]).picture([1, 1], &[value]);
    file.text(0x0020_0013, "IS", &number.to_string()).text(0x0020_0012, "IS", "1")
}

#[test]
fn slices_of_two_kinds_at_one_place_are_two_volumes() {
    type Change = fn(File, u16) -> File;
    let echo: Change = |file, kind| file.text(0x0018_0081, "DS", ["10", "30"][usize::from(kind)]);
    let cases: [(Change, &str); 7] = [
        (echo, "time points differ in EchoTime: 10, 30"),
        (|file, kind| file.double(0x0018_9087, 1000.0 * f64::from(kind)), "DiffusionBValue: 0, 1000"),
        (
            |file, kind| {
                let file = file.text(0x0019_0010, "LO", "SIEMENS MR HEADER");
                file.text(0x0019_100c, "IS", ["0", "800"][usize::from(kind)])
            },
            "DiffusionBValue: 0, 800",
        ),
        (
            |file, kind| {
                let file = file.text(0x0043_0010, "LO", "GEMS_PARM_01");
                file.text(0x0043_1039, "IS", ["0\\8\\0\\0", "1000000800\\8\\0\\0"][usize::from(kind)])
            },
            "DiffusionBValue: 0, 800",
        ),
        (
            |file, kind| {
                let file = file.text(0x2001_0010, "LO", "Philips Imaging DD 001");
                file.bytes(0x2001_1003, "FL", &(700.0 * f32::from(kind)).to_le_bytes())
            },
            "DiffusionBValue: 0, 700",
        ),
        (
            |file, kind| {
                file.text(0x0008_0008, "CS", ["ORIGINAL\\PRIMARY\\M", "ORIGINAL\\PRIMARY\\P"][usize::from(kind)])
            },
            "ImageType: ORIGINAL\\PRIMARY\\M, ORIGINAL\\PRIMARY\\P",
        ),
        (|file, _| file, "in the order of InstanceNumber"),
    ];
    for (change, note) in cases {
        // The volumes one after the other.
        let files = [0, 1].map(|kind| [0, 1, 2].map(|z| change(slice(z, 10 * kind + z, 3 * kind + z), kind)));
        let folder = folder(&files.concat());
        for time in 0..2 {
            let volume = at_time(folder.path(), time);
            let expected = [0, 1, 2].map(|z| f64::from(10 * time + z));
            assert_eq!((values(&volume), volume.contents().times), (expected.to_vec(), 2), "{note}");
            let notes = &volume.contents().notes;
            assert!(notes.len() == 1 && notes[0].contains(note), "{note}: {notes:?}");
        }
    }
    // Times and numbers in another order in each slice do not mix two echoes.
    let mixed = |z: u16, kind: u16| {
        let swapped = (kind + z) % 2;
        let file = echo(slice(z, 10 * kind + z, 2 * z + swapped), kind);
        file.text(0x0008_0033, "TM", &format!("1000{:02}", 2 * z + swapped))
    };
    let folder = folder(&[0, 1, 2].map(|z| [mixed(z, 1), mixed(z, 0)]).concat());
    assert_eq!(values(&at_time(folder.path(), 0)), [0.0, 1.0, 2.0]);
    assert_eq!(values(&at_time(folder.path(), 1)), [10.0, 11.0, 12.0]);
    // Two echoes at two times.
    let timed = |z: u16, kind: u16, time: u16| {
        let swapped = if z == 1 { 3 - (2 * kind + time) } else { 2 * kind + time };
        echo(slice(z, 100 * kind + 10 * time + z, 4 * z + swapped), kind).text(0x0020_0012, "IS", &time.to_string())
    };
    let kinds = |z: u16| [timed(z, 0, 0), timed(z, 1, 1), timed(z, 0, 1), timed(z, 1, 0)];
    let folder = super::folder(&[0, 1, 2].map(kinds).concat());
    for (time, first) in [(0, 0.0), (1, 10.0), (2, 100.0), (3, 110.0)] {
        assert_eq!(values(&at_time(folder.path(), time)), [first, first + 1.0, first + 2.0]);
    }
}

#[test]
fn frames_of_two_echoes_are_two_volumes() {
    let frame = |z: f64, echo: f64| {
        let place = File::default().items(0x0020_9113, &[File::default().at([0.0, 0.0, z])]);
        place.items(0x0018_9114, &[File::default().double(0x0018_9082, echo)])
    };
    let frames = [frame(0.0, 30.0), frame(0.0, 10.0), frame(2.0, 10.0), frame(2.0, 30.0)];
    let file = File::default().picture([1, 1], &[3, 1, 2, 4]).items(0x5200_9230, &frames);
    let folder = folder(&[file]);
    for (time, expected) in [(0, [1.0, 2.0]), (1, [3.0, 4.0])] {
        let volume = at_time(folder.path(), time);
        assert_eq!((values(&volume).as_slice(), volume.contents().times), (&expected[..], 2));
        assert_eq!(volume.contents().notes, ["time points differ in EchoTime: 10, 30"]);
    }
}

#[test]
fn copies_of_a_file_are_left_out() {
    let file = |z: u16| slice(z, z, z).text(0x0008_0018, "UI", &format!("1.2.{z}"));
    let originals = [0, 1, 2].map(file);
    let volume = read(&[originals.clone(), originals.clone()].concat());
    assert_eq!((values(&volume), volume.contents().times), (vec![0.0, 1.0, 2.0], 1));
    let note = "3 files of the series are copies and left out, such as 03.dcm of 00.dcm";
    assert_eq!(volume.contents().notes, [note]);
    assert!(read(&originals).contents().notes.is_empty());
    // Files that a tool has made anonymous may all have one identifier.
    let volume = read(&originals.map(|file| file.text(0x0008_0018, "UI", "1.2.3")));
    assert_eq!((values(&volume), volume.contents().notes.len()), (vec![0.0, 1.0, 2.0], 0));
}

#[test]
fn the_folders_of_a_disc_are_listed_with_their_series() {
    let disc = tempfile::tempdir().unwrap();
    let series = |name: &str, number: u16, slices: u16| {
        let file = |z: u16| {
            let file = slice(z, z, z).text(0x0008_0060, "CS", "CT").text(0x0008_103e, "LO", name);
            file.text(0x0020_000e, "UI", &format!("1.{number}")).text(0x0020_0011, "IS", &number.to_string())
        };
        (0..slices).map(file).collect::<Vec<File>>()
    };
    let inner = disc.path().join("DICOM");
    create_dir(&inner).unwrap();
    assert!(error(disc.path()).ends_with("is a directory without TIFF or DICOM files, and no OME-Zarr"));
    fill(&inner.join("S10"), &series("legs", 1, 2));
    fill(&inner.join("S9"), &[series("head", 2, 3), series("neck", 3, 1)].concat());
    let listed = "give one of the folders in it: DICOM/S9 (CT \"head\" of 3 files; CT \"neck\" of 1 file), \
                  DICOM/S10 (CT \"legs\" of 2 files)";
    let says = error(disc.path()).replace('\\', "/");
    assert!(says.ends_with(&format!("no OME-Zarr: {listed}")), "{says}");
    // With its directory file, by the folder and by the file.
    let directory = File::default().text(0x0008_0016, "UI", "1.2.840.10008.1.3.10").whole();
    std::fs::write(disc.path().join("DICOMDIR"), directory).unwrap();
    for source in [disc.path().to_owned(), disc.path().join("DICOMDIR")] {
        let says = error(&source).replace('\\', "/");
        assert!(says.ends_with(&format!("is DICOM without pixels: {listed}")), "{says}");
    }
    assert_eq!(list_series(inner.join("S9")).unwrap().len(), 2);
    for n in 0..4 {
        fill(&disc.path().join(format!("more{n}")), &series("", 9, 1));
    }
    assert!(error(disc.path()).ends_with(" and 2 others"), "{}", error(disc.path()));
}
