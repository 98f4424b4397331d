//! Volumes at urls: the same as in files, by no more bytes than they need, from servers that fail.

use std::time::Duration;

use voxsplat::error::Hint;
use voxsplat::formats::{FetchOptions, LatticePart, LoadOptions, PyramidLevel, load};
use voxsplat::glam::DVec3;
use voxsplat::volume::{Samples, Volume};

use crate::formats::fixtures::path;
use crate::formats::server::{Answer, Request, Server};

fn data(folder: &str) -> String {
    format!("{}/data/{folder}", env!("CARGO_MANIFEST_DIR"))
}

/// Options without waits that a test would feel.
fn quick() -> LoadOptions {
    let fetch = FetchOptions { wait: Duration::from_micros(10), ..FetchOptions::default() };
    LoadOptions { fetch, ..LoadOptions::default() }
}

fn at(level: u32) -> LoadOptions {
    LoadOptions { level: PyramidLevel::At(level), ..quick() }
}

fn samples(volume: &Volume) -> Samples {
    volume.in_memory().unwrap().samples().clone()
}

/// A failure in one line, as programs print it.
fn failure(url: &str, options: &LoadOptions) -> String {
    format!("{:#}", load(url, options).unwrap_err())
}

fn sent(requests: &[Request]) -> u64 {
    requests.iter().map(|request| request.sent).sum()
}

#[test]
fn volumes_at_urls_are_the_volumes_of_their_files() {
    let names = [
        "zarr/v2-u8.zarr",
        "zarr/v2-big-fortran.zarr",
        "zarr/v2-slash.zarr",
        "zarr/v2-missing.zarr",
        "zarr/v2-blosc-zstd-bits.zarr",
        "zarr/v3-missing.zarr",
        "zarr/v3-big-transposed.zarr",
        "zarr/v3-shards.zarr",
        "zarr/v3-shards-start.zarr",
        "zarr/v3-fill-f16.zarr",
        "zarr/image-0.1.zarr",
        "zarr/image-0.4.zarr",
        "zarr/image-0.5.zarr/zarr.json",
        "zarr/image-0.6.zarr",
        "zarr/labels-0.4.zarr",
        "zarr/v2-times.zarr",
        "volumes/image-0.5.ozx",
        "volumes/v3-shards.zarr.zip",
        "volumes/image-0.5.ozx:s1",
        "volumes/big-f32.tif",
        "volumes/enhanced-i16.dcm",
        "volumes/five-f32.nii.gz",
        "volumes/big-u16.h5",
        "volumes/detached-raw.nhdr",
        "volumes/detached-gzip.nhdr",
        "volumes/base64-i16.vti",
    ];
    let server = Server::of(data(""));
    for name in names {
        let options =
            LoadOptions { channel: ["image", "five"].iter().any(|of| name.contains(of)).then_some(0), ..quick() };
        let here = load(data(name), &options);
        let there = load(format!("{}/{name}", server.url), &options);
        match (here, there) {
            (Ok(here), Ok(there)) => {
                assert_eq!(samples(&here), samples(&there), "{name}");
                assert_eq!((here.grid(), here.contents()), (there.grid(), there.contents()), "{name}");
            }
            (here, there) => panic!("{name}: {:?} {:?}", here.err(), there.err()),
        }
    }
}

#[test]
fn a_group_is_searched_by_its_consolidated_metadata() {
    for (name, file, key) in [("xarray-v2.zarr", ".zmetadata", ".zattrs"), ("xarray-v3.zarr", "zarr.json", "zarr.json")]
    {
        let folder = data(&format!("zarr/{name}"));
        // Servers list no folders.
        let names: Vec<String> = std::fs::read_dir(&folder)
            .unwrap()
            .flatten()
            .filter(|of| of.path().is_dir())
            .map(|of| of.file_name().into_string().unwrap())
            .collect();
        let listed: serde_json::Map<_, _> =
            names.iter().map(|name| (format!("{name}/{key}"), serde_json::json!({}))).collect();
        let mut json = serde_json::json!({"zarr_format": 3, "node_type": "group"});
        json["metadata"] = listed.clone().into();
        json["consolidated_metadata"] = serde_json::json!({"metadata": listed});
        let (top, bytes) = (format!("/{file}"), json.to_string().into_bytes());
        let from = folder.clone();
        let server = Server::new(move |request| match request.path() == top {
            true => Answer::File(bytes.clone()),
            false => Answer::of_folder(&from, request),
        });
        let (here, there) = (load(&folder, &quick()).unwrap(), load(format!("{}/", server.url), &quick()).unwrap());
        assert_eq!((samples(&here), here.grid()), (samples(&there), there.grid()), "{name}");
    }
}

#[test]
fn only_chunks_of_the_chosen_level_are_fetched_once() {
    let server = Server::of(data("zarr"));
    let volume = load(format!("{}/image-0.5.zarr", server.url), &at(1)).unwrap();
    assert_eq!(volume.contents().level, 1);
    let requests = server.requests();
    let chunks: Vec<&str> = requests.iter().map(Request::path).filter(|path| path.contains("/c/")).collect();
    assert!(!chunks.is_empty() && chunks.iter().all(|path| path.starts_with("/image-0.5.zarr/s1/c/")), "{chunks:?}");
    let mut once = chunks.clone();
    once.sort_unstable();
    once.dedup();
    assert_eq!(once.len(), chunks.len());
    assert!(requests.iter().all(|request| request.header("accept-encoding").is_none_or(|of| of == "identity")));
}

#[test]
fn shards_are_read_by_their_index_and_the_needed_chunks() {
    let server = Server::of(data("zarr"));
    for name in ["v3-shards.zarr", "v3-shards-start.zarr"] {
        let url = format!("{}/{name}", server.url);
        let whole = samples(&load(&url, &quick()).unwrap());
        let all = server.requests();
        let of_chunks = |requests: &[Request]| -> Vec<Request> {
            requests.iter().filter(|request| request.path().contains("/c/")).cloned().collect()
        };
        assert!(of_chunks(&all).iter().all(|request| request.header("range").is_some()), "{all:?}");
        // A corner needs the index of one shard and one chunk, which is not there in the second.
        let corner = LatticePart::new([DVec3::NEG_X, DVec3::NEG_Y, DVec3::NEG_Z].map(|side| (side, 0.0)));
        let part = load(&url, &LoadOptions { part: Some(corner), ..quick() }).unwrap();
        let few = of_chunks(&server.requests());
        let absent = usize::from(name == "v3-shards-start.zarr");
        assert_eq!(few.len(), 2 - absent, "{few:?}");
        assert!(sent(&few) * 2 < sent(&of_chunks(&all)));
        assert_eq!(samples(&part).raw(0), whole.raw(0));
        assert_eq!(samples(&part).len(), whole.len());
    }
}

#[test]
fn no_chunk_is_fetched_for_the_lattice_alone() {
    let server = Server::of(data("zarr"));
    let url = format!("{}/image-0.5.zarr", server.url);
    let whole = load(&url, &quick()).unwrap();
    server.requests();
    let nothing = LoadOptions { part: Some(LatticePart::NOTHING), ..quick() };
    assert_eq!(load(&url, &nothing).unwrap().grid(), whole.grid());
    let requests = server.requests();
    assert!(requests.iter().all(|request| !request.path().contains("/c/")), "{requests:?}");
}

/// An answer in place of a file; `None` for the file.
type Fault = fn(&Request, Vec<u8>) -> Option<Answer>;

/// A server of the folders of Zarr whose first answers to a chunk are others.
fn failing(first: impl Fn(&Request, Vec<u8>) -> Option<Answer> + Send + Sync + 'static) -> Server {
    let folder = data("zarr");
    Server::new(move |request| match Answer::of_folder(&folder, request) {
        Answer::File(bytes) if request.path().contains("/c/") => {
            first(request, bytes.clone()).unwrap_or(Answer::File(bytes))
        }
        answer => answer,
    })
}

#[test]
fn requests_that_fail_for_a_while_are_made_again() {
    let expected = samples(&load(data("zarr/v3-u16.zarr"), &quick()).unwrap());
    let faults: [Fault; 7] = [
        |request, _| (request.before < 2).then_some(Answer::Status(500, "", "")),
        |request, _| (request.before < 2).then_some(Answer::Status(503, "Retry-After: 1000\r\n", "")),
        |request, _| (request.before < 1).then_some(Answer::Status(429, "", "")),
        |request, bytes| (request.before < 1).then(|| Answer::Short(bytes[..bytes.len() / 2].into(), bytes.len())),
        |request, bytes| (request.before < 1).then_some(Answer::Short(bytes, 10)),
        |request, _| (request.before < 1).then_some(Answer::Nothing),
        |request, _| {
            (request.before < 1).then_some(Answer::Status(200, "Content-Range: x\r\nContent-Length: 9\r\n", ""))
        },
    ];
    for (number, fault) in faults.into_iter().enumerate() {
        let server = failing(fault);
        let volume = load(format!("{}/v3-u16.zarr", server.url), &quick());
        assert_eq!(samples(&volume.unwrap_or_else(|error| panic!("{number}: {error:#}"))), expected, "{number}");
    }
}

#[test]
fn failures_are_one_line_without_credentials() {
    let fetch = FetchOptions { attempts: 2, timeout: Duration::from_millis(100), ..quick().fetch };
    let options = LoadOptions { fetch, ..quick() };
    let cases: [(Fault, &str); 7] = [
        (|_, _| Some(Answer::Status(500, "", "secret")), "HTTP 500 Internal Server Error, after 2 attempts"),
        (|_, _| Some(Answer::Status(401, "", "secret")), "HTTP 401 Unauthorized"),
        (|_, _| Some(Answer::Status(403, "", "<Code>ExpiredToken</Code>")), "HTTP 403 Forbidden"),
        (|_, bytes| Some(Answer::Short(bytes, 10)), "the connection ends early: Peer disconnected, after 2 attempts"),
        (|_, _| Some(Answer::Nothing), ", after 2 attempts"),
        (|_, _| Some(Answer::Silent), "the server is silent or slow for over 100ms, after 2 attempts"),
        (|_, _| Some(Answer::Slow), "the server is silent or slow for over 100ms, after 2 attempts"),
    ];
    for (fault, expected) in cases {
        let server = failing(fault);
        let host = server.url.trim_start_matches("http://").to_owned();
        let message = failure(&format!("http://user:secret@{host}/v3-u8.zarr?token=secret"), &options);
        assert!(message.starts_with(&format!("cannot read http://{host}/v3-u8.zarr/c/0/0/0: ")), "{message}");
        assert!(message.ends_with(expected), "{message}");
        assert!(!message.contains("secret") && !message.contains("user"), "{message}");
        let requests = server.requests();
        assert!(requests.iter().all(|request| request.target.ends_with("?token=secret")), "{requests:?}");
        // "user:secret" in base64.
        assert!(requests.iter().all(|request| request.header("authorization") == Some("Basic dXNlcjpzZWNyZXQ=")));
    }
    let free = std::net::TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap();
    let message = failure(&format!("http://u:secret@{free}/a.nrrd?secret"), &options);
    assert_eq!(message, format!("cannot read http://{free}/a.nrrd: the server refuses connections"));
    let message = failure("https://user@/a.zarr", &options);
    assert_eq!(message, "https:///a.zarr: is a url without a host");
}

#[test]
fn missing_chunks_hold_the_fill_value_also_where_s3_denies_to_tell() {
    const DENIED: Answer = Answer::Status(403, "", "<Error><Code>AccessDenied</Code></Error>");
    let folder = data("zarr");
    let private = Server::new(move |request| match Answer::of_folder(&folder, request) {
        Answer::File(bytes) => Answer::File(bytes),
        _ => DENIED,
    });
    for name in ["v2-missing.zarr", "v3-missing.zarr"] {
        let here = load(data(&format!("zarr/{name}")), &quick()).unwrap();
        let there = load(format!("{}/{name}", private.url), &quick()).unwrap();
        assert_eq!(samples(&here), samples(&there), "{name}");
    }
    let all = failing(|_, _| Some(DENIED));
    let message = failure(&format!("{}/v3-u8.zarr", all.url), &quick());
    assert!(message.ends_with("HTTP 403 Forbidden, for every chunk"), "{message}");
    let closed = Server::new(|_| DENIED);
    let message = failure(&format!("{}/v3-u8.zarr", closed.url), &quick());
    assert!(message.ends_with("/v3-u8.zarr: HTTP 403 Forbidden"), "{message}");
    let empty = Server::new(|_| Answer::Status(404, "", ""));
    let message = failure(&format!("{}/v3-u8.zarr", empty.url), &quick());
    assert!(message.ends_with("/v3-u8.zarr: HTTP 404 Not Found"), "{message}");
}

#[test]
fn servers_may_redirect_and_ignore_ranges() {
    let files = Server::of(data(""));
    let target = files.url.clone();
    let redirects = Server::new(move |request| {
        let line: &'static str = format!("Location: {target}{}\r\n", request.target).leak();
        Answer::Status(302, line, "")
    });
    let folder = data("");
    let simple = Server::new(move |request| match Answer::of_folder(&folder, request) {
        Answer::File(bytes) => Answer::Whole(bytes),
        answer => answer,
    });
    for name in ["zarr/v3-shards.zarr", "volumes/image-0.5.ozx:s0", "volumes/big-i16.nrrd"] {
        let options = LoadOptions { channel: name.contains("ozx").then_some(0), ..quick() };
        let here = samples(&load(data(name), &options).unwrap());
        for server in [&redirects, &simple] {
            assert_eq!(samples(&load(format!("{}/{name}", server.url), &options).unwrap()), here, "{name}");
        }
    }
    let circle = Server::new(|_| Answer::Status(302, "Location: /again\r\n", ""));
    let message = failure(&format!("{}/a.nrrd", circle.url), &quick());
    assert!(message.ends_with(": HTTP 302 Found"), "{message}");
    // A shard that is too large to be fetched for one chunk.
    let large = failing(|_, _| Some(Answer::Short(Vec::new(), 1 << 30)));
    let message = failure(&format!("{}/v3-shards.zarr", large.url), &quick());
    assert!(message.ends_with("the server ignores requests of ranges, and the file has 1.0 GiB"), "{message}");
}

#[test]
fn interrupted_files_are_resumed_and_unchanged_ones_are_not_fetched_again() {
    let bytes = std::fs::read(path("big-f64.nrrd")).unwrap();
    let length = bytes.len() as u64;
    let server = Server::new(move |request| match request.header("range") {
        None if request.header("if-none-match").is_none() => Answer::Short(bytes[..100].to_vec(), bytes.len() - 100),
        _ => Answer::File(bytes.clone()),
    });
    let url = format!("{}/big-f64.nrrd", server.url);
    let here = samples(&load(path("big-f64.nrrd"), &quick()).unwrap());
    assert_eq!(samples(&load(&url, &quick()).unwrap()), here);
    let requests = server.requests();
    assert_eq!(requests.iter().filter_map(|request| request.header("range")).collect::<Vec<_>>(), ["bytes=100-"]);
    assert_eq!(sent(&requests), length);
    // Elsewhere an open file has one place to read at, so files are not kept.
    if cfg!(unix) {
        assert_eq!(samples(&load(&url, &quick()).unwrap()), here);
        assert_eq!(sent(&server.requests()), 0);
    }
}

#[test]
fn sizes_are_refused_before_they_are_fetched() {
    let server = Server::of(data(""));
    let limited = |limit: u64| LoadOptions { fetch: FetchOptions { limit, ..quick().fetch }, ..quick() };
    let url = format!("{}/volumes/big-f64.nrrd", server.url);
    let error = load(&url, &limited(100)).unwrap_err();
    assert_eq!(error.hint(), Some(Hint::RaiseFetchLimit));
    assert!(error.to_string().contains("bytes to fetch, over the limit of 100 bytes"), "{error}");
    // Chunks are counted by their bytes without compression, then by their lengths.
    for (name, limit) in [("zarr/v3-u64.zarr", 100), ("zarr/v3-shards.zarr", 50), ("volumes/image-0.5.ozx", 90)] {
        let options = LoadOptions { channel: name.contains("ozx").then_some(0), ..limited(limit) };
        server.requests();
        let error = load(format!("{}/{name}", server.url), &options).unwrap_err();
        assert!(error.to_string().contains("about ") && error.hint() == Some(Hint::RaiseFetchLimit), "{error}");
        let requests = server.requests();
        let is_chunk = |request: &&Request| request.method != "HEAD" && request.path().contains("/c/");
        assert_eq!(requests.iter().filter(is_chunk).count(), 0, "{requests:?}");
    }
}

/// A pyramid of 2048 x 2048 x 2560 samples of 16 bits, 20 GiB, in chunks of 64^3 that are made when they are requested.
/// A chunk has one value, and is compressed.
pub(crate) fn pyramid(request: &Request) -> Answer {
    const LEVELS: u32 = 6;
    let scale = |level: u32| f64::from(1 << level);
    let names: Vec<&str> = request.path().trim_matches('/').split('/').collect();
    let zeros = || {
        let mut encoder = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::fast());
        std::io::Write::write_all(&mut encoder, &[1; 2 << 18]).unwrap();
        encoder.finish().unwrap()
    };
    match names[..] {
        ["p.zarr", "zarr.json"] => {
            let dataset = |level| {
                let scale = [scale(level); 3];
                serde_json::json!({"path": format!("s{level}"), "coordinateTransformations":
                    [{"type": "scale", "scale": scale}]})
            };
            let axis = |name| serde_json::json!({"name": name, "type": "space", "unit": "micrometer"});
            let (axes, datasets) = (["z", "y", "x"].map(axis), (0..LEVELS).map(dataset).collect::<Vec<_>>());
            let image = serde_json::json!({"axes": axes, "datasets": datasets});
            let json = serde_json::json!({"zarr_format": 3, "node_type": "group",
                "attributes": {"ome": {"version": "0.5", "multiscales": [image]}}});
            Answer::File(json.to_string().into_bytes())
        }
        ["p.zarr", level, "zarr.json"] => {
            let level: u32 = level[1..].parse().unwrap();
            let json = serde_json::json!({"zarr_format": 3, "node_type": "array", "data_type": "uint16",
                "shape": [2560 >> level, 2048 >> level, 2048 >> level], "fill_value": 0,
                "chunk_grid": {"name": "regular", "configuration": {"chunk_shape": [64, 64, 64]}},
                "chunk_key_encoding": {"name": "default", "configuration": {"separator": "/"}},
                "codecs": [{"name": "bytes", "configuration": {"endian": "little"}},
                    {"name": "gzip", "configuration": {"level": 1}}]});
            Answer::File(json.to_string().into_bytes())
        }
        ["p.zarr", _, "c", ..] => Answer::File(zeros()),
        _ => Answer::Status(404, "", ""),
    }
}

#[test]
fn a_small_picture_of_a_large_pyramid_fetches_its_level() {
    let server = Server::new(pyramid);
    let url = format!("{}/p.zarr", server.url);
    // 100 pixels along 2560 samples need samples of 16: 128 x 128 x 160, in 2 x 2 x 3 chunks.
    // The limit is for compressed bytes: samples have 6 MiB.
    let fetch = FetchOptions { limit: 1 << 16, ..quick().fetch };
    let level = PyramidLevel::Pixels(100.0);
    let volume = load(&url, &LoadOptions { level, fetch, ..quick() }).unwrap();
    assert_eq!((volume.grid().dims(), samples(&volume).raw(7)), ([128, 128, 160], 257.0));
    let requests = server.requests();
    let (chunks, metadata): (Vec<Request>, _) = requests.into_iter().partition(|of| of.path().contains("/c/"));
    let (asked, chunks): (Vec<Request>, Vec<Request>) = chunks.into_iter().partition(|of| of.method == "HEAD");
    assert_eq!(asked.len(), 12);
    assert!(chunks.len() == 12 && chunks.iter().all(|of| of.path().starts_with("/p.zarr/s4/")), "{chunks:?}");
    assert!(metadata.len() <= 12 && sent(&metadata) < 10_000, "{metadata:?}");
    let message = failure(&url, &LoadOptions { fetch: FetchOptions { limit: 1 << 20, ..quick().fetch }, ..quick() });
    assert!(
        message.contains("/p.zarr/s0: about ") && message.contains(" to fetch, over the limit of 1.0 MiB"),
        "{message}"
    );
}

#[test]
fn meshes_may_be_at_urls() {
    let ply = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n\
               element face 1\nproperty list uchar int vertex_indices\nend_header\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n";
    let server = Server::new(|_| Answer::File(ply.as_bytes().to_vec()));
    let mesh = voxsplat::solids::load_mesh(format!("{}/a.ply", server.url)).unwrap();
    assert_eq!(mesh.triangles, [[0, 1, 2]]);
}
