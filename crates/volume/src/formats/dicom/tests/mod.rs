//! Files as scanners write them, made by the tests: lattices, series and values.

mod lattices;
mod series;
mod values;

use std::collections::BTreeMap;
use std::path::Path;

use glam::DVec3;
use tempfile::TempDir;

use crate::formats::{LoadOptions, load};
use crate::volume::Volume;

/// A DICOM file of a test: elements by tag, with their types.
#[derive(Clone, Default)]
struct File(BTreeMap<u32, (&'static str, Vec<u8>)>);

/// The encoding of a file: without types, or in big-endian numbers.
#[derive(Clone, Copy, PartialEq)]
enum Coding {
    Explicit,
    Implicit,
    Big,
}

impl File {
    fn bytes(mut self, tag: u32, kind: &'static str, value: &[u8]) -> Self {
        let mut value = value.to_vec();
        if value.len() % 2 == 1 {
            value.push(if kind == "UI" || kind.starts_with('O') { 0 } else { b' ' });
        }
        self.0.insert(tag, (kind, value));
        self
    }

    fn text(self, tag: u32, kind: &'static str, text: &str) -> Self {
        self.bytes(tag, kind, text.as_bytes())
    }

    fn words(self, tag: u32, words: &[u16]) -> Self {
        self.bytes(tag, "US", &words.iter().flat_map(|word| word.to_le_bytes()).collect::<Vec<u8>>())
    }

    fn double(self, tag: u32, number: f64) -> Self {
        self.bytes(tag, "FD", &number.to_le_bytes())
    }

    /// Adds a sequence of items.
    fn items(self, tag: u32, items: &[Self]) -> Self {
        let item = |item: &Self| {
            let elements = item.elements(Coding::Explicit);
            [&[0xfe, 0xff, 0x00, 0xe0][..], &(elements.len() as u32).to_le_bytes(), &elements].concat()
        };
        self.bytes(tag, "SQ", &items.iter().flat_map(item).collect::<Vec<u8>>())
    }

    /// Adds a grey picture of 16 bits with unit spacing; its frames are as many as the samples fill.
    fn picture(self, [columns, rows]: [u16; 2], samples: &[u16]) -> Self {
        let frames = samples.len() / usize::from(columns) / usize::from(rows);
        let file = if frames > 1 { self.text(0x0028_0008, "IS", &frames.to_string()) } else { self };
        file.words(0x0028_0002, &[1])
            .text(0x0028_0004, "CS", "MONOCHROME2")
            .words(0x0028_0010, &[rows])
            .words(0x0028_0011, &[columns])
            .text(0x0028_0030, "DS", "1\\1")
            .words(0x0028_0100, &[16])
            .words(0x0028_0101, &[16])
            .words(0x0028_0102, &[15])
            .words(0x0028_0103, &[0])
            .bytes(0x7fe0_0010, "OW", &samples.iter().flat_map(|sample| sample.to_le_bytes()).collect::<Vec<u8>>())
    }

    /// Makes the picture transverse, at this position.
    fn at(self, [x, y, z]: [f64; 3]) -> Self {
        self.text(0x0020_0032, "DS", &format!("{x}\\{y}\\{z}")).text(0x0020_0037, "DS", "1\\0\\0\\0\\1\\0")
    }

    fn without(mut self, tag: u32) -> Self {
        self.0.remove(&tag);
        self
    }

    fn elements(&self, coding: Coding) -> Vec<u8> {
        let is_big = coding == Coding::Big;
        let number = |number: u32, bytes: usize| {
            let mut all = number.to_le_bytes()[..bytes].to_vec();
            if is_big {
                all.reverse();
            }
            all
        };
        let mut out = Vec::new();
        for (&tag, (kind, value)) in &self.0 {
            out.extend([number(tag >> 16, 2), number(tag & 0xffff, 2)].concat());
            let is_long = ["OB", "OD", "OF", "OW", "SQ", "UN"].contains(kind);
            if coding != Coding::Implicit {
                out.extend(kind.as_bytes());
                out.extend(if is_long { &[0; 2][..] } else { &[] });
            }
            out.extend(number(value.len() as u32, if is_long || coding == Coding::Implicit { 4 } else { 2 }));
            // Values of whole numbers are words.
            let swaps = is_big && ["US", "OW"].contains(kind);
            out.extend(value.chunks(2).flat_map(|two| if swaps { [two[1], two[0]] } else { [two[0], two[1]] }));
        }
        out
    }

    fn whole(&self) -> Vec<u8> {
        let syntax = Self::default().text(0x0002_0010, "UI", "1.2.840.10008.1.2.1").elements(Coding::Explicit);
        [&[0; 128][..], b"DICM", &syntax, &self.elements(Coding::Explicit)].concat()
    }
}

/// Makes a folder of these files, in their order: 00.dcm, 01.dcm and so on.
fn folder(files: &[File]) -> TempDir {
    let folder = tempfile::tempdir().unwrap();
    fill(folder.path(), files);
    folder
}

fn fill(folder: &Path, files: &[File]) {
    std::fs::create_dir_all(folder).unwrap();
    for (n, file) in files.iter().enumerate() {
        std::fs::write(folder.join(format!("{n:02}.dcm")), file.whole()).unwrap();
    }
}

fn at_time(folder: &Path, time: u32) -> Volume {
    load(folder, &LoadOptions { time: Some(time), ..LoadOptions::default() }).unwrap()
}

fn read(files: &[File]) -> Volume {
    at_time(folder(files).path(), 0)
}

fn error(source: &Path) -> String {
    load(source, &LoadOptions::default()).unwrap_err().to_string()
}

/// Returns all values of a volume, x fastest.
fn values(volume: &Volume) -> Vec<f64> {
    let in_memory = volume.in_memory().unwrap();
    (0..in_memory.samples().len()).map(|n| in_memory.value(n)).collect()
}

/// Returns the steps from one sample to the next along each axis, and the place of the first sample.
fn lattice(volume: &Volume) -> [[f64; 3]; 4] {
    let affine = volume.grid().to_world();
    let [x, y, z] = DVec3::AXES.map(|axis| affine.transform_vector3(axis).to_array());
    [x, y, z, affine.translation.to_array()]
}
