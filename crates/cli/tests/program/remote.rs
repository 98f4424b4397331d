//! Volumes at urls on command lines.

use std::path::Path;
use std::process::Command;

use voxsplat::formats::CAN_FETCH;

use crate::cli::{complaint, folder, stdout, voxsplat};
use crate::server::{Answer, Request, Server};

fn data(folder: &str) -> String {
    format!("{}/../../tests/data/{folder}", env!("CARGO_MANIFEST_DIR"))
}

/// The requests of chunks.
fn chunks(server: &Server) -> Vec<Request> {
    server.requests().into_iter().filter(|of| of.path().contains("/c/") && of.method == "GET").collect()
}

const LOOK: &str = "--transfer grayscale --light off --painter cpu --size 48";

#[test]
fn a_build_without_the_feature_says_so() {
    let dir = folder();
    let output = voxsplat(dir.path(), "info http://user:secret@127.0.0.1:9/a.zarr?token=secret");
    let said = complaint(&output);
    match CAN_FETCH {
        true => assert_eq!(said, "cannot read http://127.0.0.1:9/a.zarr/zarr.json: the server refuses connections"),
        false => assert!(said.ends_with("a.zarr: is a url, and this build lacks --features remote: fetch it first")),
    }
    assert!(!said.contains("secret"), "{said}");
}

#[test]
fn pictures_of_urls_are_the_pictures_of_their_files_without_credentials_in_any_output() {
    if !CAN_FETCH {
        return;
    }
    let (dir, server) = (folder(), Server::of(data("")));
    let host = server.url.trim_start_matches("http://").to_owned();
    let read = |name: &str| std::fs::read(dir.path().join(name)).unwrap();
    for name in ["zarr/image-0.5.zarr", "zarr/v3-shards.zarr", "volumes/big-i16.nrrd", "volumes/image-0.5.ozx"] {
        let one = if name.contains("ozx") { "--channel 0" } else { "" };
        let line = |source: &str, rest: &str| {
            let output = voxsplat(dir.path(), &format!("render {source} {LOOK} {one} {rest}"));
            let text = String::from_utf8(output.stderr.clone()).unwrap() + &stdout(&output);
            assert!(!text.contains("secret"), "{text}");
        };
        line(&data(name), "-o here.png");
        let url = format!("http://user:secret@{host}/{name}?token=secret");
        line(&url, "-o there.png --save-scene scene.json --json");
        assert!(read("here.png") == read("there.png"), "{name}");
        let scene = String::from_utf8(read("scene.json")).unwrap();
        assert!(
            scene.contains(&format!("\"volume\": \"http://{host}/{name}\"")) && !scene.contains("secret"),
            "{scene}"
        );
        // This server wants no password.
        let again = voxsplat(dir.path(), "render scene.json -o again.png");
        assert!(again.status.success() && read("again.png") == read("here.png"), "{name}");
        for format in ["", "--json"] {
            let info = stdout(&voxsplat(dir.path(), &format!("info {url} {one} {format}")));
            assert!(info.contains(name) && !info.contains("secret"), "{info}");
        }
    }
}

#[test]
fn a_clip_and_a_region_fetch_the_chunks_they_need_and_draw_the_same_bytes() {
    if !CAN_FETCH {
        return;
    }
    let (dir, server) = (folder(), Server::new(ball));
    let url = format!("{}/p.zarr", server.url);
    std::fs::write(dir.path().join("t.json"), TRANSFER).unwrap();
    let read = |name: &str| std::fs::read(dir.path().join(name)).unwrap();
    let draw = |options: &str, name: &str| {
        let line = format!("render {url} --light off --painter cpu --size 64 -o {name} {options}");
        let output = voxsplat(dir.path(), &line);
        assert!(output.status.success(), "{}", complaint(&output));
        (chunks(&server).len(), String::from_utf8(output.stderr).unwrap())
    };
    let view = "--frame volume --azimuth 0 --elevation 0 --transfer t.json";
    let (all, _) = draw(view, "all.png");
    assert_eq!(all, 64);
    for clip in ["--clip voxels::20,:20,:20", "--clip -1,-1,-1,-60"] {
        // A preset depends on all values, so all chunks are fetched.
        let (whole, said) = draw(&format!("--transfer grayscale {clip}"), "whole.png");
        assert!(whole == 64 && said.contains("note: fetching all chunks because the transfer function"), "{said}");
        let (few, said) = draw(&format!("{view} {clip}"), "clip.png");
        assert!(few < 40 && !said.contains("fetching all"), "{clip}: {few} {said}");
        let copy = copied(dir.path());
        let line = format!("render {copy} --light off --painter cpu --size 64 -o here.png {view} {clip}");
        assert!(voxsplat(dir.path(), &line).status.success());
        assert!(read("here.png") == read("clip.png"), "{clip}");
    }
    // The front left upper corner of the box.
    let (few, said) = draw(&format!("{view} --region 0,0,12,12"), "corner.png");
    assert!(few < 40 && !said.contains("fetching all"), "{few} {said}");
    let copy = copied(dir.path());
    let line = format!("render {copy} --light off --painter cpu --size 64 -o here.png {view} --region 0,0,12,12");
    assert!(voxsplat(dir.path(), &line).status.success());
    assert!(read("here.png") == read("corner.png"));
    let (whole, said) = draw("--transfer t.json --frame visible --region 0,0,12,12", "visible.png");
    assert!(whole == 64 && said.contains("because the frame depends on them"), "{said}");
}

/// A transfer function of absolute values.
const TRANSFER: &str = r#"{"unit_distance": 1, "points": [{"value": 0, "color": [1, 1, 1], "opacity": 0.01},
    {"value": 255, "color": [1, 0.5, 0.2], "opacity": 0.1}]}"#;

/// An array of 128^3 bytes in 64 chunks of 32^3, which are not compressed.
fn ball(request: &Request) -> Answer {
    let numbers: Vec<u32> = request.path().split('/').filter_map(|name| name.parse().ok()).collect();
    match (&numbers[..], request.path()) {
        (&[z, y, x], _) => {
            let value = |n: u32| {
                let at = [x * 32 + n % 32, y * 32 + n / 32 % 32, z * 32 + n / 1024];
                (at[0] + 2 * at[1] + 3 * at[2]) as u8
            };
            Answer::File((0..1 << 15).map(value).collect())
        }
        (_, "/p.zarr/zarr.json") => Answer::File(
            br#"{"zarr_format": 3, "node_type": "array", "shape": [128, 128, 128], "data_type": "uint8",
            "chunk_grid": {"name": "regular", "configuration": {"chunk_shape": [32, 32, 32]}}, "fill_value": 0,
            "chunk_key_encoding": {"name": "default"}, "codecs": [{"name": "bytes"}],
            "dimension_names": ["z", "y", "x"]}"#
                .to_vec(),
        ),
        _ => Answer::Status(404, "", ""),
    }
}

/// The folder of the array of a server.
fn copied(dir: &Path) -> String {
    let folder = dir.join("copy.zarr");
    let file = |path: &str| {
        let request = Request { target: format!("/p.zarr/{path}"), ..Request::default() };
        let Answer::File(bytes) = ball(&request) else { panic!("{path}") };
        let path = folder.join(path);
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        std::fs::write(path, bytes).unwrap();
    };
    file("zarr.json");
    (0..64).for_each(|n| file(&format!("c/{}/{}/{}", n / 16, n / 4 % 4, n % 4)));
    folder.to_str().unwrap().to_owned()
}

#[test]
fn a_limit_is_refused_with_the_way_on() {
    if !CAN_FETCH {
        return;
    }
    let (dir, server) = (folder(), Server::new(ball));
    let output = voxsplat(dir.path(), &format!("render {}/p.zarr -o a.png --fetch-limit 1M", server.url));
    let said = complaint(&output);
    assert!(
        said.contains("about 2.0 MiB to fetch, over the limit of 1.0 MiB: read a coarser level with --pyramid"),
        "{said}"
    );
    assert!(chunks(&server).is_empty());
}

#[test]
fn s3_is_read_anonymously_or_with_the_keys_of_the_environment() {
    if !CAN_FETCH {
        return;
    }
    let (dir, server) = (folder(), Server::of(data("")));
    for (keys, is_signed) in
        [(&[][..], false), (&[("AWS_ACCESS_KEY_ID", "id"), ("AWS_SECRET_ACCESS_KEY", "secret")], true)]
    {
        let mut command = Command::new(env!("CARGO_BIN_EXE_voxsplat"));
        command.current_dir(dir.path()).args(["info", "s3://zarr/v3-shards.zarr"]);
        command.env("AWS_ENDPOINT_URL", server.url.trim_end_matches('/')).envs(keys.iter().copied());
        let output = command.env("AWS_SESSION_TOKEN", "session").output().unwrap();
        let requests = server.requests();
        assert!(requests.iter().all(|of| of.path().starts_with("/zarr/v3-shards.zarr/")), "{requests:?}");
        let authorization = |of: &Request| {
            let value = of.header("authorization").unwrap_or_default().to_owned();
            let names = if of.header("range").is_some() { "host;range;x-amz-content" } else { "host;x-amz-content" };
            value.starts_with("AWS4-HMAC-SHA256 Credential=id/")
                && value.contains(&format!("SignedHeaders={names}"))
                && of.header("x-amz-security-token") == Some("session")
        };
        assert_eq!(requests.iter().all(authorization), is_signed, "{requests:?}");
        assert!(stdout(&output).starts_with("volume       s3://zarr/v3-shards.zarr\n"), "{output:?}");
    }
}

#[test]
fn a_proxy_of_the_environment_is_asked() {
    if !CAN_FETCH {
        return;
    }
    let (dir, server) = (folder(), Server::new(|_| Answer::Status(403, "", "no")));
    let mut command = Command::new(env!("CARGO_BIN_EXE_voxsplat"));
    command.current_dir(dir.path()).args(["info", "http://example.invalid/a.nrrd"]).env("ALL_PROXY", &server.url);
    assert!(!command.output().unwrap().status.success());
    assert!(server.requests().iter().any(|of| of.target.contains("example.invalid")));
}
