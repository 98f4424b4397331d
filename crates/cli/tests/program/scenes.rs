//! Scene files, standard input and output, and turntables: the program itself, run in a temporary directory.

use std::io::Write;
use std::path::Path;
use std::process::{Command, Output, Stdio};

use voxsplat::image::Image;

use crate::cli::{complaint, folder, ramp, refused, stdout, voxsplat};

/// Options of a small picture that needs no device.
const SMALL: &str = "--reference --size 8";

/// What a command writes to a file, after it has succeeded.
fn made(dir: &Path, arguments: &str, file: &str) -> Vec<u8> {
    let output = voxsplat(dir, arguments);
    assert!(output.status.success(), "{arguments}: {}", String::from_utf8_lossy(&output.stderr));
    std::fs::read(dir.join(file)).unwrap_or_else(|e| panic!("{arguments}: {file}: {e}"))
}

/// Runs the program with bytes on its standard input.
fn fed(dir: &Path, arguments: &str, input: &[u8]) -> Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_voxsplat"));
    command.current_dir(dir).args(arguments.split_whitespace());
    let mut child = command.stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
    child.stdin.take().unwrap().write_all(input).unwrap();
    child.wait_with_output().unwrap()
}

fn scene_refused(scene: &str, reason: &str) {
    let dir = folder();
    std::fs::write(dir.path().join("s.json"), scene).unwrap();
    let output = voxsplat(dir.path(), "render s.json -o a.png");
    let said = complaint(&output);
    assert_eq!(output.status.code(), Some(2), "{said}");
    assert!(said.contains("s.json: ") && said.contains(reason), "{scene}: {said}");
}

#[test]
fn a_scene_makes_the_bytes_of_its_command_line() {
    let dir = folder();
    let input = ramp(dir.path());
    let data = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/data/transfer");
    std::fs::copy(data.join("slicer.vp"), dir.path().join("a.vp")).unwrap();
    std::fs::create_dir(dir.path().join("kept")).unwrap();
    let looks = [
        "",
        "--transfer a.vp --window 12,24 --azimuth -30.5 --up 0,1,0 --light 40,30:2 --light headlight",
        "--transfer ct-bone --shading post --background #ff8000 --projection perspective --fov 40",
        "--transfer map:batlow --window 12,24 --spacing 1,1,2.5 --model mip",
    ];
    for (i, look) in looks.into_iter().enumerate() {
        let line = format!("render {input} {SMALL} {look} -o {i}.png --save-scene kept/{i}.json");
        let picture = made(dir.path(), &line, &format!("{i}.png"));
        // The scene holds the transfer function, not the path of its file.
        drop(std::fs::rename(dir.path().join("a.vp"), dir.path().join("gone.vp")));
        let again = made(dir.path(), &format!("render kept/{i}.json -o again.png"), "again.png");
        drop(std::fs::rename(dir.path().join("gone.vp"), dir.path().join("a.vp")));
        assert!(
            again == picture,
            "{look}: {}",
            std::fs::read_to_string(dir.path().join(format!("kept/{i}.json"))).unwrap()
        );
        // A scene of a scene is the same scene.
        let copied =
            made(dir.path(), &format!("render kept/{i}.json -o again.png --save-scene kept/b.json"), "kept/b.json");
        assert!(copied == std::fs::read(dir.path().join(format!("kept/{i}.json"))).unwrap(), "{look}");
    }
    let text = std::fs::read_to_string(dir.path().join("kept/1.json")).unwrap();
    assert!(text.contains("\"volume\": \"../ramp.raw\"") && text.contains("\"azimuth\": -30.5"), "{text}");
    assert!(text.contains("\"light\": [\"40,30:2\",\"headlight\"]") && text.contains("\"points\": ["), "{text}");
}

#[test]
fn a_scene_of_labels_finds_its_files() {
    let dir = folder();
    let input = ramp(dir.path());
    let header = "NRRD0004\ntype: uint8\ndimension: 3\nsizes: 4 3 2\nencoding: raw\n\n";
    let labels: Vec<u8> = (0..24).map(|i| i / 7).collect();
    std::fs::write(dir.path().join("l.nrrd"), [header.as_bytes(), &labels].concat()).unwrap();
    std::fs::write(dir.path().join("l.ctbl"), "1 one 255 0 0 255\n2 two 0 255 0 255\n").unwrap();
    std::fs::create_dir(dir.path().join("kept")).unwrap();
    for look in [
        "--transfer gray --labels l.nrrd --label-table l.ctbl --label two:0.3 --label 1:blue --label all:x0.5",
        "--transfer labels --label all:0.2 --light off",
        "--transfer gray --mask l.nrrd:1-2",
    ] {
        let line = format!("render {input} {SMALL} {look} -o a.png --save-scene kept/a.json");
        let picture = made(dir.path(), &line, "a.png");
        let again = made(dir.path(), "render kept/a.json -o again.png", "again.png");
        let text = std::fs::read_to_string(dir.path().join("kept/a.json")).unwrap();
        assert!(again == picture, "{text}");
        assert!(picture != made(dir.path(), &format!("render {input} {SMALL} -o b.png --transfer gray"), "b.png"));
    }
}

#[test]
fn options_of_the_command_line_replace_those_of_a_scene() {
    let dir = folder();
    let input = ramp(dir.path());
    let scene = made(
        dir.path(),
        &format!("render {input} {SMALL} -o a.png --azimuth 10 --transfer gray --save-scene s.json"),
        "s.json",
    );
    assert!(String::from_utf8(scene).unwrap().contains("\"transfer\": \"gray\""));
    for (over, plain) in [
        ("--azimuth 50", "--azimuth 50 --transfer gray"),
        ("--direction 1,0,0", "--direction 1,0,0 --transfer gray"),
        ("--transfer map:vik --window 12,24", "--azimuth 10 --transfer map:vik --window 12,24"),
    ] {
        let replaced = made(dir.path(), &format!("render s.json -o b.png {over}"), "b.png");
        assert!(replaced == made(dir.path(), &format!("render {input} {SMALL} -o c.png {plain}"), "c.png"), "{over}");
    }
}

#[test]
fn a_scene_may_have_several_outputs() {
    let dir = folder();
    let input = ramp(dir.path());
    std::fs::create_dir(dir.path().join("in")).unwrap();
    std::fs::write(
        dir.path().join("in/s.json"),
        r#"{"volume": "../ramp.raw", "dims": [4, 3, 2], "type": "u8", "reference": true, "size": 8, "azimuth": 20,
            "outputs": [{"output": "a.png"}, {"output": "b.png", "azimuth": 70, "size": "8x4"},
                        {"output": "c.exr", "direction": [0, 1, 0], "transfer": "grayscale"}]}"#,
    )
    .unwrap();
    let output = voxsplat(dir.path(), "render in/s.json");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    for (file, options) in [
        ("a.png", "--size 8 --azimuth 20"),
        ("b.png", "--size 8x4 --azimuth 70"),
        ("c.exr", "--size 8 --direction 0,1,0 --transfer grayscale"),
    ] {
        made(dir.path(), &format!("render {input} --reference --frame visible -o {file} {options}"), file);
        let [of_scene, single] =
            [dir.path().join("in"), dir.path().to_owned()].map(|f| Image::load(f.join(file)).unwrap());
        assert!(of_scene == single, "{file}");
    }
    let said = complaint(&voxsplat(dir.path(), "render in/s.json -o d.png"));
    assert!(said.contains("the scene has 3 outputs of its own"), "{said}");
}

#[test]
fn a_scene_that_is_wrong_is_refused_with_the_nearest_name() {
    scene_refused(r#"{"volume": "demo:sphere:8", "azimut": 3}"#, "'--azimuth'");
    scene_refused(r#"{"azimuth": 3}"#, "\"volume\" is missing");
    scene_refused(r#"{"volume": "demo:sphere:8", "light": [], "size": 8}"#, "expected one value or more");
    scene_refused(r#"{"volume": "demo:sphere:8", "azimuth": [[1]]}"#, "expected texts and numbers");
    scene_refused(r#"{"volume": "demo:sphere:8", "axes": 1}"#, "expected true or false");
    scene_refused(r#"{"volume": "demo:sphere:8", "size": "big"}"#, "WIDTHxHEIGHT");
    scene_refused(r#"{"volume": "demo:sphere:8", "outputs": []}"#, "a list of objects");
    scene_refused(r#"{"volume": "demo:sphere:8", "outputs": [{"spacing": 1}]}"#, "for the whole scene");
    let dir = folder();
    for (scene, reason) in [
        ("{]", "s.json: no scene, which is a JSON object"),
        (r#"{"volume": "demo:sphere:8", "transfer": {"points": []}}"#, "s.json: transfer function: 0 control points"),
    ] {
        std::fs::write(dir.path().join("s.json"), scene).unwrap();
        let output = voxsplat(dir.path(), "render s.json -o a.png");
        assert!(complaint(&output).contains(reason), "{reason}: {:?}", output.status);
        assert_eq!(output.status.code(), Some(1), "{reason}");
    }
    refused("render demo:sphere", 2, "--output FILE is missing");
}

#[test]
fn a_picture_goes_to_standard_output_and_a_volume_comes_from_standard_input() {
    let dir = folder();
    let input = ramp(dir.path());
    let file = made(dir.path(), &format!("render {input} {SMALL} -o a.png --transfer gray --azimuth 0"), "a.png");
    let bytes = std::fs::read(dir.path().join("ramp.raw")).unwrap();
    let line = format!("render - --dims 4,3,2 --type u8 {SMALL} -o - --transfer gray --azimuth 0");
    let output = fed(dir.path(), &line, &bytes);
    assert!(output.status.success() && output.stderr.is_empty(), "{}", String::from_utf8_lossy(&output.stderr));
    assert!(output.stdout == file);
    let said = complaint(&voxsplat(dir.path(), &format!("render {input} {SMALL} -o - --stats")));
    assert!(said.contains("standard output takes the picture"), "{said}");
    let said = complaint(&fed(dir.path(), &format!("{line} --save-scene s.json"), &bytes));
    assert!(said.contains("standard input cannot be named"), "{said}");
}

#[test]
fn quiet_leaves_out_notes_and_keeps_errors() {
    let dir = folder();
    let input = ramp(dir.path());
    let line = format!("render {input} {SMALL} -o a.png");
    assert!(!voxsplat(dir.path(), &line).stderr.is_empty());
    assert!(voxsplat(dir.path(), &format!("{line} --quiet")).stderr.is_empty());
    assert!(complaint(&voxsplat(dir.path(), "-q info missing.nrrd")).contains("cannot read"));
}

#[test]
fn completions_and_manual_pages_know_every_option() {
    let dir = folder();
    for shell in ["bash", "elvish", "fish", "powershell", "zsh"] {
        let text = stdout(&voxsplat(dir.path(), &format!("completions {shell}")));
        assert!(text.contains("save-scene") && text.contains("turntable"), "{shell}");
    }
    assert!(stdout(&voxsplat(dir.path(), "man")).contains("Exit codes"));
    let page = stdout(&voxsplat(dir.path(), "man render"));
    assert!(
        page.starts_with(".ie")
            && page.contains("save\\-scene")
            && page.contains("EXAMPLES") | page.contains("Examples")
    );
    refused("man paint", 2, "expected one of render");
    refused("completions tcsh", 2, "bash");
}

#[test]
fn a_turntable_is_the_pictures_of_its_views() {
    let dir = folder();
    let input = ramp(dir.path());
    let turn = |options: &str| voxsplat(dir.path(), &format!("turntable {input} {SMALL} --frames 4 {options}"));
    let output = turn("-o {frame}.png --azimuth 10 --transfer ct-bone");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    for (frame, azimuth) in [10, 100, 190, 280].into_iter().enumerate() {
        let line = format!("render {input} {SMALL} --frame visible -o a.png --azimuth {azimuth} --transfer ct-bone");
        let single = made(dir.path(), &line, "a.png");
        assert!(std::fs::read(dir.path().join(format!("000{frame}.png"))).unwrap() == single, "{frame}");
    }
    // Studio light stands still, or comes along with the eye.
    let frame = |light: &str| {
        assert!(turn(&format!("-o {{frame}}.png --transfer gray --light {light}")).status.success());
        std::fs::read(dir.path().join("0001.png")).unwrap()
    };
    let [still, follows] = ["studio", "studio:eye"].map(frame);
    let line = format!("render {input} {SMALL} --frame visible -o a.png --azimuth 90 --transfer gray --light studio");
    assert!(follows == made(dir.path(), &line, "a.png") && follows != still);
    assert!(turn("-o {frame}.png --azimuth 10 --transfer ct-bone").status.success());
    // A part of the frames, and of these what is not there.
    let time = |name: &str| std::fs::metadata(dir.path().join(name)).and_then(|meta| meta.modified()).ok();
    let names = ["0000.png", "0001.png", "0002.png", "0003.png"];
    let before = names.map(time);
    std::fs::remove_file(dir.path().join("0003.png")).unwrap();
    assert!(turn("-o {frame}.png --transfer ct-bone --part 2/2 --resume").status.success());
    let after = names.map(time);
    assert_eq!(after[..3], before[..3]);
    assert!(after[3].is_some());
    assert!(turn("-o a.gif --transfer gray").status.success());
    assert!(std::fs::read(dir.path().join("a.gif")).unwrap().starts_with(b"GIF89a"));
    assert!(turn("-o a.html --transfer gray").status.success());
    let page = std::fs::read_to_string(dir.path().join("a.html")).unwrap();
    assert!(page.starts_with("<!doctype html>") && page.contains("<p>voxsplat turntable "));
    std::fs::write(dir.path().join("k.json"), r#"[{"frame": 0, "zoom": 1}, {"frame": 3, "zoom": 2}]"#).unwrap();
    let film = turn("-o - --transfer gray --key-frames k.json");
    assert_eq!(film.stdout.len(), "YUV4MPEG2 W8 H8 F25000:1000 Ip A1:1 C444\n".len() + 4 * (6 + 3 * 64));
}

/// Events and the frame that each has to show, of six.
const EVENTS: &str = r#"<script>
const key = (key, target = document.body) => target.dispatchEvent(new KeyboardEvent("keydown", { key, bubbles: true }));
const pointer = (name, clientX, isPrimary = true) => picture.dispatchEvent(
  new PointerEvent(name, { clientX, isPrimary, pointerId: isPrimary ? 1 : 2, pointerType: "touch", bubbles: true }));
picture.setPointerCapture = () => {};
const seen = [];
const see = () => seen.push(frame);
key("ArrowRight"); see();
key("Home"); key("ArrowLeft"); see();
key("ArrowRight", place); see();
key("End"); see();
key("Home"); see();
pointer("pointerdown", 100); pointer("pointerdown", 300, false); pointer("pointermove", 300, false); see();
pointer("pointermove", 100 - picture.clientWidth); see();
pointer("pointerup", 0); pointer("pointermove", 500); see();
const said = [play.textContent];
play.click(); said.push(play.textContent);
key(" "); said.push(play.textContent);
key(" "); said.push(play.textContent);
pointer("pointerdown", 100); said.push(play.textContent);
const wide = document.documentElement.scrollWidth > innerWidth;
const small = Math.min(play.offsetHeight, place.offsetHeight) < 44;
document.title = `${seen} ${said} ${place.getAttribute("aria-valuetext")} ${wide} ${small}`;
</script>"#;

/// In a browser, if there is one: `chromium`, or the program that VOXSPLAT_TEST_BROWSER names.
#[test]
fn a_page_turns_by_touch_keys_and_button_and_fits_a_phone() {
    let dir = folder();
    let made = voxsplat(dir.path(), "turntable demo:sphere:8 --frames 6 --size 512 -o a.html --light off");
    assert!(made.status.success());
    let page = std::fs::read_to_string(dir.path().join("a.html")).unwrap();
    for part in ["name=\"viewport\"", "touch-action: pan-y", "aria-label=\"Frame\"", "type=\"button\">Play<"] {
        assert!(page.contains(part), "{part}");
    }
    let tested = page.replace("</body>", &format!("{EVENTS}</body>"));
    std::fs::write(dir.path().join("b.html"), tested).unwrap();
    let browser = std::env::var_os("VOXSPLAT_TEST_BROWSER").unwrap_or("chromium".into());
    let options = "--headless --no-sandbox --disable-gpu --window-size=390,844 --dump-dom";
    let mut command = Command::new(browser);
    command.args(options.split(' ')).arg(format!("--user-data-dir={}", dir.path().join("profile").display()));
    let Ok(shown) = command.arg(format!("file://{}", dir.path().join("b.html").display())).output() else {
        println!("there is no browser: the page is not tried");
        return;
    };
    let text = String::from_utf8_lossy(&shown.stdout).into_owned();
    let title = text.split("<title>").nth(1).and_then(|title| title.split("</title>").next()).unwrap_or(&text);
    assert_eq!(title, "1,5,0,5,0,0,3,3 Play,Stop,Play,Stop,Play frame 4 of 6 false false");
}

#[test]
fn a_turntable_that_makes_no_sense_is_refused() {
    let all = "turntable demo:sphere:8 --frames 4";
    refused(&format!("{all} -o a.png"), 2, "a name with {frame}");
    refused(all, 2, "--output is missing");
    refused(&format!("{all} -o {{frame}}.jpg"), 2, ".png or .exr");
    refused(&format!("{all} -o a.gif --part 1/2"), 2, "--part needs a file for each frame");
    refused(&format!("{all} -o a.gif --background transparent"), 2, "no alpha");
    refused(&format!("{all} -o a.gif --direction 1,0,0"), 2, "turns the azimuth");
    refused(&format!("{all} -o a.gif --verify"), 2, "not for a turntable");
    refused(&format!("{all} -o a.gif --part 3/2"), 2, "I from 1 to N");
    refused(&format!("{all} -o a.gif --rate 0"), 2, "over 0");
}
