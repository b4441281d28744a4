from __future__ import annotations

import os
import stat
import struct
import zlib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from station_gui.mapping.saved_map import MapFileError, SavedMap, decode, encode, read_map, thinned, write_map
from station_gui.mapping.slam2d.keyframes import Keyframe

_HEADER_BYTES = 36


def _keyframe(node: int, seed: int, points: int = 40) -> Keyframe:
    rng = np.random.default_rng(seed)
    angle = rng.uniform(-np.pi, np.pi, points)
    normals = np.column_stack((np.cos(angle), np.sin(angle)))
    normals[::5] = 0.0
    hits = rng.uniform(-4.0, 4.0, (points, 2))
    return Keyframe(
        0.1 * seed, node, rng.normal(size=3), hits.astype(np.float32), normals.astype(np.float32), rng.normal(size=2)
    )


@pytest.fixture
def saved() -> SavedMap:
    """Three nodes in a row, a closure, five scans, one of them empty."""
    rng = np.random.default_rng(0)
    ends = np.array([(0, 1), (1, 2), (0, 2)], np.int32)
    return SavedMap(
        nodes=rng.normal(size=(3, 3)),
        ends=ends,
        measured=rng.normal(size=(3, 3)),
        information=np.tile(np.diag((1e4, 2e4, 3e5)), (3, 1, 1)),
        robust=np.array([False, False, True]),
        length_m=np.array([1.0, 1.1, 0.5]),
        keyframes=(_keyframe(0, 1), _keyframe(0, 2), _keyframe(1, 3), _keyframe(1, 4, points=0), _keyframe(2, 5)),
        pieces=np.array([0, 0, 1], np.int32),
    )


def _with_checksum(data: bytes) -> bytes:
    return data + struct.pack("<I", zlib.crc32(data))


def _packed(data: bytes, body: bytes) -> bytes:
    return _with_checksum(data[:_HEADER_BYTES] + zlib.compress(body))


def _body(data: bytes) -> bytearray:
    return bytearray(zlib.decompress(data[_HEADER_BYTES:-4]))


def test_a_map_comes_back_as_it_was_saved(saved: SavedMap, tmp_path: Path) -> None:
    path = tmp_path / "lab.labmap"
    write_map(saved, path)
    read = read_map(path)

    for name in ("nodes", "ends", "measured", "information", "robust", "length_m", "pieces"):
        np.testing.assert_array_equal(getattr(read, name), getattr(saved, name))
    for before, after in zip(saved.keyframes, read.keyframes, strict=True):
        assert (after.stamp_s, after.node) == (before.stamp_s, before.node)
        np.testing.assert_array_equal(after.in_node, before.in_node)
        np.testing.assert_array_equal(after.scanner_m, before.scanner_m)
        np.testing.assert_allclose(after.points_m, before.points_m, atol=1e-4)
        np.testing.assert_allclose(after.normals, before.normals, atol=1e-4)


def test_saving_what_was_read_changes_nothing_more(saved: SavedMap) -> None:
    once = decode(encode(saved))
    twice = decode(encode(once))
    for a, b in zip(once.keyframes, twice.keyframes, strict=True):
        np.testing.assert_allclose(a.points_m, b.points_m, atol=1e-6)


def test_far_hits_are_kept_in_coarser_steps(saved: SavedMap) -> None:
    far = replace(saved.keyframes[0], points_m=np.array([[49.0, -49.0], [0.5, 0.25]], np.float32))
    far = replace(far, normals=np.zeros((2, 2), np.float32))
    read = decode(encode(replace(saved, keyframes=(far,))))
    np.testing.assert_allclose(read.keyframes[0].points_m, far.points_m, atol=1e-3)


def test_a_point_takes_few_bytes(saved: SavedMap) -> None:
    many = tuple(_keyframe(0, k, points=200) for k in range(50))
    assert len(encode(replace(saved, keyframes=many))) < 7 * 200 * 50


def test_an_empty_map_is_not_saved(saved: SavedMap) -> None:
    with pytest.raises(MapFileError, match="no map to save yet"):
        encode(replace(saved, keyframes=()))


def test_any_cut_file_is_refused(saved: SavedMap) -> None:
    data = encode(saved)
    for length in range(0, len(data), 7):
        with pytest.raises(MapFileError):
            decode(data[:length])


def test_any_changed_byte_is_refused(saved: SavedMap) -> None:
    data = encode(saved)
    for at in range(0, len(data), 5):
        with pytest.raises(MapFileError):
            decode(data[:at] + bytes([data[at] ^ 0x40]) + data[at + 1 :])


def test_foreign_bytes_are_refused() -> None:
    rng = np.random.default_rng(1)
    for length in (0, 3, 36, 40, 500):
        with pytest.raises(MapFileError, match="is not a saved map"):
            decode(rng.bytes(length))


def test_counts_that_promise_too_much_take_no_memory(saved: SavedMap) -> None:
    data = encode(saved)
    for at in range(12, 28, 4):
        for count in (0xFFFFFFFF, 39_000_000, 100_000):
            forged = _with_checksum(data[:at] + struct.pack("<I", count) + data[at + 4 : -4])
            with pytest.raises(MapFileError):
                decode(forged)


def test_a_body_that_unpacks_to_more_than_its_counts_is_refused(saved: SavedMap) -> None:
    data = encode(saved)
    with pytest.raises(MapFileError, match="does not hold what its counts say"):
        decode(_packed(data, bytes(_body(data)) + bytes(10_000_000)))


@pytest.mark.parametrize(
    ("at", "value", "told"),
    [
        (0, struct.pack("<d", float("nan")), "places that cannot be"),
        (8, struct.pack("<d", 1e9), "places that cannot be"),
        (72, struct.pack("<i", 3), "graph names nodes"),
        (72, struct.pack("<i", -1), "graph names nodes"),
        (72, struct.pack("<i", 1), "graph names nodes"),
        (168, struct.pack("<d", -1e4), "weights that cannot be"),
        (168, struct.pack("<d", float("inf")), "weights that cannot be"),
        (315, struct.pack("<d", -1.0), "times or lengths"),
        (339, struct.pack("<d", float("nan")), "times or lengths"),
        (379, struct.pack("<i", 3), "scans name nodes"),
        (379, struct.pack("<i", 2), "scans name nodes"),
        (599, struct.pack("<i", -40), "do not add up"),
        (599, struct.pack("<i", 41), "do not add up"),
        (-4, struct.pack("<i", -1), "pieces"),
        (-4, struct.pack("<i", 3), "pieces"),
    ],
)
def test_numbers_that_no_map_has_are_refused(saved: SavedMap, at: int, value: bytes, told: str) -> None:
    data = encode(saved)
    body = _body(data)
    at %= len(body)
    body[at : at + len(value)] = value
    with pytest.raises(MapFileError, match=told):
        decode(_packed(data, bytes(body)))


def test_a_later_version_says_so(saved: SavedMap) -> None:
    data = encode(saved)
    later = _with_checksum(data[:8] + struct.pack("<I", 3) + data[12:-4])
    with pytest.raises(MapFileError, match="version 3 and this program reads up to 2"):
        decode(later)


def test_a_map_of_the_first_version_is_of_one_piece(saved: SavedMap) -> None:
    data = encode(saved)
    first = data[:8] + struct.pack("<I", 1) + data[12:_HEADER_BYTES]
    read = decode(_packed(first, bytes(_body(data)[: -4 * len(saved.nodes)])))
    assert read.pieces.tolist() == [0, 0, 0]
    np.testing.assert_array_equal(read.nodes, saved.nodes)


def test_errors_name_the_file(saved: SavedMap, tmp_path: Path) -> None:
    path = tmp_path / "photo.labmap"
    path.write_bytes(b"no map at all, but long enough to be looked into by somebody")
    with pytest.raises(MapFileError, match=r"photo\.labmap: is not a saved map"):
        read_map(path)
    with pytest.raises(MapFileError, match="cannot be read"):
        read_map(tmp_path / "none.labmap")
    with pytest.raises(MapFileError, match="cannot be written"):
        write_map(saved, path / "below.labmap")


def test_a_map_that_cannot_be_saved_leaves_the_older_file(saved: SavedMap, tmp_path: Path) -> None:
    path = tmp_path / "lab.labmap"
    write_map(saved, path)
    before = path.read_bytes()
    with pytest.raises(MapFileError):
        write_map(replace(saved, keyframes=()), path)
    assert path.read_bytes() == before
    assert [entry.name for entry in tmp_path.iterdir()] == ["lab.labmap"]


def test_of_many_scans_at_one_place_the_oldest_go_first(saved: SavedMap) -> None:
    def at(x_m: float, stamp_s: float) -> Keyframe:
        return replace(saved.keyframes[0], in_node=np.array([x_m, 0.1, 0.1]), stamp_s=stamp_s)

    crowd = [at(0.05, k) for k in range(10)] + [at(3.0, 10.0), at(0.06, 11.0), at(7.0, 12.0)]
    many = replace(saved, nodes=np.zeros((3, 3)), keyframes=tuple(crowd))
    assert [keyframe.stamp_s for keyframe in thinned(many, 5).keyframes] == [8.0, 9.0, 10.0, 11.0, 12.0]
    assert thinned(many, 13) is many


def test_points_farther_than_any_scanner_sees_are_left_out(saved: SavedMap) -> None:
    far = replace(saved.keyframes[0], points_m=np.array([[400.0, 1.0], [0.5, 0.25], [1.0, -1e30]], np.float32))
    far = replace(far, normals=np.zeros((3, 2), np.float32))
    read = decode(encode(replace(saved, keyframes=(far, *saved.keyframes[1:]))))

    np.testing.assert_allclose(read.keyframes[0].points_m, [[0.5, 0.25]], atol=1e-4)
    np.testing.assert_allclose(read.keyframes[1].points_m, saved.keyframes[1].points_m, atol=1e-4)


def test_a_map_without_a_point_is_none(saved: SavedMap) -> None:
    empty = tuple(replace(k, points_m=k.points_m[:0], normals=k.normals[:0]) for k in saved.keyframes)
    with pytest.raises(MapFileError, match="no map to save yet"):
        encode(replace(saved, keyframes=empty))


@pytest.mark.parametrize("stamp_s", [1e300, -1e300, float("nan")])
def test_times_that_no_clock_shows_are_refused(saved: SavedMap, stamp_s: float) -> None:
    odd = (replace(saved.keyframes[0], stamp_s=stamp_s), *saved.keyframes[1:])
    with pytest.raises(MapFileError, match="times or lengths that cannot be"):
        decode(encode(replace(saved, keyframes=odd)))


def test_a_scanner_that_is_not_on_its_robot_is_refused(saved: SavedMap) -> None:
    odd = (replace(saved.keyframes[0], scanner_m=np.array([90.0, 0.0])), *saved.keyframes[1:])
    with pytest.raises(MapFileError, match="places that cannot be"):
        decode(encode(replace(saved, keyframes=odd)))


@pytest.mark.skipif(os.name != "posix", reason="rights of files as POSIX has them")
def test_a_saved_map_has_the_rights_that_the_users_files_have(saved: SavedMap, tmp_path: Path) -> None:
    before = os.umask(0o027)
    try:
        write_map(saved, tmp_path / "lab.labmap")
    finally:
        os.umask(before)
    assert stat.S_IMODE((tmp_path / "lab.labmap").stat().st_mode) == 0o640
    assert [file.name for file in tmp_path.iterdir()] == ["lab.labmap"]
