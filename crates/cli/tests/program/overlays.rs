//! Overlays by the program: looks, notes, statistics, scenes and refusals; channels without a white blob.

use std::fs;
use std::path::Path;

use voxsplat::image::{Background, Image};

use crate::cli::{complaint, folder, stdout, voxsplat};

/// A NRRD of f32 in patient space: a cube of `edge` samples `spacing` apart around the origin.
fn nrrd(dir: &Path, name: &str, (edge, spacing): (usize, f64), value: impl Fn([f64; 3]) -> f64) {
    let first = -spacing * (edge - 1) as f64 / 2.0;
    let place = |i: usize| [i % edge, i / edge % edge, i / edge / edge].map(|p| first + spacing * p as f64);
    let samples = (0..edge.pow(3)).flat_map(|i| (value(place(i)) as f32).to_le_bytes());
    let header = format!(
        "NRRD0004\ntype: float\ndimension: 3\nspace: left-posterior-superior\nsizes: {edge} {edge} {edge}\n\
         space directions: ({spacing},0,0) (0,{spacing},0) (0,0,{spacing})\nspace origin: ({first},{first},{first})\n\
         encoding: raw\nendian: little\n\n"
    );
    fs::write(dir.join(name), header.bytes().chain(samples).collect::<Vec<u8>>()).unwrap();
}

fn length(place: [f64; 3]) -> f64 {
    place.iter().map(|p| p * p).sum::<f64>().sqrt()
}

/// A head of 24 mm at 1 mm, and a map at 3 mm: a blob over 0 at the left, one under 0 at the right.
fn head_and_map(dir: &Path) {
    nrrd(dir, "head.nrrd", (24, 1.0), |p| 100.0 / (1.0 + (length(p) - 10.0).exp()) + 3.0 * (p[0] * p[1]).sin());
    let blob = |[x, y, z]: [f64; 3], at: f64| (-((x - at).powi(2) + y * y + z * z) / 12.0).exp();
    nrrd(dir, "map.nrrd", (8, 3.0), |p| 8.0 * blob(p, 5.0) - 7.0 * blob(p, -5.0));
}

/// What the program said, and the picture.
fn drawn(dir: &Path, options: &str) -> (Image, String) {
    let output = voxsplat(dir, &format!("render {options} -o a.png"));
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(output.status.success(), "{options}: {said}");
    (Image::load(dir.join("a.png")).unwrap(), said)
}

#[test]
fn a_map_shows_within_an_isosurface() {
    let dir = folder();
    let dir = dir.path();
    head_and_map(dir);
    let hot = |opacity: &str| {
        let line = format!("head.nrrd --iso 60:#4060ff:{opacity} --overlay map.nrrd --size 48 --light headlight");
        let (image, said) = drawn(dir, &line);
        assert!(!said.contains("grey and translucent"), "{said}");
        assert!(image.pixels().iter().filter(|p| p[2] > 0.1 && p[2] > p[0]).count() > 100, "no surface");
        image.pixels().iter().filter(|p| p[0] > 0.3 && p[0] > p[2] + 0.1).count()
    };
    let [glass, wall] = ["0.2", "1"].map(hot);
    assert!(glass > 15 && wall == 0, "{glass} and {wall} hot pixels");
}

#[test]
fn a_map_lies_over_a_head_in_two_colours() {
    let dir = folder();
    let dir = dir.path();
    head_and_map(dir);
    let line = "head.nrrd --transfer mri --overlay map.nrrd --size 48";
    let (_, said) = drawn(dir, line);
    for note in [
        "note: using --overlay map.nrrd:two-sided@",
        "lie on both sides of 0 (other: --overlay FILE:TRANSFER@LO..HI)",
        "note: --overlay map.nrrd: using interpolated values because the lattice is another one (8 x 8 x 8); none of",
    ] {
        assert!(said.contains(note), "{note}: {said}");
    }
    assert!(!said.contains("grey and translucent"), "{said}");
    let (image, said) = drawn(dir, "head.nrrd --overlay map.nrrd --size 48");
    assert!(said.contains("note: using a grey and translucent volume because overlays lie over it"), "{said}");
    // The left of the patient, whose x is over 0, is at the right of the picture.
    let share = |hot: bool| {
        let pixels = image.pixels().iter().enumerate();
        let side = pixels.filter(|(i, _)| (i % 48 >= 24) == hot).map(|(_, [r, _, b, _])| f64::from(r - b));
        side.sum::<f64>()
    };
    assert!(share(true) > 20.0 && share(false) < -20.0, "{} {}", share(true), share(false));
    // A threshold over all values hides the map, and its look is as requested.
    let (hidden, said) = drawn(dir, "head.nrrd --overlay map.nrrd@20..30 --size 48");
    assert!(hidden != image && said.contains("map.nrrd:two-sided@20..30"), "{said}");
    let red = hidden.pixels().iter().map(|[r, _, b, _]| f64::from((r - b).abs())).sum::<f64>();
    assert!(red < 5.0, "{red}");
    assert!(drawn(dir, "head.nrrd --overlay map.nrrd:#00ff00@2..6 --size 48").0 != image);
    // The figure names both sides, and its bar shows the map.
    drawn(dir, "head.nrrd --overlay map.nrrd --size 200 --legend --colour-bar --clip L --light off");
}

#[test]
fn overlays_are_in_statistics_and_scenes() {
    let dir = folder();
    let dir = dir.path();
    head_and_map(dir);
    fs::create_dir(dir.join("in")).unwrap();
    let output = voxsplat(
        dir,
        "-q render head.nrrd --overlay map.nrrd@2..6 --size 32 -o a.png --stats json --save-scene in/s.json",
    );
    let stats: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    let overlay = &stats["overlays"][0];
    assert_eq!(
        (&overlay["transfer"], &overlay["range"], &overlay["dims"], &overlay["is_resampled"], &overlay["name"]),
        (&"two-sided".into(), &[2.0, 6.0].into(), &[8, 8, 8].into(), &true.into(), &"map".into())
    );
    let scene = fs::read_to_string(dir.join("in/s.json")).unwrap();
    assert!(scene.contains(r#""overlay": "../map.nrrd@2..6""#), "{scene}");
    let first = Image::load(dir.join("a.png")).unwrap();
    assert!(drawn(dir, "in/s.json").0 == first);
    assert!(stdout(&voxsplat(dir, "render in/s.json --stats -o a.png")).contains("overlay      "));
    // Turntables turn both.
    let output = voxsplat(dir, "turntable head.nrrd --overlay map.nrrd --size 24 --frames 2 -o t.gif");
    assert!(output.status.success(), "{output:?}");
}

#[test]
fn overlays_without_a_place_or_a_look_are_refused_in_one_line() {
    let dir = folder();
    let dir = dir.path();
    head_and_map(dir);
    nrrd(dir, "far.nrrd", (4, 3.0), |p| p[0]);
    let moved = fs::read(dir.join("far.nrrd")).unwrap();
    let at = moved.windows(14).position(|bytes| bytes == b"space origin: ").unwrap();
    let mut far = moved.clone();
    far.splice(at + 14..at + 18, *b"(900");
    fs::write(dir.join("far.nrrd"), far).unwrap();
    fs::write(dir.join("bare.raw"), [7_u8; 27]).unwrap();
    for (options, code, reason) in [
        ("--overlay none.nrrd", 1, "cannot read none.nrrd"),
        ("--overlay map.nrrd@6..2", 2, "--overlay: @6..2, expected LO under HI"),
        ("--overlay map.nrrd:nothing", 2, "--overlay: \"nothing\", expected a file, map:NAME"),
        ("--overlay map.nrrd --shading post", 2, "labels, masks, overlays and channels are drawn voxel by voxel"),
        ("--overlay map.nrrd --model mip", 2, "labels, masks, overlays and channels are drawn voxel by voxel"),
        ("--overlay demo:sphere:8", 2, "the files do not say where both lie in one space"),
        ("--overlay far.nrrd:red@-9..9", 2, "far.nrrd: nothing of it lies in the volume"),
    ] {
        let output = voxsplat(dir, &format!("-q render head.nrrd {options} --size 16 -o x.png"));
        let text = complaint(&output);
        assert!(text.contains(reason) && output.status.code() == Some(code), "{options}: {text} {:?}", output.status);
    }
    let output = voxsplat(dir, "-q plan head.nrrd --grid 2x1x1 --overlay map.nrrd -o x.json");
    assert!(complaint(&output).contains("--overlay: bricks are of one volume"), "{output:?}");
    assert!(complaint(&voxsplat(dir, "render head.nrrd --overlay map.nrrd -o map.nrrd")).contains("the same file as"));
}

/// Shares of the covered pixels of the default picture of channels that overlap: near white, saturated; their mean
/// brightness; and the largest distance of two mean colours of halves.
fn of_channels(dir: &Path, count: usize, apart: f64) -> [f64; 3] {
    const N: usize = 24;
    // Balls around a ring: all in one place, or next to each other.
    let value = |i: usize| {
        let (channel, i) = (i % count, i / count);
        let turn = std::f64::consts::TAU * channel as f64 / count as f64;
        let [x, y, z] = [i % N, i / N % N, i / N / N].map(|p| p as f64 - 11.5);
        let radius = length([x - apart * turn.cos(), y, z - apart * turn.sin()]);
        (200.0 / (1.0 + ((radius - 7.0) * 1.5).exp()) + (i * 7919 % 13) as f64) as u8
    };
    let samples: Vec<u8> = (0..N.pow(3) * count).map(value).collect();
    let header = format!(
        "NRRD0004\ntype: uint8\ndimension: 4\nsizes: {count} {N} {N} {N}\nkinds: list domain domain domain\n\
         spacings: nan 1 1 1\nencoding: raw\n\n"
    );
    fs::write(dir.join("c.nrrd"), [header.as_bytes(), &samples].concat()).unwrap();
    let (image, said) = drawn(dir, "c.nrrd --size 64");
    assert!(said.contains("--light studio because channels"), "{said}");
    let bytes = image.to_rgba8(Background::default());
    let covered: Vec<[f64; 3]> = bytes
        .chunks(4)
        .map(|pixel| [pixel[0], pixel[1], pixel[2]].map(|channel| f64::from(channel) / 255.0))
        .filter(|pixel| pixel.iter().any(|channel| *channel > 0.1))
        .collect();
    let share = |is: &dyn Fn(f64, f64) -> bool| {
        let ends = |p: &[f64; 3]| p.iter().fold((1.0_f64, 0.0_f64), |(low, high), c| (low.min(*c), high.max(*c)));
        covered.iter().map(ends).filter(|(low, high)| is(*low, *high)).count() as f64 / covered.len() as f64
    };
    let bright =
        covered.iter().map(|p| p.iter().fold(0.0_f64, |most, c| most.max(*c))).sum::<f64>() / covered.len() as f64;
    [share(&|low, _| low > 0.8), share(&|_, high| high > 0.98), bright]
}

#[test]
fn channels_make_no_white_blob() {
    let dir = folder();
    for count in 2..=6 {
        for apart in [0.0, 4.0, 9.0] {
            let [white, saturated, bright] = of_channels(dir.path(), count, apart);
            println!("{count} channels {apart} apart: white {white:.3}, saturated {saturated:.3}, bright {bright:.2}");
            assert!(white < 0.01 && saturated < 0.02, "{count} {apart}: {white} {saturated}");
            assert!((0.3..0.85).contains(&bright), "{count} {apart}: {bright}");
        }
    }
}
