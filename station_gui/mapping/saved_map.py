"""A map in one file: what any SLAM method needs to go on from it.

Layout, little-endian: magic, version, counts of nodes, edges, keyframes and points, the step of the coordinates, a
zlib stream of the arrays in the order of `encode`, and the CRC-32 of all that. Version 1 has no pieces. Points are
whole steps, each the difference from the one before; a normal is its angle. Every size follows from the counts.
"""

from __future__ import annotations

import contextlib
import math
import os
import struct
import zlib
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from station_gui.mapping.slam2d.base import MappingError
from station_gui.mapping.slam2d.keyframes import Keyframe
from station_gui.mapping.slam2d.se2_arrays import compose_all

SUFFIX = ".labmap"
_MAGIC, _VERSION = b"LABMAP\r\n", 2
_FIRST_WITH_PIECES = 2  # older files hold one piece
_HEADER = struct.Struct("<8sI4Id")
_CHECKSUM = struct.Struct("<I")
_MAX_NODES, _MAX_EDGES, _MAX_KEYFRAMES, _MAX_POINTS = 200_000, 1_000_000, 200_000, 40_000_000
_MAX_FILE_BYTES = 512 * 1024 * 1024
_FINEST_STEP_M, _COARSEST_STEP_M = 1e-4, 0.01
_LAST_STEP = 32_767  # of a coordinate, either way
_FARTHEST_POINT_M = _LAST_STEP * _COARSEST_STEP_M  # no scanner of ours sees farther: such points are left out
_NORMAL_ANGLES = 65_535  # 0 stands for no normal
_FARTHEST_M = 1e4  # of any place from any other
_FARTHEST_SCANNER_M = 10.0  # from the middle of its robot
_LATEST_S = 1e11  # any clock's
_MAX_WRITTEN_KEYFRAMES = 20_000  # about 20 MB
_PLACE_M, _PLACE_RAD = 0.25, math.radians(30.0)  # keyframes nearer to each other show the same
_TRIANGLE = np.triu_indices(3)

FloatArray = NDArray[np.float64]


class MapFileError(MappingError):
    """A file that cannot be used as a map; one line that names it and says what to do."""


@dataclass(frozen=True, slots=True, eq=False)
class SavedMap:
    """A pose graph and the scans that hang on it, of no particular method.

    `nodes`: (N, 3), map frame; `pieces`: (N,), 0 for the map itself, others for what has not been joined to it: where
    those lie is not known. Edges: `ends` (E, 2), `measured` (E, 3) and `information` (E, 3, 3) in the frame of
    the first node, `robust` (E,) for closures, `length_m` (E,) the way that an edge's drift is worth.
    """

    nodes: FloatArray
    ends: NDArray[np.int32]
    measured: FloatArray
    information: FloatArray
    robust: NDArray[np.bool_]
    length_m: FloatArray
    keyframes: tuple[Keyframe, ...]
    pieces: NDArray[np.int32]

    def keyframe_nodes(self) -> NDArray[np.int32]:
        """(K,)"""
        return np.array([keyframe.node for keyframe in self.keyframes], np.int32)


def write_map(saved: SavedMap, path: Path) -> None:
    """Write all of it or nothing; an older file of this name gives way in one stroke. Raises `MapFileError`.

    Of a map of very many sessions the newest scans of each place are kept.
    """
    data = encode(thinned(saved, _MAX_WRITTEN_KEYFRAMES))
    part = path.with_name(f"{path.name}.{os.getpid()}.part")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with part.open("wb") as stream:  # with the rights that the user's files have
            stream.write(data)
            stream.flush()
            os.fsync(stream.fileno())
        part.replace(path)
    except OSError as error:
        with contextlib.suppress(OSError):
            part.unlink()
        raise MapFileError(f"{path}: cannot be written: {error.strerror}; choose another folder") from error


def thinned(saved: SavedMap, limit: int) -> SavedMap:
    """No more than `limit` keyframes: the older one of those that were made at one place goes first."""
    keyframes = saved.keyframes
    if len(keyframes) <= limit:
        return saved
    in_node = np.array([keyframe.in_node for keyframe in keyframes])
    poses = compose_all(saved.nodes[saved.keyframe_nodes()], in_node)
    place = np.floor(poses / (_PLACE_M, _PLACE_M, _PLACE_RAD)).astype(np.int64)
    _, of_place = np.unique(place, axis=0, return_inverse=True)
    newest_first = np.lexsort((-np.arange(len(keyframes)), of_place))
    begins = np.append(True, np.diff(of_place[newest_first]) > 0)
    rank = np.arange(len(keyframes)) - np.maximum.accumulate(np.where(begins, np.arange(len(keyframes)), 0))
    kept = np.sort(newest_first[np.argsort(rank, kind="stable")][:limit])
    return replace(saved, keyframes=tuple(keyframes[k] for k in kept))


def read_map(path: Path) -> SavedMap:
    """Raises `MapFileError` for anything but a whole map of this version."""
    try:
        if path.stat().st_size > _MAX_FILE_BYTES:
            raise MapFileError(f"{path}: is larger than any map; choose a file that the station saved")
        data = path.read_bytes()
    except OSError as error:
        raise MapFileError(f"{path}: cannot be read: {error.strerror}") from error
    try:
        return decode(data)
    except MapFileError as error:
        raise MapFileError(f"{path}: {error}") from error


def encode(saved: SavedMap) -> bytes:
    """Raises `MapFileError` for a map that is empty or larger than a file may hold."""
    keyframes = [_within_reach(keyframe) for keyframe in saved.keyframes]
    if not any(len(keyframe.points_m) for keyframe in keyframes):
        raise MapFileError("there is no map to save yet")
    points = np.concatenate([keyframe.points_m for keyframe in keyframes])
    normals = np.concatenate([keyframe.normals for keyframe in keyframes])
    counts = (len(saved.nodes), len(saved.ends), len(keyframes), len(points))
    if not _in_bounds(counts):
        raise MapFileError(f"a map of {counts[2]} scans and {counts[3]} points is more than a file may hold")
    step_m = max(_FINEST_STEP_M, float(np.abs(points).max(initial=0.0)) / _LAST_STEP)
    steps = np.round(points / step_m).astype(np.int16)
    arrays = (
        saved.nodes.astype("<f8"),
        saved.ends.astype("<i4"),
        saved.measured.astype("<f8"),
        saved.information[:, *_TRIANGLE].astype("<f8"),
        saved.robust.astype("u1"),
        saved.length_m.astype("<f8"),
        np.array([keyframe.stamp_s for keyframe in keyframes], "<f8"),
        saved.keyframe_nodes().astype("<i4"),
        np.array([keyframe.in_node for keyframe in keyframes], "<f8"),
        np.array([keyframe.scanner_m for keyframe in keyframes], "<f8"),
        np.array([len(keyframe.points_m) for keyframe in keyframes], "<i4"),
        np.diff(steps, axis=0, prepend=np.zeros((1, 2), np.int16)).astype("<i2"),
        _angles_of(normals).astype("<u2"),
        saved.pieces.astype("<i4"),
    )
    body = zlib.compress(b"".join(array.tobytes() for array in arrays), 6)
    data = _HEADER.pack(_MAGIC, _VERSION, *counts, step_m) + body
    return data + _CHECKSUM.pack(zlib.crc32(data))


def decode(data: bytes) -> SavedMap:
    """Raises `MapFileError`, whatever the bytes are."""
    if len(data) < _HEADER.size + _CHECKSUM.size or not data.startswith(_MAGIC):
        raise MapFileError("is not a saved map; choose a file that the station saved")
    _, version, nodes, edges, keyframes, points, step_m = _HEADER.unpack_from(data)
    if not 1 <= version <= _VERSION:
        raise MapFileError(f"is of version {version} and this program reads up to {_VERSION}: use a newer program")
    if zlib.crc32(data[: -_CHECKSUM.size]) != _CHECKSUM.unpack(data[-_CHECKSUM.size :])[0]:
        raise MapFileError("is damaged or cut short; use another copy of it")
    if not _in_bounds((nodes, edges, keyframes, points)) or not _FINEST_STEP_M <= step_m <= _COARSEST_STEP_M:
        raise MapFileError("its counts cannot be; use another copy of it")
    body = data[_HEADER.size : -_CHECKSUM.size]
    with_pieces = version >= _FIRST_WITH_PIECES
    saved = _Body(body, nodes, edges, keyframes, points, with_pieces=with_pieces).saved_map(step_m)
    _check(saved)
    return saved


class _Body:
    """The arrays, one after the other."""

    def __init__(
        self, packed: bytes, nodes: int, edges: int, keyframes: int, points: int, *, with_pieces: bool
    ) -> None:
        self._counts = (nodes, edges, keyframes, points)
        self._with_pieces = with_pieces
        size = (
            (28 if with_pieces else 24) * nodes
            + (8 + 24 + 48 + 1 + 8) * edges
            + (8 + 4 + 24 + 16 + 4) * keyframes
            + 6 * points
        )
        unpacker = zlib.decompressobj()
        try:
            self._data = unpacker.decompress(packed, size + 1)
        except zlib.error as error:
            raise MapFileError("is damaged; use another copy of it") from error
        if len(self._data) != size or not unpacker.eof:
            raise MapFileError("does not hold what its counts say; use another copy of it")
        self._at = 0

    def _take(self, kind: str, rows: int, columns: int = 1) -> NDArray[np.generic]:
        array = np.frombuffer(self._data, kind, rows * columns, self._at)
        self._at += array.nbytes
        return array.reshape(rows, columns) if columns > 1 else array

    def saved_map(self, step_m: float) -> SavedMap:
        nodes, edges, keyframes, points = self._counts
        poses = self._take("<f8", nodes, 3).astype(np.float64)
        ends = self._take("<i4", edges, 2).astype(np.int32)
        measured = self._take("<f8", edges, 3).astype(np.float64)
        information = _full(self._take("<f8", edges, 6).astype(np.float64))
        robust = self._take("u1", edges).astype(np.bool_)
        length_m = self._take("<f8", edges).astype(np.float64)
        stamps = self._take("<f8", keyframes).astype(np.float64)
        of_node = self._take("<i4", keyframes).astype(np.int32)
        in_node = self._take("<f8", keyframes, 3).astype(np.float64)
        scanner = self._take("<f8", keyframes, 2).astype(np.float64)
        sizes = self._take("<i4", keyframes).astype(np.int64)
        if len(sizes) and (sizes.min() < 0 or int(sizes.sum()) != points):
            raise MapFileError("its scans do not add up; use another copy of it")
        steps = np.cumsum(self._take("<i2", points, 2), axis=0, dtype=np.int16)
        points_m = (steps * step_m).astype(np.float32)
        normals = _normals_of(self._take("<u2", points).astype(np.int64))
        last = np.cumsum(sizes)
        made = tuple(
            Keyframe(
                float(stamps[k]), int(of_node[k]), in_node[k].copy(), points_m[last[k] - sizes[k] : last[k]],
                normals[last[k] - sizes[k] : last[k]], scanner[k].copy(),
            )
            for k in range(keyframes)
        )  # fmt: skip
        pieces = self._take("<i4", nodes).astype(np.int32) if self._with_pieces else np.zeros(nodes, np.int32)
        return SavedMap(poses, ends, measured, information, robust, length_m, made, pieces)


def _in_bounds(counts: tuple[int, int, int, int]) -> bool:
    nodes, edges, keyframes, points = counts
    few = nodes <= _MAX_NODES and edges <= _MAX_EDGES and keyframes <= _MAX_KEYFRAMES and points <= _MAX_POINTS
    return few and min(nodes, keyframes, points) > 0


def _check(saved: SavedMap) -> None:
    """Numbers that no map has would only be found out deep in the mathematics."""
    places = [keyframe.in_node for keyframe in saved.keyframes]
    scanners = np.array([keyframe.scanner_m for keyframe in saved.keyframes])
    within_m = ((saved.nodes, _FARTHEST_M), (saved.measured, _FARTHEST_M), (np.array(places), _FARTHEST_M))
    if not all(_is_within(array, limit_m) for array, limit_m in (*within_m, (scanners, _FARTHEST_SCANNER_M))):
        raise MapFileError("holds places that cannot be; use another copy of it")
    stamps = np.array([keyframe.stamp_s for keyframe in saved.keyframes])
    lengths = saved.length_m
    if not (_is_within(stamps, _LATEST_S) and _is_within(lengths, _FARTHEST_M) and (lengths >= 0).all()):
        raise MapFileError("holds times or lengths that cannot be; use another copy of it")
    of_node = saved.keyframe_nodes()
    if of_node.min() < 0 or of_node.max() >= len(saved.nodes) or (np.diff(of_node) < 0).any():
        raise MapFileError("its scans name nodes that are not there; use another copy of it")
    if saved.pieces.min() < 0 or saved.pieces.max() >= len(saved.nodes):
        raise MapFileError("its pieces have numbers that cannot be; use another copy of it")
    ends = saved.ends
    if len(ends) and (ends.min() < 0 or ends.max() >= len(saved.nodes) or (ends[:, 0] == ends[:, 1]).any()):
        raise MapFileError("its graph names nodes that are not there; use another copy of it")
    if not np.isfinite(saved.information).all() or (len(ends) and np.linalg.eigvalsh(saved.information).min() < 0):
        raise MapFileError("its graph holds weights that cannot be; use another copy of it")


def _within_reach(keyframe: Keyframe) -> Keyframe:
    near = (np.abs(keyframe.points_m) <= _FARTHEST_POINT_M).all(axis=1)
    if near.all():
        return keyframe
    return replace(keyframe, points_m=keyframe.points_m[near], normals=keyframe.normals[near])


def _is_within(array: FloatArray, limit: float) -> bool:
    return bool(np.isfinite(array).all()) and float(np.abs(array).max(initial=0.0)) <= limit


def _full(triangle: FloatArray) -> FloatArray:
    """(E, 3, 3) symmetric, of its upper triangle (E, 6)."""
    full = np.zeros((len(triangle), 3, 3))
    full[:, *_TRIANGLE] = triangle
    full[:, _TRIANGLE[1], _TRIANGLE[0]] = triangle
    return full


def _angles_of(normals: NDArray[np.float32]) -> NDArray[np.int64]:
    """(P,): 0 for no normal, else its angle as a whole number from 1 on."""
    angle = np.arctan2(normals[:, 1].astype(np.float64), normals[:, 0])
    turns = np.round(np.remainder(angle / math.tau, 1.0) * (_NORMAL_ANGLES - 1)).astype(np.int64)
    return np.where(normals.any(axis=1), turns + 1, 0)


def _normals_of(angles: NDArray[np.int64]) -> NDArray[np.float32]:
    radians = (angles - 1) * (math.tau / (_NORMAL_ANGLES - 1))
    normals = np.column_stack((np.cos(radians), np.sin(radians)))
    normals[angles == 0] = 0.0
    return normals.astype(np.float32)
