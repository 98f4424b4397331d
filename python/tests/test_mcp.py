"""The server for agents: a client of the SDK calls every tool."""

from __future__ import annotations

import base64
import json
import os
import signal
import subprocess
import sys
from collections.abc import Awaitable, Callable
from io import BytesIO
from pathlib import Path
from typing import Any

import anyio
import numpy as np
import PIL.Image
import pytest
import voxsplat
import yaml
from conftest import REPOSITORY, samples
from mcp import Client, StdioServerParameters, stdio_client
from mcp.types import CallToolResult, ImageContent, TextContent
from voxsplat.folders import Folders
from voxsplat.tools import make_server

TOOLS = {"list_volumes", "describe_volume", "list_presets", "render", "compare_views", "slices"}
# Small pictures, without a driver.
SMALL = {"size": 128, "painter": "cpu"}
DETACHED = "NRRD0004\ntype: uint8\ndimension: 3\nsizes: 2 2 2\nencoding: raw\ndata file: {}\n\n"
TABLE = "# Color\n1 soft 200 120 90 128\n"


@pytest.fixture
def folder(scan: Path, tmp_path: Path) -> Path:
    """A folder of volumes, with links that lead out of it, beside a secret."""
    inside, secret = tmp_path / "inside", tmp_path / "secret"
    for made in (inside, inside / "zarr", secret):
        made.mkdir()
    np.save(secret / "volume.npy", samples())
    (secret / "8.raw").write_bytes(bytes(range(8)))
    (secret / "table.ctbl").write_text(TABLE)
    (secret / "look.json").write_text('{"points": [{"value": 1, "color": "red", "opacity": 1}]}')
    (inside / "scan.nii").write_bytes(scan.read_bytes())
    np.save(inside / "labels.npy", (samples() > 40).astype(np.uint8))
    np.savez(inside / "two.npz", a=samples(), b=samples())
    for name, data in (("inside.nhdr", "8.raw"), ("outside.nhdr", secret / "8.raw"), ("up.nhdr", "../secret/8.raw")):
        (inside / name).write_text(DETACHED.format(data))
    (inside / "8.raw").write_bytes(bytes(range(8)))
    (inside / "list.nhdr").write_text(DETACHED.format("LIST") + f"{secret / '8.raw'}\n")
    (inside / "outside.mhd").write_text(
        f"NDims = 3\nDimSize = 2 2 2\nElementType = MET_UCHAR\nElementDataFile = {secret / '8.raw'}\n"
    )
    (inside / "broken.nii").write_bytes(scan.read_bytes()[:1000])
    (inside / "notes.txt").write_text("no volume")
    (inside / "table.ctbl").write_text(TABLE)
    (inside / "link.npy").symlink_to(secret / "volume.npy")
    (inside / "linked").symlink_to(secret)
    (inside / "zarr/.zarray").write_text("{}")
    (inside / "zarr/0.0.0").symlink_to(secret / "8.raw")
    return inside


def asked(folder: Path, work: Callable[[Client], Awaitable[Any]]) -> Any:
    """Return what a client does with a server in this process."""

    async def connected() -> Any:
        async with Client(make_server(Folders([str(folder)]))) as client:
            return await work(client)

    return anyio.run(connected)


def called(folder: Path, tool: str, **arguments: Any) -> CallToolResult:
    return asked(folder, lambda client: client.call_tool(tool, arguments))


def picture_of(result: CallToolResult) -> tuple[bytes, str]:
    """Return the PNG and the text of a result."""
    assert not result.is_error, result.content
    image, text = result.content
    assert isinstance(image, ImageContent) and image.mime_type == "image/png" and isinstance(text, TextContent)
    return base64.b64decode(image.data), text.text


def fault_of(result: CallToolResult) -> str:
    """Return the line of an error."""
    (text,) = result.content
    assert result.is_error and isinstance(text, TextContent), result.content
    assert text.text and "\n" not in text.text and "Traceback" not in text.text
    return text.text


def faults(folder: Path, calls: list[tuple[str, dict[str, Any]]]) -> list[str]:
    """Return the errors of calls by one client."""

    async def work(client: Client) -> list[str]:
        return [fault_of(await client.call_tool(tool, words)) for tool, words in calls]

    return asked(folder, work)


def side(png: bytes) -> tuple[int, int]:
    """Return width and height of a PNG."""
    assert png.startswith(b"\x89PNG\r\n\x1a\n")
    return int.from_bytes(png[16:20], "big"), int.from_bytes(png[20:24], "big")


def test_a_client_calls_every_tool_over_stdio(folder: Path) -> None:
    async def work() -> tuple[Any, dict[str, CallToolResult]]:
        server = StdioServerParameters(
            command=sys.executable, args=["-m", "voxsplat.mcp", str(folder)], env={**os.environ}
        )
        async with Client(stdio_client(server)) as client:
            calls: dict[str, dict[str, Any]] = {
                "list_volumes": {},
                "describe_volume": {"volume": "scan.nii"},
                "list_presets": {},
                "render": {"volume": "scan.nii", **SMALL},
                "compare_views": {"volume": "scan.nii", "options": SMALL},
                "slices": {"volume": "scan.nii", "size": 384},
            }
            assert client.server_info.version == voxsplat.__version__
            results = {name: await client.call_tool(name, words) for name, words in calls.items()}
            return await client.list_tools(), results

    listed, results = anyio.run(work)
    assert {tool.name for tool in listed.tools} == set(results) == TOOLS
    for tool in listed.tools:
        assert tool.annotations.read_only_hint and len(tool.description) > 40
        for name, option in tool.input_schema["properties"].items():
            assert len(option["description"]) > 10, (tool.name, name)
    assert "ct-bone" in results["list_presets"].structured_content["presets"]
    assert "map:viridis" in results["list_presets"].structured_content["colour_maps"]
    assert side(picture_of(results["render"])[0]) == (128, 128)
    assert side(picture_of(results["compare_views"])[0]) == (414, 316)
    assert side(picture_of(results["slices"])[0]) == (384, 384)


def test_slices_are_the_ones_of_the_package(folder: Path) -> None:
    words = {"at": [20, -12, 30], "planes": ["axial"], "size": [400, 300]}
    png, text = picture_of(called(folder, "slices", volume="scan.nii", **words))
    image = voxsplat.slices(folder / "scan.nii", **words)
    assert png == image.to_png() and "400 x 300" in text


def test_pictures_and_notes_are_the_ones_of_the_package(folder: Path) -> None:
    path = folder / "scan.nii"
    png, text = picture_of(called(folder, "render", volume="scan.nii", **SMALL))
    image = voxsplat.render(path, size=128, painter="cpu")
    assert png == image.to_png()
    assert text.splitlines() == ["scan.nii, 128 x 128 pixels", *(f"note: using {choice}" for choice in image.choices)]
    look = {"azimuth": 40, "elevation": -10, "light": [40, 30], "iso": [[50, "gold"]], "clip": "voxels:5:,:,:"}
    look |= {"background": "white"}
    png, _ = picture_of(called(folder, "render", volume=str(path), size=[160, 128], painter="cpu", **look))
    look |= {"light": (40, 30), "iso": [(50, "gold")]}
    assert png == voxsplat.render(path, size=(160, 128), painter="cpu", **look).to_png()
    points = [[20, "#000000", 0.0], [60, "gold", 0.5]]
    png, _ = picture_of(called(folder, "render", volume="two.npz:b", transfer=points, spacing=[2, 1, 1], **SMALL))
    assert png == voxsplat.render(f"{folder}/two.npz:b", points, spacing=(2, 1, 1), size=128, painter="cpu").to_png()


def test_files_beside_the_volume_are_drawn(folder: Path) -> None:
    words = {"labels": "labels.npy", "label": {"1": "red"}, "label_table": "table.ctbl"}
    png, _ = picture_of(called(folder, "render", volume="two.npz:a", **words, **SMALL))
    words = {"labels": folder / "labels.npy", "label": {1: "red"}, "label_table": folder / "table.ctbl"}
    assert png == voxsplat.render(f"{folder}/two.npz:a", **words, size=128, painter="cpu").to_png()
    over = [["two.npz:b", "hot", [40, 80]]]
    png, _ = picture_of(called(folder, "render", volume="two.npz:a", overlays=over, **SMALL))
    over = [(f"{folder}/two.npz:b", "hot", (40, 80))]
    assert png == voxsplat.render(f"{folder}/two.npz:a", overlays=over, size=128, painter="cpu").to_png()
    (folder / "mesh.stl").write_text(
        "solid\nfacet normal 0 0 1\nouter loop\nvertex 0 0 5\nvertex 30 0 5\nvertex 0 30 5\nendloop\nendfacet\n"
        "endsolid\n"
    )
    mesh = f"{folder}/mesh.stl"
    for one, given in (("mesh.stl:gold", f"{mesh}:gold"), (["mesh.stl", "red"], (mesh, "red"))):
        png, _ = picture_of(called(folder, "render", volume="two.npz:a", meshes=[one], **SMALL))
        assert png == voxsplat.render(f"{folder}/two.npz:a", meshes=[given], size=128, painter="cpu").to_png()
    np.save(folder / "empty.npy", np.zeros_like(samples()))
    _, text = picture_of(called(folder, "render", volume="two.npz:a", mask="empty.npy", **SMALL))
    assert "\nwarning: " in text


def test_a_sheet_has_the_pictures_above_their_titles(folder: Path) -> None:
    views = [{"azimuth": 0}, {"azimuth": 90}, {"model": "mip"}]
    options = {"size": [200, 160], "painter": "cpu"}
    png, text = picture_of(called(folder, "compare_views", volume="scan.nii", views=views, options=options))
    assert text.splitlines()[:3] == ["1: azimuth 0", "2: azimuth 90", "3: model mip"]
    assert side(png) == (420, 384)
    pixels = np.asarray(PIL.Image.open(BytesIO(png)).convert("RGB"))
    for number, view in enumerate(views):
        alone = voxsplat.render(folder / "scan.nii", size=(200, 160), painter="cpu", frame="visible", **view).rgba8()[..., :3]
        x, y = 210 * (number % 2) + 5, 192 * (number // 2) + 5
        assert (pixels[y : y + 160, x : x + 200] == alone).all()
        assert (pixels[y + 160 : y + 187, x : x + 200] != 0).any()
    assert (pixels[192:, 210:] == 0).all()


def test_titles_of_a_sheet_fit(folder: Path) -> None:
    points = [[20, "black", 0.0], [60, "gold", 0.5], [80, "#123456", 0.9]]
    views = [{"transfer": points, "azimuth": 30}, {"labels": "labels-of-a-long-name-日本-without-a-space.npy"}]
    (folder / "labels.npy").rename(folder / views[1]["labels"])
    for size in (128, 400, [900, 128], [128, 900]):
        options = {"size": size, "painter": "cpu"}
        _, text = picture_of(called(folder, "compare_views", volume="two.npz:a", views=views, options=options))
        first, second, *_ = text.splitlines()
        assert first == "1: transfer [[20, black, 0.0], [60, gold, 0.5], [80, #123456, 0.9]], azimuth 30"
        assert second.startswith("2: labels labels-of-")


def test_volumes_are_described_with_their_box(folder: Path) -> None:
    found = called(folder, "describe_volume", volume="two.npz:a", spacing=[2, 1, 0.5]).structured_content
    assert found == voxsplat.info(f"{folder}/two.npz:a", spacing=(2, 1, 0.5)) | {"box": found["box"], "warnings": []}
    affine, shape = np.array(found["affine"]), np.array(found["shape"])
    corners = np.array([np.array([i, j, k]) * shape[::-1] - 0.5 for i in (0, 1) for j in (0, 1) for k in (0, 1)])
    world = corners @ affine[:3, :3].T + affine[:3, 3]
    assert np.allclose(found["box"], np.stack([world.min(0), world.max(0)], 1))


def test_volumes_are_listed_by_their_content(folder: Path) -> None:
    result = called(folder, "list_volumes").structured_content
    listed = {row["path"]: row["format"] for row in result["volumes"]}
    assert listed["scan.nii"] == "NIfTI" and listed["two.npz"] == "NumPy archive" and listed["inside.nhdr"] == "NRRD"
    # Neither other files nor links that lead out, and no chunks.
    assert not listed.keys() & {"notes.txt", "8.raw", "link.npy", "linked/volume.npy", "zarr/.zarray", "zarr/0.0.0"}
    assert listed["zarr"] == "Zarr"
    assert result["folders"] == [str(folder.resolve())] and result["left_off"] == ""
    for number in range(201):
        np.save(folder / f"zarr-{number}.npy", np.zeros((1, 1, 1), np.uint8))
    result = called(folder, "list_volumes").structured_content
    assert len(result["volumes"]) == 200 and result["left_off"]
    for name, expected in (("..", "outside"), ("scan.nii", "is no folder"), ("none", "there is no")):
        fault = asked(folder, lambda client, name=name: client.call_tool("list_volumes", {"folder": name}))
        assert expected in fault_of(fault)


@pytest.mark.parametrize("name", [
    "../secret/volume.npy", "{secret}/volume.npy", "link.npy", "linked/volume.npy", "zarr/../../secret/volume.npy",
    "../secret/none.npy", "/etc/passwd", "/etc/passwd:x", "outside.nhdr", "up.nhdr",
    "list.nhdr", "outside.mhd", "zarr", "https://example.org/a.zarr", "s3://bucket/a.zarr", "-", "none.nii", "a\0b",
])
def test_volumes_outside_of_the_folders_are_refused(folder: Path, name: str) -> None:
    name = name.format(secret=folder.parent / "secret")
    calls = [(tool, {"volume": name}) for tool in ("describe_volume", "render", "compare_views", "slices")]
    options = ({"labels": name}, {"mask": name}, {"overlays": [name]}, {"overlays": [[name, "hot"]]})
    calls += [("render", option | {"volume": "scan.nii"} | SMALL) for option in options]
    for (_, words), fault in zip(calls, faults(folder, calls), strict=True):
        assert fault.startswith(f"{next(iter(words))}: ") or "null" in fault, fault


@pytest.mark.parametrize("option", [
    {"transfer": "../secret/look.json"}, {"transfer": "{secret}/look.json"}, {"transfer": "linked/look.json"},
    {"transfer": "map:../secret/look.json"}, {"transfer": "{secret}/look.json#name"}, {"transfer": "-"},
    {"transfer": "secret-look"}, {"transfer": "map:secret-look"}, {"label_table": "../secret/table.ctbl"},
    {"label_table": "linked/table.ctbl"}, {"meshes": ["../secret/8.raw"]}, {"meshes": ["{secret}/8.raw:gold"]},
    {"meshes": [["linked/8.raw", "gold"]]}, {"overlays": [["scan.nii", "{secret}/look.json"]]},
])
def test_other_files_outside_of_the_folders_are_refused(
    folder: Path, option: dict[str, Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    secret = folder.parent / "secret"
    # The working directory of the server is no folder of it.
    (secret / "secret-look").write_text((secret / "look.json").read_text())
    monkeypatch.chdir(secret)
    option = json.loads(json.dumps(option).replace("{secret}", str(secret)))
    calls = [("render", option | SMALL), ("compare_views", {"views": [option], "options": SMALL})]
    for fault in faults(folder, [(tool, words | {"volume": "scan.nii"}) for tool, words in calls]):
        assert fault.startswith(f"{next(iter(option))}: "), fault
        assert "outside" in fault or "there is no" in fault


@pytest.mark.parametrize(("tool", "words", "expected"), [
    ("render", {"azimut": 3}, "'azimut' is no option of render; a similar option exists: azimuth"),
    ("render", {"cmap": "viridis"}, "'cmap' is no option of render: "),
    ("render", {"azimuth": "left"}, "azimuth: Input should be a valid number"),
    ("render", {"transfer": "ct-bones"}, "ct-bone"),
    ("render", {"zoom": -1}, "zoom is -1"),
    ("render", {"model": "mips"}, "model: "),
    ("render", {"size": 2049}, "size: 2049, expected up to 2048 pixels a side"),
    ("render", {"size": [1, 99999999999]}, "size: "),
    ("render", {"size": 0}, "size: "),
    ("render", {"overlays": [[]]}, "overlays: "),
    ("render", {"label": {"1": {"color": "red"}}}, "label: "),
    ("render", {"overlays": [["labels.npy", "hot", 3]]}, "overlays: "),
    ("render", {"volume": "scan.nii:/../../../etc/passwd"}, "no data set"),
    ("render", {"meshes": ["table.ctbl"]}, "table.ctbl"),
    ("render", {"volume": "broken.nii"}, "broken.nii"),
    ("render", {"volume": "notes.txt"}, "notes.txt"),
    ("render", {"volume": "two.npz"}, "two.npz"),
    ("render", {"volume": "demo:none"}, "none"),
    ("render", {"volume": 3}, "volume: Input should be a valid string"),
    ("list_volumes", {}, "'volume' is no option of list_volumes"),
    ("describe_volume", {"channel": 9}, "channel"),
    ("describe_volume", {"azimuth": 9}, "'azimuth' is no option of describe_volume"),
    ("compare_views", {"views": []}, "views: 0 views, expected 1 to 12"),
    ("compare_views", {"views": [{"azimut": 3}]}, "'azimut' is no option of render"),
    ("compare_views", {"views": [{"azimuth": "x"}]}, "azimuth: Input should be a valid number"),
    ("compare_views", {"options": {"size": 1500}}, "size: "),
    ("compare_views", {"views": [{"size": 128}, {"size": 256}]}, "size: views of 2 sizes"),
    ("describe", {}, "Unknown tool: describe"),
])
def test_bad_options_are_errors_of_one_line(folder: Path, tool: str, words: dict[str, Any], expected: str) -> None:
    assert expected in fault_of(called(folder, tool, **{"volume": "scan.nii"} | words))


def test_long_work_reports_progress(folder: Path) -> None:
    reports: list[tuple[float, str | None]] = []

    async def heard(done: float, total: float | None, message: str | None) -> None:
        reports.append((done, message))

    words = {"volume": "scan.nii", "views": [{"azimuth": 0}, {"azimuth": 90}], "options": SMALL}
    asked(folder, lambda client: client.call_tool("compare_views", words, progress_callback=heard))
    numbers = [done for done, _ in reports]
    assert len(numbers) > 1 and all(a < b for a, b in zip(numbers, numbers[1:], strict=False))
    assert any(message.startswith("2: azimuth 90: ") for _, message in reports)


def test_cancelled_work_ends(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    ended: list[bool] = []

    def endless(*_: Any, progress: Callable[[str, float], None], **__: Any) -> None:
        try:
            for _ in range(10_000_000):
                progress("voxels", 0.5)
        except BaseException:
            ended.append(True)
            raise

    async def work(client: Client) -> Any:
        with anyio.CancelScope() as scope:
            async def heard(*_: Any) -> None:
                scope.cancel()

            await client.call_tool("render", {"volume": "scan.nii"}, progress_callback=heard)
        # The next one gets its turn.
        return await client.call_tool("describe_volume", {"volume": "scan.nii"})

    monkeypatch.setattr(voxsplat, "render", endless)
    assert asked(folder, work).structured_content["sample_type"] == "i16"
    assert ended == [True]


def message(number: int | None, method: str, **parameters: Any) -> str:
    """Return a line of the protocol."""
    words = {"jsonrpc": "2.0", "method": method, "params": parameters}
    return json.dumps(words | ({"id": number} if number else {})) + "\n"


HELLO = {"protocolVersion": "2025-06-18", "capabilities": {}, "clientInfo": {"name": "test", "version": "1"}}


def started(folder: Path, *lines: str) -> subprocess.Popen[str]:
    """Start a server, and write lines to it."""
    words, pipe = [sys.executable, "-m", "voxsplat.mcp", str(folder)], subprocess.PIPE
    server = subprocess.Popen(words, stdin=pipe, stdout=pipe, stderr=pipe, text=True)
    server.stdin.write("".join(lines))
    server.stdin.flush()
    return server


def test_only_the_protocol_is_on_standard_output(folder: Path) -> None:
    lines = [message(1, "initialize", **HELLO), message(None, "notifications/initialized")]
    for number, words in enumerate(({"volume": "scan.nii", **SMALL}, {"volume": "broken.nii"}), 2):
        lines.append(message(number, "tools/call", name="render", arguments=words))
    server = started(folder, *lines, "no JSON\n")
    answers: dict[int, Any] = {}
    while len(answers) < 3:
        answer = json.loads(server.stdout.readline())
        assert answer["jsonrpc"] == "2.0"
        if "result" in answer:
            answers[answer["id"]] = answer["result"]
    rest, said = server.communicate(timeout=600)
    assert (server.returncode, rest) == (0, ""), said
    assert "Traceback" not in said
    assert answers[2]["content"][0]["type"] == "image" and answers[3]["isError"]


@pytest.mark.skipif(os.name != "posix", reason="signals of POSIX")
def test_an_interrupt_ends_the_server(folder: Path) -> None:
    with started(folder, message(1, "initialize", **HELLO)) as server:
        server.stdout.readline()
        server.send_signal(signal.SIGINT)
        # Its input is still open.
        assert server.wait(timeout=600) == -signal.SIGINT
        assert server.stderr.read() == ""


def run(*words: object, code: str = "from voxsplat.mcp import main; import sys; sys.exit(main())") -> tuple[int, str]:
    words = (sys.executable, "-c", code, *map(str, words))
    done = subprocess.run(words, capture_output=True, text=True, check=False, stdin=subprocess.DEVNULL)
    assert done.stdout == "" or "--version" in words
    return done.returncode, done.stdout + done.stderr


def test_the_command_refuses_to_serve_nothing(folder: Path) -> None:
    assert run("--version") == (0, f"voxsplat-mcp {voxsplat.__version__}\n")
    for words in ((), (folder / "scan.nii",), (folder / "none",), (folder, "none")):
        code, said = run(*words)
        assert code == 2 and "voxsplat-mcp: error: " in said, said
    assert run(folder) == (0, "")


def test_a_missing_extra_is_one_line(folder: Path) -> None:
    code = "import sys; sys.modules['mcp'] = None; from voxsplat.mcp import main; sys.exit(main())"
    code, said = run(folder, code=code)
    assert code == 1 and said.count("\n") == 1 and "pip install 'voxsplat[mcp]'" in said


def test_documents_for_agents_are_short_and_lead_somewhere() -> None:
    skill = (Path(voxsplat.__file__).parent / "SKILL.md").read_text()
    llms = (REPOSITORY / "docs/llms.txt").read_text()
    assert skill.count("\n") <= 60 and llms.count("\n") <= 60
    _, head, body = skill.split("---\n", 2)
    fields = yaml.safe_load(head)
    assert fields["name"] == "voxsplat" and 100 < len(fields["description"]) <= 1024 and body.startswith("\n# ")
    pages = [part.split(")")[0] for part in llms.split("](")[1:]]
    assert len(pages) > 10
    for page in pages:
        assert (REPOSITORY / "docs" / page).with_suffix(".md").is_file(), page
