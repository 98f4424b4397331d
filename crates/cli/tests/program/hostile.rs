//! The program, given what does harm: headers that claim all memory, pipes that nobody writes to, signals and limits.
#![cfg(unix)]

use std::fs::File;
use std::io::{Read, Write};
use std::os::unix::process::ExitStatusExt;
use std::path::Path;
use std::process::{Child, Command, ExitStatus, Stdio};
use std::time::Duration;

use flate2::write::{GzEncoder, ZlibEncoder};
use flate2::{Compression, Crc};
use tempfile::TempDir;
use voxsplat::image::{Background, Image};

fn folder() -> TempDir {
    tempfile::tempdir().unwrap()
}

/// Starts the program in `dir` from a shell that has run `before`.
fn started(dir: &Path, before: &str, arguments: &str) -> Child {
    let mut command = Command::new("sh");
    command.arg("-c").arg(format!("{before}; exec \"$0\" \"$@\"")).arg(env!("CARGO_BIN_EXE_voxsplat"));
    let command = command.args(arguments.split_whitespace()).current_dir(dir);
    command.stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::piped()).spawn().unwrap()
}

/// Waits for the program, at most `STEPS` steps; returns its status and what it said.
fn ended(mut child: Child) -> (ExitStatus, String) {
    if !comes(|| child.try_wait().unwrap().is_some()) {
        child.kill().unwrap();
        panic!("it waits");
    }
    let mut said = String::new();
    child.stderr.take().unwrap().read_to_string(&mut said).unwrap();
    (child.wait().unwrap(), said)
}

/// Steps of at least 5 ms in which something must come: over 20 minutes, because a machine may be busy.
const STEPS: u32 = 250_000;

/// Waits until `has_come`, and returns whether it has.
fn comes(mut has_come: impl FnMut() -> bool) -> bool {
    (0..STEPS).any(|_| {
        std::thread::sleep(Duration::from_millis(5));
        has_come()
    })
}

/// Asserts that the program ends with exit code 1 (`compare` with 2) and one line that has these words, in under 2 GB
/// of memory.
fn refused(dir: &Path, arguments: &str, words: &str) {
    let limit = if cfg!(target_os = "linux") { "ulimit -v 2000000" } else { ":" };
    let (status, said) = ended(started(dir, limit, arguments));
    let code = if arguments.starts_with("compare") { 2 } else { 1 };
    assert_eq!(status.code(), Some(code), "{arguments}: {status}, {said}");
    assert_eq!(said.lines().count(), 1, "{arguments}: {said}");
    assert!(said.starts_with("voxsplat: ") && said.contains(words) && said.len() < 2000, "{arguments}: {said}");
}

fn gzip(bytes: &[u8]) -> Vec<u8> {
    let mut encoder = GzEncoder::new(Vec::new(), Compression::fast());
    encoder.write_all(bytes).unwrap();
    encoder.finish().unwrap()
}

/// 1 MiB of letters and a line end, compressed.
fn long_line() -> Vec<u8> {
    let mut line = vec![b'a'; (1 << 20) - 100];
    line.push(b'\n');
    gzip(&line)
}

const HEADER: &str = "NRRD0004\ntype: uchar\ndimension: 3\nsizes: 255 257 1\nencoding: raw\n";

#[test]
fn headers_take_no_more_memory_than_headers_need() {
    let dir = folder();
    let write = |name: &str, bytes: &[u8]| std::fs::write(dir.path().join(name), bytes).unwrap();
    let (line, many) = (long_line(), 4000);

    let fields = (0..many).flat_map(|n| [gzip(format!("field {n}: ").as_bytes()), line.clone()].concat());
    write("fields.nrrd.gz", &[gzip(HEADER.as_bytes()), fields.collect()].concat());
    refused(dir.path(), "info fields.nrrd.gz", "has a header of over 32 MiB");
    let fields = (0..many).flat_map(|n| [gzip(format!("field {n} = ").as_bytes()), line.clone()].concat());
    write("fields.mha.gz", &[gzip(b"NDims = 3\n"), fields.collect()].concat());
    refused(dir.path(), "info fields.mha.gz", "has a header of over 32 MiB");
    // Short fields take more memory than their characters.
    let fields: String = (0..3_000_000).map(|n| format!("{n:x}:\n")).collect();
    write("short.nrrd", [HEADER, &fields].concat().as_bytes());
    refused(dir.path(), "info short.nrrd", "has a header of over 32 MiB");

    let list = [gzip(format!("{HEADER}data file: LIST\n").as_bytes()), line.repeat(many)].concat();
    write("list.nhdr.gz", &list);
    refused(dir.path(), "info list.nhdr.gz", "names the data file of 1048476 bytes, expected at most 1024");
    let names = format!("{HEADER}data file: LIST\n{}", format!("{}\n", "a".repeat(1000)).repeat(40_000));
    write("names.nhdr.gz", &gzip(names.as_bytes()));
    refused(dir.path(), "info names.nhdr.gz", "has a header of over 32 MiB");

    for (letters, words) in [(1_000_000, "expected at most 1024"), (1000, "File name too long")] {
        let pattern = format!("{HEADER}data file: {}%d.raw 1 65535 1\n", "a".repeat(letters));
        write("pattern.nhdr", pattern.as_bytes());
        refused(dir.path(), "info pattern.nhdr", words);
    }
}

/// A .npy file of holes.
fn npy(file: &Path, descr: &str, shape: &str, bytes: u64) {
    let header = format!("{{'descr': '{descr}', 'fortran_order': True, 'shape': {shape}, }}");
    let mut file = File::create(file).unwrap();
    file.write_all(b"\x93NUMPY\x01\0").unwrap();
    file.write_all(&(header.len() as u16).to_le_bytes()).unwrap();
    file.write_all(header.as_bytes()).unwrap();
    let length = file.metadata().unwrap().len() + bytes;
    file.set_len(length).unwrap();
}

#[cfg(target_os = "linux")]
#[test]
#[ignore = "slow: reads 3 GiB"]
fn samples_that_fit_once_but_not_twice_are_an_error() {
    let dir = folder();
    let gib = 1 << 30;
    npy(&dir.path().join("turned.npy"), "|u1", "(1024, 1024, 1024)", gib);
    refused(dir.path(), "info turned.npy", "no memory for the samples of turned.npy: 1073741824 bytes");
    npy(&dir.path().join("halves.npy"), "<f2", "(512, 1024, 1024)", gib);
    refused(dir.path(), "info halves.npy", "no memory for the samples of halves.npy: 2147483648 bytes");

    let head = dir.path().join("head.npy");
    npy(&head, "|u1", "(1024, 1024, 1024)", 0);
    let zeros = gzip(&vec![0; 1 << 20]).repeat(1024);
    let packed = [gzip(&std::fs::read(head).unwrap()), zeros].concat();
    std::fs::write(dir.path().join("turned.npy.gz"), packed).unwrap();
    refused(dir.path(), "info turned.npy.gz", "no memory for the samples of turned.npy.gz: 1073741824 bytes");
}

/// Replaces all of `old`, which is there.
fn replaced(bytes: &[u8], old: &[u8], new: &[u8]) -> Vec<u8> {
    let (mut out, mut at, mut found) = (Vec::new(), 0, false);
    while at < bytes.len() {
        if bytes[at..].starts_with(old) {
            out.extend_from_slice(new);
            (at, found) = (at + old.len(), true);
        } else {
            out.push(bytes[at]);
            at += 1;
        }
    }
    assert!(found, "{:?}", String::from_utf8_lossy(old));
    out
}

/// The files of every reader with headers that claim 60000 x 60000 samples, and 2 MiB of bytes behind the end: enough
/// that a bound by the length of the file alone would not do.
#[cfg(target_os = "linux")]
#[test]
fn headers_that_claim_too_much_are_refused_before_memory_is_taken() {
    const SIDE: u32 = 60_000;
    let dir = folder();
    let text = |old: &str, new: &str| {
        let (old, new) = (old.to_owned(), new.to_owned());
        move |bytes: Vec<u8>| replaced(&bytes, old.as_bytes(), new.as_bytes())
    };
    type Lie = Box<dyn Fn(Vec<u8>) -> Vec<u8>>;
    let nrrd = || -> Lie { Box::new(text("sizes: 3 4 5", "sizes: 60000 60000 5")) };
    let meta = || -> Lie { Box::new(text("DimSize = 3 4 5", "DimSize = 60000 60000 5")) };
    let vti = || -> Lie { Box::new(text("0 2 0 3 0 4", "0 59999 0 59999 0 4")) };
    // The header of NumPy is as long as before: blanks at its end give way.
    let npy = || -> Lie { Box::new(text("(5, 4, 3), }        ", "(5, 60000, 60000), }")) };
    let vtk = || -> Lie {
        let points = text("POINT_DATA 60", "POINT_DATA 18000000000");
        let sizes = text("DIMENSIONS 3 4 5", "DIMENSIONS 60000 60000 5");
        Box::new(move |bytes| points(sizes(bytes)))
    };
    let at = |place: usize, new: Vec<u8>| -> Lie {
        Box::new(move |mut bytes| {
            bytes[place..place + new.len()].copy_from_slice(&new);
            bytes
        })
    };
    let nifti = || at(42, [30_000_i16; 2].map(i16::to_le_bytes).concat());
    let mrc = || at(0, [SIDE; 2].map(u32::to_le_bytes).concat());
    // In one strip or one tile: other numbers of them would be refused for themselves.
    let tiff_of = |entries: &'static [(u16, u16)]| -> Lie {
        Box::new(move |bytes| {
            let entry = |tag: u16, size: u16| [tag, 4, 1, 0, size].map(u16::to_le_bytes).concat();
            let changed = |bytes: Vec<u8>, (tag, size): &(u16, u16)| {
                replaced(&bytes, &entry(*tag, *size), &entry(*tag, SIDE as u16))
            };
            entries.iter().fold(bytes, changed)
        })
    };
    let tiff = || tiff_of(&[(256, 3), (257, 4), (278, 4)]);
    let tiled = tiff_of(&[(256, 3), (257, 4), (322, 16), (323, 16)]);
    let dicom = || -> Lie {
        Box::new(|bytes| {
            let element = |number: u8, size: u16| {
                [&[0x28, 0, number, 0, b'U', b'S', 2, 0], size.to_le_bytes().as_slice()].concat()
            };
            let high = replaced(&bytes, &element(0x10, 4), &element(0x10, SIDE as u16));
            replaced(&high, &element(0x11, 3), &element(0x11, SIDE as u16))
        })
    };
    let claims = "or its header claims too much";
    let no_memory = "no memory for the samples of ";
    let mut rows: Vec<(&str, Lie, &str)> = vec![
        ("raw-u8.nrrd", nrrd(), claims),
        ("gzip-u16.nrrd", nrrd(), claims),
        ("text-i32.nrrd", nrrd(), claims),
        ("hex-u16.nrrd", nrrd(), claims),
        ("raw-u16.mha", meta(), claims),
        ("zlib-u8.mha", meta(), claims),
        ("text-f32.mha", meta(), claims),
        ("raw-u8.vti", vti(), claims),
        ("zlib-i16.vti", vti(), claims),
        ("base64-i16.vti", vti(), claims),
        ("ascii-i16.vti", vti(), claims),
        ("lz4-f32.vti", vti(), claims),
        ("raw-u8.vtk", vtk(), claims),
        ("ascii-i16.vtk", vtk(), claims),
        ("fortran-u8.npy", npy(), claims),
        ("raw-u8.nii", nifti(), claims),
        ("raw-u16.mrc", mrc(), claims),
        ("raw-u16.tif", tiff(), claims),
        ("tiles-u16.tif", tiled, claims),
        ("lzw-u8.tif", tiff(), claims),
        ("packbits-u8.tif", tiff(), claims),
        ("rgb-lzw-u8.tif", tiff(), claims),
        ("planar-deflate-u8.tif", tiff(), claims),
        ("section-8.tiff", tiff(), claims),
        ("ct-a.dcm", dicom(), "is cut short"),
        // As many samples as a codec may make of few bytes: the memory for them is not there.
        ("rle-u8.dcm", dicom(), no_memory),
        ("baseline-u8.dcm", dicom(), no_memory),
        ("lossless-u16.dcm", dicom(), no_memory),
        ("jpeg2000-u8.dcm", dicom(), no_memory),
    ];
    let sizes = |sizes: [u64; 3]| sizes.map(u64::to_le_bytes).concat();
    let hdf5 = || -> Lie { Box::new(move |bytes| replaced(&bytes, &sizes([5, 4, 3]), &sizes([5, 60_000, 60_000]))) };
    rows.push(("plain-i16.h5", hdf5(), no_memory));
    rows.push(("chunks-f32.h5", hdf5(), no_memory));
    let x = |size: u32| [b"\0\0\0\x01x\0\0\0", size.to_be_bytes().as_slice()].concat();
    rows.push(("classic-i16.nc", Box::new(move |bytes| replaced(&bytes, &x(3), &x(1 << 30))), "expected 1 to"));
    for (name, lie, words) in rows {
        let mut bytes = lie(std::fs::read(crate::cli::volume_file(name)).unwrap());
        bytes.extend(vec![b'1'; 2 << 20]);
        std::fs::write(dir.path().join(name), &bytes).unwrap();
        refused(dir.path(), &format!("info {name}"), words);
        // TIFF is no stream, and neither are folders and containers.
        if [".tif", ".tiff", ".dcm", ".h5", ".nc"].iter().any(|end| name.ends_with(end)) {
            continue;
        }
        std::fs::write(dir.path().join(format!("{name}.gz")), gzip(&bytes)).unwrap();
        refused(dir.path(), &format!("info {name}.gz"), claims);
    }
    // A chunk that is no chunk of the array, of which no other is there.
    for (fill, chunk) in [(0, 100), (7, 100), (0, 60_000)] {
        let array = dir.path().join(format!("a{fill}-{chunk}.zarr"));
        std::fs::create_dir(&array).unwrap();
        let keys = "\"dtype\": \"|u1\", \"order\": \"C\", \"filters\": null, \"compressor\": null";
        let header = format!(
            "{{\"zarr_format\": 2, \"shape\": [1, {SIDE}, {SIDE}], \"chunks\": [1, {chunk}, {chunk}], {keys}, \
             \"fill_value\": {fill}}}"
        );
        std::fs::write(array.join(".zarray"), header).unwrap();
        std::fs::write(array.join("0.0.0"), [1, 2, 3]).unwrap();
        let words = if chunk == 100 { no_memory } else { "chunks of 3600000000 bytes, expected at most" };
        refused(dir.path(), &format!("info {}", array.display()), words);
    }
}

/// A PNG of zeros: one bit of gray for each pixel.
fn black_png(file: &Path, width: u32, height: u32) {
    let mut rows = ZlibEncoder::new(Vec::new(), Compression::fast());
    let row = vec![0; 1 + width.div_ceil(8) as usize];
    (0..height).for_each(|_| rows.write_all(&row).unwrap());
    let size = [width.to_be_bytes(), height.to_be_bytes()].concat();
    let mut png = b"\x89PNG\r\n\x1a\n".to_vec();
    for (name, data) in
        [(b"IHDR", [size, vec![1, 0, 0, 0, 0]].concat()), (b"IDAT", rows.finish().unwrap()), (b"IEND", Vec::new())]
    {
        let mut sum = Crc::new();
        sum.update(name);
        sum.update(&data);
        let length = data.len() as u32;
        png.extend([&length.to_be_bytes(), name.as_slice(), &data, &sum.sum().to_be_bytes()].concat());
    }
    std::fs::write(file, png).unwrap();
}

#[cfg(target_os = "linux")]
/// 500^3 visible voxels, 2.2 GB as splats and as a texture, from a file without blocks.
#[test]
#[cfg(target_os = "linux")]
fn a_picture_beyond_the_memory_is_refused_beforehand() {
    let dir = folder();
    File::create(dir.path().join("a.raw")).unwrap().set_len(500_u64.pow(3)).unwrap();
    let points =
        r##"{"points": [{"value": 0, "color": "#fff", "opacity": 0.5}, {"value": 9, "color": "#fff", "opacity": 1}]}"##;
    std::fs::write(dir.path().join("t.json"), points).unwrap();
    let scene = "render a.raw --dims 500,500,500 --type u8 --transfer t.json --light off --size 1024 -q \
                 --painter tiles";
    for words in
        ["the picture needs about 2.2 GB of memory, and its limit of address space has", "draw it with --level 1"]
    {
        refused(dir.path(), &format!("{scene} -o a.png"), words);
    }
    assert!(!dir.path().join("a.png").exists());
}

#[test]
fn pictures_are_refused_memory_before_they_are_decoded() {
    let dir = folder();
    black_png(&dir.path().join("wide.png"), 16_000, 16_000);
    refused(dir.path(), "compare wide.png wide.png", "no memory for the picture wide.png");
    black_png(&dir.path().join("long.png"), 1, 40_000);
    refused(dir.path(), "compare long.png long.png", "a picture of 1 x 40000 pixels is too large");

    let small = Image::new(2, 2, vec![[0.5; 4]; 4]).unwrap();
    small.save(dir.path().join("small.exr"), Background::default()).unwrap();
    let bytes = std::fs::read(dir.path().join("small.exr")).unwrap();
    for (last, words) in [(9999_i32, "no memory for the picture"), (99_999, "pixels is too large")] {
        let mut changed = bytes.clone();
        // The last column and row of the picture, of which the file has but four pixels.
        let name = b"displayWindow\0box2i\0";
        let at = bytes.windows(name.len()).position(|w| w == name).unwrap() + name.len() + 12;
        changed[at..at + 4].copy_from_slice(&last.to_le_bytes());
        changed[at + 4..at + 8].copy_from_slice(&last.to_le_bytes());
        std::fs::write(dir.path().join("claims.exr"), changed).unwrap();
        refused(dir.path(), "compare claims.exr claims.exr", words);
    }
}

#[test]
fn what_is_no_regular_file_is_refused_without_waiting() {
    let dir = folder();
    let made = Command::new("mkfifo").arg("pipe").arg("pipe.json").current_dir(dir.path()).status().unwrap();
    assert!(made.success());
    let _socket = std::os::unix::net::UnixListener::bind(dir.path().join("socket")).unwrap();
    std::os::unix::fs::symlink("pipe", dir.path().join("link.nrrd")).unwrap();
    let header = |file: &str| format!("{}data file: {file}\n", HEADER.replace("255 257 1", "1 1 1"));
    for (name, file) in
        [("pipe.nhdr", "pipe"), ("device.nhdr", "/dev/zero"), ("folder.nhdr", "."), ("stdin.nhdr", "/dev/stdin")]
    {
        std::fs::write(dir.path().join(name), header(file)).unwrap();
    }
    for (arguments, words) in [
        ("info pipe", "pipe: is a pipe, expected a regular file"),
        ("info link.nrrd", "link.nrrd: is a pipe"),
        ("info socket", "is a socket"),
        ("info /dev/zero", "is a device"),
        ("info .", "is a directory"),
        ("info pipe.nhdr", "pipe: is a pipe"),
        ("info device.nhdr", "/dev/zero: is a device"),
        ("info folder.nhdr", "is a directory"),
        ("info stdin.nhdr", "is not a regular file, as a data file must be"),
        ("render demo:sphere:8 -o a.png --transfer pipe.json", "pipe.json: is a pipe"),
        ("render demo:sphere:8 -o a.png --transfer /dev/zero", "/dev/zero: is a device"),
        ("render pipe -o a.png --reference", "pipe: is a pipe"),
        ("compare pipe pipe", "pipe: is a pipe"),
        ("compare /dev/zero .", "/dev/zero: is a device"),
    ] {
        refused(dir.path(), arguments, words);
    }
}

/// A frame that cannot be made is why a film is not whole: the film itself is not to blame.
#[test]
fn a_film_reports_the_error_of_its_frame() {
    let dir = folder();
    // The last frame is of a volume of no size.
    let keys = r#"[{"frame": 1, "zoom": 1}, {"frame": 2, "zoom": 1e-12}]"#;
    std::fs::write(dir.path().join("k.json"), keys).unwrap();
    let command = "turntable demo:sphere:8 --frames 3 --size 8 --reference --key-frames k.json -o";
    for output in ["a.gif", "a.apng", "a.html", "a.y4m", "-", "{frame}.png"] {
        let (status, said) = ended(started(dir.path(), ":", &format!("{command} {output}")));
        assert_eq!((status.code(), said.lines().count()), (Some(2), 1), "{output}: {said}");
        assert!(said.contains("pixels wide") && !said.contains("of 3 frames"), "{output}: {said}");
    }
    assert_eq!(names(dir.path()), ["0000.png", "0001.png", "k.json"]);
}

/// Every output, in places where nobody can write, root included.
#[test]
fn outputs_that_cannot_be_written_are_refused_before_the_work() {
    let dir = folder();
    std::fs::write(dir.path().join("file"), "old").unwrap();
    // A name that is too long, with its ending.
    let long = "a".repeat(300);
    Image::transparent(2, 2).unwrap().save(dir.path().join("p.png"), Background::Transparent).unwrap();
    let before = names(dir.path());
    // No volume is there: to read it is the first of the work.
    let commands = [
        ("render none.nrrd -o {}", "png"),
        ("render none.nrrd -o {}", "exr"),
        ("render none.nrrd -o a.png --save-scene {}", "json"),
        ("render none.nrrd -o a.png --save-transfer {}", "json"),
        ("turntable none.nrrd -o {}", "gif"),
        ("turntable none.nrrd -o {}", "apng"),
        ("turntable none.nrrd -o {}", "html"),
        ("turntable none.nrrd -o {}", "y4m"),
        ("turntable none.nrrd -o {}", "{frame}.png"),
        ("turntable none.nrrd -o a.gif --save-transfer {}", "json"),
        ("compare p.png none.png --difference {}", "png"),
        ("pareto none.nrrd -o {}", "report"),
    ];
    for (command, ending) in commands {
        let places =
            ["file/a", "none/none/a", "/proc/a", "/dev/null/a", &long].map(|place| format!("{place}.{ending}"));
        for place in places.into_iter().filter(|place| cfg!(target_os = "linux") || !place.starts_with("/proc")) {
            if command.starts_with("pareto") && place.starts_with("none") {
                // A study makes the folders above its own.
                continue;
            }
            let arguments = command.replacen("{}", &place, 1);
            let (status, said) = ended(started(dir.path(), ":", &arguments));
            assert_eq!(status.code(), Some(2), "{arguments}: {said}");
            let about: Vec<&str> = said.lines().filter(|line| !line.contains("none.nrrd: No such file")).collect();
            let name = place.split('.').next().unwrap();
            assert!(about.len() == 1 && about[0].contains(&name[..name.len().min(40)]), "{arguments}: {said}");
            assert!(!said.contains(".tmp") && !said.contains(".voxsplat-"), "{arguments}: {said}");
            assert_eq!(names(dir.path()), before, "{arguments}");
        }
    }
    if cfg!(target_os = "linux") {
        let film = started(dir.path(), "export TMPDIR=/proc", "turntable none.nrrd -o a.gif");
        let (status, said) = ended(film);
        assert!(status.code() == Some(2) && said.contains("no temporary file can be made in /proc: "), "{said}");
    }
    // What fails while it is written: no room on the disk of temporary files, and on standard output.
    let sphere = "demo:sphere:8 --reference --size 16";
    for (before, arguments, words) in [
        ("exec >/dev/full", format!("render {sphere} -o -"), "cannot write to stdout: No space left"),
        ("exec >/dev/full", "info demo:sphere:8".to_owned(), "cannot write to stdout: No space left"),
        ("exec >/dev/full", format!("turntable {sphere} --frames 2 -o -"), "No space left"),
        ("ulimit -f 0", format!("render {sphere} -o a.png"), "a.png: File too large"),
        ("ulimit -f 0", format!("render {sphere} -o a.exr"), "a.exr: File too large"),
        ("ulimit -f 0", format!("turntable {sphere} --frames 2 -o a.gif"), "File too large"),
        ("ulimit -f 0", format!("turntable {sphere} --frames 2 -o a.html"), "File too large"),
        ("ulimit -f 0", format!("turntable {sphere} --frames 2 -o {{frame}}.png"), "0000.png: File too large"),
    ] {
        if !cfg!(target_os = "linux") {
            break;
        }
        let (status, said) = ended(started(dir.path(), before, &arguments));
        assert_eq!((status.code(), said.lines().count()), (Some(1), 1), "{before}; {arguments}: {said}");
        assert!(said.contains(words), "{before}; {arguments}: {said}");
        assert!(!said.contains(".tmp") && !said.contains(".voxsplat-"), "{before}; {arguments}: {said}");
        assert_eq!(names(dir.path()), ["file", "p.png"], "{before}; {arguments}");
    }
}

/// Every option that reads a small file, against everything that is no such file.
#[test]
fn text_inputs_are_refused_without_waiting() {
    let dir = folder();
    let at = |name: &str| dir.path().join(name);
    for name in ["pipe.json", "pipe.txt"] {
        assert!(Command::new("mkfifo").arg(name).current_dir(dir.path()).status().unwrap().success());
    }
    for end in ["json", "txt"] {
        std::os::unix::fs::symlink("/dev/zero", at(&format!("zero.{end}"))).unwrap();
        std::fs::create_dir(at(&format!("folder.{end}"))).unwrap();
        File::create(at(&format!("huge.{end}"))).unwrap().set_len(1 << 30).unwrap();
        std::fs::write(at(&format!("binary.{end}")), [0xff, 0xfe, 0, 1, 0x80]).unwrap();
    }
    for (input, end) in [
        ("render {} -o a.png", "json"),
        ("turntable {} -o a.gif", "json"),
        ("turntable demo:sphere:8 -o a.gif --key-frames {}", "json"),
        ("render demo:sphere:8 -o a.png --transfer {}", "json"),
        ("render demo:sphere:8 -o a.png --transfer map:{}", "json"),
        ("render demo:sphere:8 -o a.png --transfer labels --label-table {}", "txt"),
        ("info demo:sphere:8 --labels --label-table {}", "txt"),
        ("pareto demo:sphere:8 -o report --rivals {}", "json"),
    ] {
        for (file, words) in [
            ("pipe", "is a pipe"),
            ("zero", "is a device"),
            ("folder", "is a directory"),
            ("huge", "is too large"),
            ("binary", "is no text"),
        ] {
            refused(dir.path(), &input.replace("{}", &format!("{file}.{end}")), words);
        }
    }
}

/// An output may not be a file that a header names, a slice of a folder or a file of a Zarr, by any name.
#[test]
fn outputs_take_the_place_of_no_data_file() {
    let dir = folder();
    let write = |name: &str, text: &str| std::fs::write(dir.path().join(name), text).unwrap();
    let header = HEADER.replace("255 257 1", "2 2 2");
    for name in ["a.png", "b0.png", "b1.png", "c.png", "d.png"] {
        write(name, "12345678");
    }
    write("a.nhdr", &format!("{header}data file: a.png\n"));
    write("list.nhdr", &format!("{header}data file: LIST\nb0.png\nb1.png\n"));
    write("pattern.nhdr", &format!("{header}data file: b%d.png 0 1 1\n"));
    let meta = "NDims = 3\nDimSize = 2 2 2\nElementType = MET_UCHAR\nElementDataFile";
    write("c.mhd", &format!("{meta} = c.png\n"));
    write("c-list.mhd", &format!("{meta} = LIST\nd.png\n"));
    write("s.json", r#"{"volume": "a.nhdr"}"#);
    for folder in ["series", "v.zarr", "v.zarr/0", "report"] {
        std::fs::create_dir(dir.path().join(folder)).unwrap();
    }
    let group = r#"{"zarr_format": 3, "node_type": "group"}"#;
    write("v.zarr/zarr.json", group);
    write("v.zarr/0/zarr.json", group);
    write("report/pareto.json", "[]");
    for (name, to) in [
        ("ct-a.dcm", "series/ct-a.dcm"),
        ("section-8.tiff", "series/section-8.tiff"),
        ("pair-i16.hdr", "pair.hdr"),
        ("pair-i16.img", "pair.img"),
    ] {
        std::fs::copy(crate::cli::volume_file(name), dir.path().join(to)).unwrap();
    }
    for (file, link) in [
        ("pair.img", "img.png"),
        ("pair.hdr", "hdr.png"),
        ("series/ct-a.dcm", "slice.png"),
        ("series/section-8.tiff", "section.png"),
    ] {
        std::os::unix::fs::symlink(file, dir.path().join(link)).unwrap();
    }
    let before = names(dir.path());
    for (command, output) in [
        ("render a.nhdr", "-o a.png"),
        ("render list.nhdr", "-o b1.png"),
        ("render pattern.nhdr", "-o b1.png"),
        ("render c.mhd", "-o c.png"),
        ("render c-list.mhd", "-o ./d.png"),
        ("render pair.hdr", "-o img.png"),
        ("render pair.img", "-o hdr.png"),
        ("render series", "-o slice.png"),
        ("render series", "-o section.png"),
        ("render v.zarr", "-o new.png --save-scene v.zarr/0/zarr.json"),
        ("render v.zarr/zarr.json", "-o new.png --save-transfer v.zarr/zarr.json"),
        ("render demo:sphere:8 --labels a.nhdr", "-o a.png"),
        ("render demo:sphere:8 --mask a.nhdr:1", "-o a.png"),
        ("render s.json", "-o a.png"),
        ("pareto demo:sphere:8 --rivals report/pareto.json", "-o report"),
    ] {
        let arguments = format!("{command} {output}");
        let (status, said) = ended(started(dir.path(), ":", &arguments));
        assert_eq!((status.code(), said.lines().count()), (Some(2), 1), "{arguments}: {said}");
        assert!(said.contains("the same file"), "{arguments}: {said}");
        assert_eq!(names(dir.path()), before, "{arguments}");
    }
    assert_eq!(std::fs::read_to_string(dir.path().join("a.png")).unwrap(), "12345678");
}

/// An output may not be an input or another output, by any name.
#[test]
fn outputs_take_the_place_of_no_other_file() {
    let dir = folder();
    let at = |name: &str| dir.path().join(name);
    let transfer = r##"{"points": [{"value": 0, "color": "#ffffff", "opacity": 0.5}]}"##;
    std::fs::create_dir(at("sub")).unwrap();
    std::fs::write(at("t.json"), transfer).unwrap();
    std::fs::hard_link(at("t.json"), at("hard.json")).unwrap();
    std::os::unix::fs::symlink("t.json", at("soft.json")).unwrap();
    std::fs::write(at("s.json"), r#"{"volume": "demo:sphere:8"}"#).unwrap();
    let twice = r#"{"volume": "demo:sphere:8", "outputs": [{"output": "a.png"}, {"output": "sub/../a.png"}]}"#;
    std::fs::write(at("twice.json"), twice).unwrap();
    Image::transparent(2, 2).unwrap().save(at("p.png"), Background::Transparent).unwrap();
    let volume = [HEADER.replace("255 257 1", "2 2 2").as_bytes(), b"\n", &[1, 2, 3, 4, 5, 6, 7, 8]].concat();
    std::fs::write(at("v.png"), volume).unwrap();
    let before: Vec<_> = names(dir.path());
    let sphere = "render demo:sphere:8 --reference --size 4";
    for arguments in [
        "render v.png --reference --size 4 --transfer t.json -o v.png".to_owned(),
        "render v.png --reference --size 4 --transfer t.json -o sub/../v.png".to_owned(),
        format!("{sphere} --transfer t.json -o a.png --save-transfer t.json"),
        format!("{sphere} --transfer t.json -o a.png --save-transfer ./hard.json"),
        format!("{sphere} --transfer soft.json -o a.png --save-scene t.json"),
        format!("{sphere} -o a.png --save-scene new.json --save-transfer sub/../new.json"),
        "render s.json --reference --size 4 -o a.png --save-scene sub/../s.json".to_owned(),
        "render twice.json --reference --size 4".to_owned(),
        "turntable demo:sphere:8 --transfer t.json -o a.gif --save-transfer soft.json".to_owned(),
        "compare p.png p.png --difference p.png".to_owned(),
    ] {
        let (status, said) = ended(started(dir.path(), ":", &arguments));
        assert_eq!((status.code(), said.lines().count()), (Some(2), 1), "{arguments}: {said}");
        assert!(said.contains("the same file"), "{arguments}: {said}");
        assert_eq!(names(dir.path()), before, "{arguments}");
    }
    assert_eq!(std::fs::read_to_string(at("t.json")).unwrap(), transfer);
    // Nobody can write there, root included.
    for option in ["-o /proc/a.png", "-o a.png --save-scene /proc/a.json", "-o a.png --save-transfer /proc/a.json"] {
        let (status, said) = ended(started(dir.path(), ":", &format!("{sphere} {option}")));
        assert!(status.code() == Some(2) && !said.contains(".tmp") && !said.contains(".voxsplat-"), "{option}: {said}");
        assert_eq!(names(dir.path()), before, "{option}");
    }
    for name in ["-", "x.txt", "x"] {
        let (status, said) = ended(started(dir.path(), ":", &format!("{sphere} -o a.png --save-scene {name}")));
        assert!(status.code() == Some(2) && said.contains("ends in .json"), "{name}: {said}");
    }
}

#[test]
fn standard_input_may_be_a_stream() {
    let dir = folder();
    let volume = [HEADER.replace("255 257 1", "2 2 2").as_bytes(), b"\n", &[1, 2, 3, 4, 5, 6, 7, 8]].concat();
    std::fs::write(dir.path().join("a.nrrd"), volume).unwrap();
    let transfer = r##"{"points": [{"value": 0, "color": "#ffffff", "opacity": 0.5}]}"##;
    std::fs::write(dir.path().join("t.json"), transfer).unwrap();
    Image::transparent(2, 2).unwrap().save(dir.path().join("a.png"), Background::Transparent).unwrap();
    for command in [
        "cat a.nrrd | $0 info /dev/stdin",
        "$0 info /dev/stdin < a.nrrd",
        "cat a.nrrd | $0 render /dev/stdin -o r.exr --transfer t.json --reference --size 4",
        "cat t.json | $0 render a.nrrd -o r.exr --transfer /dev/stdin --reference --size 4",
        "cat a.png | $0 compare /dev/stdin a.png",
        // Too much of it is refused.
        "! $0 render a.nrrd -o r.exr --transfer /dev/stdin --reference --size 4 < /dev/zero",
        "! $0 info /dev/stdin < /dev/zero",
    ] {
        let mut shell = Command::new("sh");
        let shell = shell.arg("-c").arg(command).arg(env!("CARGO_BIN_EXE_voxsplat")).current_dir(dir.path());
        let output = shell.output().unwrap();
        assert!(output.status.success(), "{command}: {}", String::from_utf8_lossy(&output.stderr));
    }
}

/// The names of the files in a folder.
fn names(dir: &Path) -> Vec<String> {
    let mut names: Vec<String> =
        std::fs::read_dir(dir).unwrap().map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect();
    names.sort();
    names
}

/// A comparison that writes a picture of 16 bytes a pixel.
fn comparison(dir: &Path, size: u32) -> &'static str {
    black_png(&dir.join("a.png"), size, size);
    "compare a.png a.png --difference d.exr"
}

#[test]
fn a_limit_of_file_sizes_is_a_failure_and_leaves_nothing() {
    let dir = folder();
    let arguments = comparison(dir.path(), 512);
    for old in [false, true] {
        if old {
            std::fs::write(dir.path().join("d.exr"), b"old").unwrap();
        }
        let (status, said) = ended(started(dir.path(), "ulimit -f 64", arguments));
        assert_eq!(status.code(), Some(2), "{status}: {said}");
        assert!(
            said.starts_with("voxsplat: cannot write d.exr: File too large") && said.lines().count() == 1,
            "{said}"
        );
        let left: &[&str] = if old { &["a.png", "d.exr"] } else { &["a.png"] };
        assert_eq!(names(dir.path()), left);
    }
    assert_eq!(std::fs::read(dir.path().join("d.exr")).unwrap(), b"old");
}

fn send(signal: &str, child: &Child) {
    let sent = Command::new("kill").arg(format!("-{signal}")).arg(child.id().to_string()).status().unwrap();
    assert!(sent.success());
}

/// Sends a signal to a comparison of pictures of `size` pixels, once its output has grown to `bytes`. Returns whether
/// the signal has ended it.
fn interrupts(dir: &Path, size: u32, bytes: u64, (signal, number): (&str, i32)) -> bool {
    let mut child = started(dir, ":", comparison(dir, size));
    // Linux has files without a name: the open files of the process show them.
    let open = format!("/proc/{}/fd", child.id());
    let files = || [dir, Path::new(&open)].into_iter().flat_map(std::fs::read_dir).flatten().flatten();
    let is_output =
        |file: &std::fs::DirEntry| !["a.png", "d.exr"].contains(&file.file_name().to_string_lossy().as_ref());
    let has_grown = |file: std::fs::DirEntry| {
        is_output(&file) && std::fs::metadata(file.path()).is_ok_and(|file| file.is_file() && file.len() >= bytes)
    };
    while bytes > 0 && !files().any(has_grown) && child.try_wait().unwrap().is_none() {
        std::thread::sleep(Duration::from_millis(1));
    }
    if child.try_wait().unwrap().is_none() {
        send(signal, &child);
    }
    let (status, said) = ended(child);
    // As the shell sees it: 128 and the number.
    assert!(status.signal() == Some(number) || status.success(), "{signal}: {status}, {said}");
    let left = names(dir);
    assert!(left.iter().all(|name| ["a.png", "d.exr"].contains(&name.as_str())), "{left:?}");
    !status.success()
}

const SIGNALS: [(&str, i32); 3] = [("INT", 2), ("TERM", 15), ("HUP", 1)];

#[test]
fn a_signal_leaves_no_temporary_file() {
    let dir = folder();
    let interrupted = SIGNALS.iter().filter(|&&signal| interrupts(dir.path(), 512, 0, signal)).count();
    assert!(interrupted > 0, "each comparison ended before its signal");
}

#[test]
#[ignore = "slow: 25 pictures of 64 MiB"]
fn a_signal_while_a_picture_is_written_leaves_no_part_of_it() {
    let dir = folder();
    assert!(ended(started(dir.path(), ":", comparison(dir.path(), 2048))).0.success());
    let length = std::fs::metadata(dir.path().join("d.exr")).unwrap().len();
    let mut interrupted = 0;
    for n in 0..24 {
        // The first half finds no older picture, the second does.
        if n < 12 {
            drop(std::fs::remove_file(dir.path().join("d.exr")));
        }
        interrupted += u32::from(interrupts(dir.path(), 2048, length * (n % 12) / 12, SIGNALS[n as usize % 3]));
        assert!(std::fs::metadata(dir.path().join("d.exr")).map_or(true, |file| file.len() == length));
    }
    assert!(interrupted > 1, "{interrupted}");
}

#[cfg(target_os = "linux")]
#[test]
fn a_signal_that_is_ignored_stays_ignored() {
    let dir = folder();
    let arguments = comparison(dir.path(), 1024);
    let child = started(dir.path(), "trap '' HUP", arguments);
    // The program is its own parent's child until it is waited for: a signal after its end changes nothing.
    for _ in 0..10 {
        std::thread::sleep(Duration::from_millis(10));
        send("HUP", &child);
    }
    let (status, said) = ended(child);
    assert!(status.success(), "{status}: {said}");
    assert_eq!(names(dir.path()), ["a.png", "d.exr"]);
}
