"""`evaluate extraction` and the files it reads."""

from __future__ import annotations

import argparse
import contextlib
import gzip
import io
import json
import math
import struct
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from PIL import Image

from robot_app.drivers.base import DepthImage
from shared.geometry.camera import Intrinsics
from tools.evaluate.depth import extraction
from tools.evaluate.depth._kernels import back_project, back_project_tabled
from tools.evaluate.depth.files import DepthFileError, read_depth
from tools.evaluate.depth.floor import find_floor
from tools.evaluate.depth.pcd import decompress_lzf

CLOUDS = Path(__file__).resolve().parents[4] / ".." / "shared" / "data" / "depth" / "labelled_tabletop"


def box_depth_m() -> np.ndarray:
    depth = np.full((480, 640), 3.0)
    depth[150:330, 200:440] = 1.5
    return depth


def parse(*words: str) -> argparse.Namespace:
    parser = argparse.ArgumentParser()
    extraction.add_arguments(parser)
    return parser.parse_args(words)


def test_a_png_holds_millimetres(tmp_path: Path) -> None:
    path = tmp_path / "a.png"
    Image.fromarray(np.full((48, 64), 1234, np.uint16)).save(path)
    image = read_depth(path).image
    assert float(image.depth[0, 0]) * image.unit_m == pytest.approx(1.234)


@pytest.mark.parametrize("name", ["a.npy", "a.npy.gz"])
def test_an_array_holds_metres_and_what_is_no_depth_is_zero(tmp_path: Path, name: str) -> None:
    buffer = io.BytesIO()
    np.save(buffer, np.array([[0.5, math.nan], [-1.0, 50.0]]))
    data = buffer.getvalue()
    (tmp_path / name).write_bytes(gzip.compress(data) if name.endswith("gz") else data)
    image = read_depth(tmp_path / name).image
    assert (image.depth * image.unit_m).tolist() == [[0.5, 0.0], [0.0, 0.0]]


def test_an_array_of_millimetres_is_refused_and_one_without_a_depth_is_not(tmp_path: Path) -> None:
    np.save(tmp_path / "mm.npy", np.array([[1500.0, math.nan], [0.0, 1e308]]))
    np.save(tmp_path / "none.npy", np.array([[0.0, math.nan], [-1.0, math.inf]]))
    with pytest.raises(DepthFileError, match=r"mm\.npy: .*in metres"):
        read_depth(tmp_path / "mm.npy")
    assert not read_depth(tmp_path / "none.npy").image.depth.any()


def pcd_of(depth_m: np.ndarray, form: str, labels: np.ndarray | None = None) -> bytes:
    height, width = depth_m.shape
    columns, rows = np.meshgrid(np.arange(width) + 0.5, np.arange(height) + 0.5)
    fields = [(columns - 32) / 60 * depth_m, (rows - 24) / 60 * depth_m, depth_m]
    names = "x y z" if labels is None else "x y z label"
    types = "F F F" if labels is None else "F F F U"
    header = (
        f"# .PCD v0.7\nVERSION 0.7\nFIELDS {names}\nSIZE{' 4' * len(names.split())}\nTYPE {types}\n"
        f"WIDTH {width}\nHEIGHT {height}\nPOINTS {width * height}\nDATA {form}\n"
    ).encode()
    columns_of = [field.astype("<f4") for field in fields] + ([] if labels is None else [labels.astype("<u4")])
    if form == "ascii":
        lines = zip(*(column.ravel().tolist() for column in columns_of), strict=True)
        return header + "\n".join(" ".join(str(value) for value in line) for line in lines).encode()
    if form == "binary":
        return header + np.stack([column.ravel().view("<u4") for column in columns_of], axis=1).tobytes()
    raw = b"".join(column.tobytes() for column in columns_of)
    packed = b"".join(bytes([len(raw[i : i + 32]) - 1]) + raw[i : i + 32] for i in range(0, len(raw), 32))
    return header + struct.pack("<II", len(packed), len(raw)) + packed


@pytest.mark.parametrize("form", ["ascii", "binary", "binary_compressed"])
def test_an_organised_cloud_tells_its_own_lens(tmp_path: Path, form: str) -> None:
    depth_m = np.random.default_rng(1).uniform(1.0, 2.0, (48, 64))
    depth_m[3, 4] = math.nan
    (tmp_path / "a.pcd").write_bytes(pcd_of(depth_m, form))
    file = read_depth(tmp_path / "a.pcd")
    np.testing.assert_allclose(file.image.depth * file.image.unit_m, np.nan_to_num(depth_m), atol=0.0002)
    assert file.lens_px == pytest.approx((60, 60, 32, 24), abs=0.01)
    assert file.labels is None


@pytest.mark.parametrize("form", ["ascii", "binary", "binary_compressed"])
def test_the_labels_of_a_cloud_are_read(tmp_path: Path, form: str) -> None:
    depth_m = np.random.default_rng(1).uniform(1.0, 2.0, (48, 64))
    labels = np.arange(48 * 64).reshape(48, 64) % 45
    (tmp_path / "a.pcd").write_bytes(pcd_of(depth_m, form, labels))
    read = read_depth(tmp_path / "a.pcd").labels
    assert read is not None
    np.testing.assert_array_equal(read, labels)


def spoilt(name: str) -> bytes:
    """A cloud with one thing wrong."""
    good = pcd_of(np.full((48, 64), 2.0), "binary")
    wrong = {
        "cut short": good[:-5],
        "no header's end": b"FIELDS x y z\n",
        "no WIDTH": good.replace(b"WIDTH 64\n", b""),
        "huge": good.replace(b"WIDTH 64", b"WIDTH 99999999999"),
        "unorganised": good.replace(b"HEIGHT 48", b"HEIGHT 1"),
        "negative": good.replace(b"WIDTH 64", b"WIDTH -64"),
        "no z": good.replace(b"x y z", b"x y w"),
        "a strange type": good.replace(b"TYPE F F F", b"TYPE F F Q"),
        "a strange size": good.replace(b"SIZE 4 4 4", b"SIZE 4 4 3"),
        "a strange count": good.replace(b"WIDTH", b"COUNT 1 1 -1\nWIDTH"),
        "a strange form": good.replace(b"DATA binary", b"DATA zip"),
        "no camera": pcd_of(np.full((48, 64), 2.0), "ascii").replace(b"2.0", b"nan"),
        "letters": good.replace(b"DATA binary", b"DATA ascii"),
        "a compressed bomb": good.replace(b"DATA binary", b"DATA binary_compressed"),
        "not ascii": b"\xff\xfe" + good,
        "empty": b"",
    }
    return wrong[name]


@pytest.mark.parametrize(
    "name",
    [
        "cut short",
        "no header's end",
        "no WIDTH",
        "huge",
        "unorganised",
        "negative",
        "no z",
        "a strange type",
        "a strange size",
        "a strange count",
        "a strange form",
        "no camera",
        "letters",
        "a compressed bomb",
        "not ascii",
        "empty",
    ],
)
def test_a_spoilt_cloud_is_refused_in_one_line(tmp_path: Path, name: str) -> None:
    path = tmp_path / "a.pcd"
    path.write_bytes(spoilt(name))
    with pytest.raises(DepthFileError, match=r"a\.pcd") as refusal:
        read_depth(path)
    assert "\n" not in str(refusal.value)


@settings(deadline=None)
@given(st.binary(max_size=400), st.sampled_from([".png", ".npy", ".npy.gz", ".pcd", ".pcd.gz"]), st.booleans())
def test_no_bytes_crash_the_reader(
    tmp_path_factory: pytest.TempPathFactory, tail: bytes, ending: str, lead: bool
) -> None:
    path = tmp_path_factory.mktemp("hostile") / f"a{ending}"
    heads = {
        ".png": b"\x89PNG\r\n\x1a\n",
        ".npy": b"\x93NUMPY\x01\x00",
        ".pcd": pcd_of(np.full((2, 2), 1.0), "ascii")[:110],
    }
    path.write_bytes((heads.get(ending, b"\x1f\x8b\x08") if lead else b"") + tail)
    with contextlib.suppress(DepthFileError):
        read_depth(path)


def test_references_in_lzf_may_overlap_what_they_make() -> None:
    assert decompress_lzf(bytes([0, ord("a"), 7 << 5, 1, 0]), 11) == b"a" * 11


@given(st.binary(max_size=200), st.integers(0, 400))
def test_damaged_lzf_is_refused_by_the_errors_that_are_caught(packed: bytes, size: int) -> None:
    with contextlib.suppress(ValueError, IndexError):
        assert len(decompress_lzf(packed, size)) == size


@pytest.mark.parametrize(
    ("name", "data"),
    [("a.png", b"no picture"), ("a.npy", b""), ("a.pcd", b"FIELDS x y z\n"), ("a.txt", b""), ("a.npy.gz", b"\x1f\x8b")],
)
def test_a_file_that_is_no_depth_image_is_refused_by_name(tmp_path: Path, name: str, data: bytes) -> None:
    (tmp_path / name).write_bytes(data)
    with pytest.raises(DepthFileError, match=name):
        read_depth(tmp_path / name)


def test_a_missing_file_ends_with_one_line_and_exit_code_2(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert extraction.run(parse(str(tmp_path / "none.png"))) == 2
    assert capsys.readouterr().err.count("\n") == 1


def test_the_figures_of_a_box_are_printed_and_its_picture_is_drawn(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "box.png"
    Image.fromarray((box_depth_m() * 1000).astype(np.uint16)).save(path)
    assert extraction.run(parse(str(path), "--mount", "none", "--json", "--picture", str(tmp_path / "out"))) == 0
    result = json.loads(capsys.readouterr().out)
    box = result["files"][0]
    assert (box["points"], box["nodes"], box["clusters"]) == (19200, 4, 1)
    assert 0.4 < box["min_edge_m"] < box["max_edge_m"] < 0.7
    assert set(result["overall"]) == set(box)
    assert min(box[name] for name in ("learn_ms", "total_ms", "track_ms", "floor_ms")) > 0
    with Image.open(tmp_path / "out" / "box.png.png") as picture:
        assert picture.size == (3 * 640 + 8, 480)


def test_one_bad_file_does_not_lose_the_figures_of_the_others(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "bad.png").write_bytes(b"no picture")
    np.save(tmp_path / "good.npy", np.full((480, 640), 2.0, np.float32))
    assert extraction.run(parse(str(tmp_path / "bad.png"), str(tmp_path / "good.npy"), "--json")) == 2
    printed = capsys.readouterr()
    assert [row["file"] for row in json.loads(printed.out)["files"]] == ["good.npy"]
    assert printed.err.count("\n") == 1


def room_with_a_table(wall_m: float) -> tuple[DepthImage, Intrinsics]:
    """A table 0.5 m under the camera and up to 1.2 m before it, the floor 1.2 m under it, and a wall."""
    pitch = 0.3
    lens = Intrinsics(640, 480, 585.0, 585.0, 320.0, 240.0)
    _, slopes = lens.ray_slopes()
    fall = np.maximum(slopes * math.cos(pitch) + math.sin(pitch), 1e-3)
    ahead = math.cos(pitch) - slopes * math.sin(pitch)
    depth_m = np.minimum(1.2 / fall, wall_m / ahead)
    depth_m = np.where(0.5 / fall * ahead < 1.2, 0.5 / fall, depth_m)[:, None].repeat(640, axis=1)
    return DepthImage(0.0, (depth_m * 1000).astype(np.uint16), 0.001), lens


def test_a_table_is_not_taken_for_the_floor_that_is_seen_behind_it() -> None:
    mount = find_floor(*room_with_a_table(wall_m=6.0))
    assert mount is not None
    assert mount.matrix[2, 3] == pytest.approx(1.2, abs=0.03)


def test_a_table_before_a_wall_that_goes_on_below_it_is_no_floor() -> None:
    assert find_floor(*room_with_a_table(wall_m=2.0)) is None


@pytest.mark.skipif(not CLOUDS.is_dir(), reason="the labelled clouds (../shared/data/depth) are not here")
def test_the_labelled_objects_are_found_and_their_boundaries_drawn(capsys: pytest.CaptureFixture[str]) -> None:
    assert extraction.run(parse(*(str(path) for path in sorted(CLOUDS.glob("*.pcd"))), "--json")) == 0
    overall = json.loads(capsys.readouterr().out)["overall"]
    assert overall["object_recall"] >= 0.9
    assert overall["boundary_precision"] >= 0.8
    assert overall["boundary_recall"] >= 0.6


@pytest.mark.parametrize("learner", ["fast", "standard"])
def test_the_other_learners_outline_a_box_too(tmp_path: Path, capsys: pytest.CaptureFixture[str], learner: str) -> None:
    path = tmp_path / "box.png"
    Image.fromarray((box_depth_m() * 1000).astype(np.uint16)).save(path)
    assert extraction.run(parse(str(path), "--mount", "none", "--json", "--learner", learner)) == 0
    box = json.loads(capsys.readouterr().out)["files"][0]
    assert 4 <= box["nodes"] <= 60
    assert box["connections"] >= 3


@pytest.mark.parametrize(
    "text", ["1,2,3", "a,b,c,d", "1,2,3,-4", "nan,585,320,240", "inf,585,320,240", "1e-9,585,320,240"]
)
def test_intrinsics_that_are_not_four_positive_numbers_are_refused(text: str) -> None:
    with pytest.raises(SystemExit):
        parse("x.png", "--intrinsics", text)


@pytest.mark.parametrize(("width", "height"), [(640, 480), (320, 240), (1280, 720), (64, 16)])
@pytest.mark.parametrize("ending", [".png", ".npy"])
def test_a_camera_that_is_not_told_looks_through_the_middle_of_images_of_any_size(
    width: int, height: int, ending: str
) -> None:
    image = DepthImage(0.0, np.zeros((height, width), np.uint16), 0.001)
    lens = extraction.intrinsics_of(Path(f"a{ending}"), image, None)
    assert (lens.width, lens.height, lens.cx, lens.cy) == (width, height, width / 2, height / 2)
    if ending == ".png":
        assert lens.fx == lens.fy == pytest.approx(585 / 640 * width)


def test_the_floor_is_found_with_the_cameras_height_and_pitch() -> None:
    pitch, height_m = 0.3, 1.2
    lens = Intrinsics(640, 480, 585.0, 585.0, 320.0, 240.0)
    _, slopes = lens.ray_slopes()
    depth_m = height_m / np.maximum(slopes * math.cos(pitch) + math.sin(pitch), 1e-3)
    depth_m = np.where(depth_m < 6.0, depth_m, 0.0)[:, None].repeat(640, axis=1)
    image = DepthImage(0.0, (depth_m * 1000).astype(np.uint16), 0.001)
    mount = find_floor(image, lens)
    assert mount is not None
    np.testing.assert_allclose(mount.matrix[2], [0, -math.cos(pitch), -math.sin(pitch), height_m], atol=0.02)


@pytest.mark.skipif(not CLOUDS.is_dir(), reason="the labelled clouds (../shared/data/depth) are not here")
def test_the_recorded_compressed_clouds_are_read() -> None:
    file = read_depth(CLOUDS / "test0.pcd")
    assert file.image.depth.shape == (480, 640)
    assert file.lens_px == pytest.approx((525, 525, 320, 240), abs=5)


def test_both_floors_write_the_cloud_that_the_camera_model_gives() -> None:
    lens = Intrinsics.from_field_of_view(64, 48, math.radians(70), math.radians(50))
    depth = np.random.default_rng(1).integers(0, 9000, (48, 64)).astype(np.uint16)
    columns, rows = lens.ray_slopes()
    z_m = depth * 0.001
    expected = np.stack(np.broadcast_arrays(columns * z_m, rows[:, None] * z_m, z_m), axis=2)
    by_equation, tabled = np.zeros((48, 64, 3), np.float32), np.zeros((48, 64, 3), np.float32)

    back_project(depth, 0.001, lens.fx, lens.fy, lens.cx, lens.cy, by_equation)
    back_project_tabled(depth, 0.001, columns, rows, tabled)

    np.testing.assert_allclose(by_equation, expected, atol=1e-5)
    np.testing.assert_allclose(tabled, expected, atol=1e-5)


def test_a_file_that_claims_more_numbers_than_it_holds_is_refused_before_room_is_made(tmp_path: Path) -> None:
    header = b"{'descr': '<f8', 'fortran_order': False, 'shape': (1000000, 1000000), }"
    header += b" " * (117 - len(header)) + b"\n"
    (tmp_path / "huge.npy").write_bytes(b"\x93NUMPY\x01\x00" + len(header).to_bytes(2, "little") + header)
    with pytest.raises(DepthFileError, match="too short"):
        read_depth(tmp_path / "huge.npy")


def test_a_plane_over_the_camera_is_no_floor() -> None:
    lens = Intrinsics.from_field_of_view(320, 240, math.radians(70), math.radians(50))
    rows = lens.ray_slopes()[1][:, None]
    ceiling = np.where(rows < -0.05, 1.0 / np.maximum(-rows, 0.05), 0.0)  # one metre over a level camera
    depth = np.broadcast_to(np.round(ceiling * 1000), (240, 320)).clip(0, 20_000).astype(np.uint16)
    assert find_floor(DepthImage(0.0, depth, 0.001), lens) is None
