//! Samples, their maps to values, and files without a preamble.

use std::slice;

use super::*;
use crate::volume::Samples;

#[test]
fn floating_point_is_read() {
    let places = |file: File| file.at([0.0; 3]).without(0x0028_0101).without(0x0028_0102).without(0x0028_0103);
    let floats: Vec<u8> = [0.5_f32, -2.25, 1e-6, 8.5].iter().flat_map(|number| number.to_le_bytes()).collect();
    let file = places(File::default().picture([2, 2], &[0; 4])).without(0x7fe0_0010);
    let volume = read(&[file.clone().words(0x0028_0100, &[32]).bytes(0x7fe0_0008, "OF", &floats)]);
    assert_eq!(volume.in_memory().unwrap().samples(), &Samples::F32(vec![0.5, -2.25, 1e-6, 8.5]));
    let doubles: Vec<u8> = [0.1_f64, -2.25, 1e-300, 8.5].iter().flat_map(|number| number.to_le_bytes()).collect();
    let double = file.words(0x0028_0100, &[64]).bytes(0x7fe0_0009, "OD", &doubles);
    let volume = read(slice::from_ref(&double));
    assert_eq!(volume.in_memory().unwrap().samples(), &Samples::F64(vec![0.1, -2.25, 1e-300, 8.5]));
    let cut = folder(&[double.bytes(0x7fe0_0009, "OD", &doubles[..24])]);
    assert!(error(cut.path()).ends_with("is cut short: 1 frame needs 32 bytes, 24 are there"));
}

#[test]
fn real_world_values_count_if_the_rescale_changes_nothing() {
    let map = |slope: f64, intercept: f64| File::default().double(0x0040_9224, intercept).double(0x0040_9225, slope);
    let file = || File::default().at([0.0; 3]).picture([2, 1], &[0, 17]);
    let rescaled = |file: File, slope: &str| file.text(0x0028_1052, "DS", "0").text(0x0028_1053, "DS", slope);
    let both = [map(0.5, 1.0), map(7.0, 0.0)];
    let shared = File::default().items(0x0040_9096, &both);
    for (file, expected) in [
        // Of several maps the first counts.
        (file().items(0x0040_9096, &both), [1.0, 9.5]),
        (file().items(0x5200_9229, slice::from_ref(&shared)), [1.0, 9.5]),
        (rescaled(file(), "1").items(0x5200_9229, slice::from_ref(&shared)), [1.0, 9.5]),
        (rescaled(file(), "2").items(0x5200_9229, &[shared]), [0.0, 34.0]),
        (file(), [0.0, 17.0]),
    ] {
        assert_eq!(values(&read(&[file])), expected);
    }
}

#[test]
fn files_without_a_preamble_are_read() {
    let section = |z: u16| {
        let class = File::default().text(0x0008_0016, "UI", "1.2.840.10008.5.1.4.1.1.4");
        let file = class.text(0x0008_0018, "UI", &format!("1.2.{z}")).text(0x0008_0020, "DA", "20200101");
        file.at([0.0, 0.0, f64::from(z)]).picture([1, 1], &[10 * z])
    };
    let codings: [fn(&File) -> Vec<u8>; 5] = [
        |file| file.elements(Coding::Implicit),
        |file| file.elements(Coding::Explicit),
        |file| file.elements(Coding::Big),
        // Without a preamble alone, and without the mark too.
        |file| file.whole()[128..].to_vec(),
        |file| {
            let group = File::default().bytes(0x0002_0001, "OB", &[0, 1]).text(0x0002_0002, "UI", "1.2.3");
            [&group.elements(Coding::Explicit), &file.whole()[132..]].concat()
        },
    ];
    for (n, coding) in codings.iter().enumerate() {
        let folder = tempfile::tempdir().unwrap();
        (0..3).for_each(|z| std::fs::write(folder.path().join(format!("{z}.ima")), coding(&section(z))).unwrap());
        let volume = at_time(folder.path(), 0);
        assert_eq!(values(&volume), [0.0, 10.0, 20.0], "coding {n}");
        assert_eq!(values(&at_time(&folder.path().join("2.ima"), 0)), [20.0], "coding {n}");
    }
    // Bare samples are no elements.
    let folder = tempfile::tempdir().unwrap();
    let raw = folder.path().join("a.raw");
    for word in [0_u16, 2, 8, 0x0800] {
        std::fs::write(&raw, word.to_le_bytes().repeat(500)).unwrap();
        let options = LoadOptions {
            dims: Some([10, 10, 5]),
            sample_type: Some(crate::volume::SampleType::U16),
            ..LoadOptions::default()
        };
        assert_eq!(values(&load(&raw, &options).unwrap()), [f64::from(word); 500]);
    }
}
