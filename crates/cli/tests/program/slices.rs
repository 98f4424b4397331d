//! The command `slice` and the option `--plane`.

use std::path::Path;

use voxsplat::image::Image;

use crate::cli::{complaint, folder, voxsplat};

fn drawn(dir: &Path, name: &str, line: &str) -> Image {
    let output = voxsplat(dir, &format!("{line} -o {name}"));
    assert!(output.status.success(), "{line}: {}", String::from_utf8_lossy(&output.stderr));
    Image::load(dir.join(name)).unwrap()
}

/// The pixels of a part of a picture.
fn part(image: &Image, [x, y, width, height]: [u32; 4]) -> Vec<[f32; 4]> {
    let rows = image.pixels().chunks_exact(image.width() as usize).skip(y as usize).take(height as usize);
    rows.flat_map(|row| row[x as usize..(x + width) as usize].to_vec()).collect()
}

#[test]
fn a_figure_has_the_picture_and_a_section_for_each_plane() {
    let dir = folder();
    let dir = dir.path();
    let look = "demo:sphere:24 --transfer grayscale";
    let figure = drawn(dir, "figure.png", &format!("slice {look} --size 259x128 --planes xy --background black"));
    assert_eq!([figure.width(), figure.height()], [259, 128]);
    // The last panel is the picture of its size, apart from the outline of the plane.
    let size = (259 - 3) / 2;
    let picture = drawn(dir, "picture.png", &format!("render {look} --size {size}x128"));
    let own = part(&figure, [259 - size, 0, size, 128]);
    let same = own.iter().zip(picture.pixels()).filter(|(a, b)| a == b).count();
    assert!(same > own.len() * 9 / 10 && same < own.len(), "{same} of {}", own.len());
    // The section of a ball is a disc: bright in the middle and dark at the corners of the lattice.
    let section = part(&figure, [0, 0, size, 128]);
    let at = |x: u32, y: u32| section[(y * size + x) as usize];
    assert!(at(size / 2, 64)[0] > 0.5 && at(40, 40)[0] < 0.1, "{:?} {:?}", at(size / 2, 64), at(40, 40));
    // Beside the middle the disc is smaller.
    let off = drawn(dir, "off.png", &format!("slice {look} --size 259x128 --planes xy:9"));
    let bright = |image: &Image| part(image, [0, 20, size, 80]).iter().filter(|pixel| pixel[0] > 0.3).count();
    assert!(bright(&off) < bright(&figure) * 4 / 5, "{} {}", bright(&off), bright(&figure));
    // A scene draws a figure, and texts are the whole figure's.
    assert!(voxsplat(dir, "render demo:sphere:24 -o a.png --size 8 --save-scene s.json").status.success());
    let texts = drawn(dir, "texts.png", "slice s.json --size 400 --title Ball --caption Planes");
    assert_eq!([texts.width(), texts.height()], [400, 400]);
    // Labels and overlays lie over the sections.
    let plain = drawn(dir, "plain.png", "slice demo:vessels:16 --size 300");
    let over = drawn(dir, "over.png", "slice demo:vessels:16 --size 300 --overlay demo:sphere:16:red");
    let red = |image: &Image| part(image, [0, 0, 140, 140]).iter().filter(|p| p[0] > p[1] + 0.3).count();
    assert!(red(&over) > red(&plain) + 100, "{} {}", red(&over), red(&plain));
}

#[test]
fn a_plane_hides_the_matter_behind_it() {
    let dir = folder();
    let dir = dir.path();
    let look = "render demo:sphere:24 --size 64 --frame volume --azimuth 0 --transfer map:viridis";
    let plain = drawn(dir, "plain.png", look);
    let plane = drawn(dir, "plane.png", &format!("{look} --plane coronal:0"));
    assert!(plane.pixels().iter().filter(|pixel| pixel[3] > 0.99).count() > 1000 && plain != plane);
    let cut = drawn(dir, "cut.png", "slice demo:sphere:24 --size 300 --planes 1,1,0 --planes xy:2,xz");
    assert_eq!([cut.width(), cut.height()], [300, 300]);
    // A plane by its normal is the same plane, and one behind the volume's front half shows that half before it.
    assert!(drawn(dir, "normal.png", &format!("{look} --plane 0,1,0,0")) == plane);
    let film = voxsplat(dir, "turntable demo:sphere:12 --size 32 --frames 2 --plane xy -o film.gif");
    assert!(film.status.success(), "{}", String::from_utf8_lossy(&film.stderr));
}

#[test]
fn what_cannot_be_cut_is_said() {
    let dir = folder();
    let dir = dir.path();
    for (line, expected) in [
        ("slice demo:sphere:8 -o a.png --planes upper", "expected axial, coronal or sagittal"),
        ("slice demo:sphere:8 -o a.png --planes xy:90", "--planes: xy at [0.0, 0.0, 90.0] misses the volume"),
        ("slice demo:sphere:8 -o a.png --at 90,0,0", "--at: yz at [90.0, 0.0, 0.0] misses the volume"),
        ("slice demo:sphere:8 -o a.png --at 1,2", "three numbers X,Y,Z"),
        ("slice demo:sphere:8 -o a.png --size 200", "4 panels of"),
        ("slice demo:sphere:8 -o a.exr", "--output: a figure of slices is a .png"),
        ("slice demo:sphere:8 -o a.png --region 0,0,4,4", "--region is for a picture, not for a figure of slices"),
        ("slice demo:sphere:8 -o a.png --save-scene b.json", "--save-scene is for a picture"),
        ("slice demo:sphere:8", "--output FILE is missing"),
        ("render demo:sphere:8 -o a.png --plane 0,0,0", "expected axial, coronal or sagittal"),
        ("render demo:sphere:8 -o a.png --plane yz:9", "--plane: yz at [9.0, 0.0, 0.0] misses the volume"),
        ("render demo:sphere:8 -o a.png --plane xy --reference", "--plane: the reference draws no solids"),
        ("render demo:sphere:8 -o a.png --slices", "voxsplat slice draws sections"),
    ] {
        let output = voxsplat(dir, &format!("-q {line}"));
        let said = complaint(&output);
        assert!(said.contains(expected) && output.status.code() == Some(2), "{line}: {said}");
    }
    assert!(!dir.join("a.png").exists());
}
