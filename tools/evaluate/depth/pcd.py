"""Reads organised point clouds in PCD: ascii, binary and binary_compressed."""

from __future__ import annotations

import io
import struct
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

_KINDS = {"F": "f", "I": "i", "U": "u"}
_SIZES = {"F": ("4", "8"), "I": ("1", "2", "4", "8"), "U": ("1", "2", "4", "8")}
_MAX_POINTS = 1 << 24  # bounds what a hostile header may ask for
_MAX_VALUES_PER_POINT = 64


@dataclass(frozen=True, slots=True, eq=False)
class OrganisedCloud:
    """`points_m`: (H, W, 3) camera frame, NaN where nothing was measured. `labels`: (H, W), None without that field."""

    points_m: NDArray[np.float64]
    labels: NDArray[np.int32] | None


def parse_pcd(data: bytes) -> OrganisedCloud:
    """Raises ValueError, KeyError, IndexError or struct.error on anything that is no organised cloud."""
    header, body = _split_header(data)
    width, height = int(header["WIDTH"][0]), int(header["HEIGHT"][0])
    if height < 2 or width < 2:
        raise ValueError(f"the cloud is not organised: {width} x {height}")
    if width * height > _MAX_POINTS:
        raise ValueError(f"the cloud has {width} x {height} points, more than {_MAX_POINTS}")
    fields = _fields(header, body, width * height)
    points_m = np.stack([fields[name].astype(np.float64).reshape(height, width) for name in "xyz"], axis=-1)
    points_m[~(np.isfinite(points_m).all(axis=-1) & (points_m[..., 2] > 0))] = np.nan
    labels = None
    if "label" in fields:
        values = np.nan_to_num(fields["label"].astype(np.float64), nan=0.0)
        labels = np.clip(values, 0, np.iinfo(np.int32).max).astype(np.int32).reshape(height, width)
    return OrganisedCloud(points_m, labels)


def _split_header(data: bytes) -> tuple[dict[str, list[str]], bytes]:
    header: dict[str, list[str]] = {}
    start = 0
    while "DATA" not in header:
        end = data.find(b"\n", start)
        if end < 0:
            raise ValueError("the header does not end with a DATA line")
        words = data[start:end].decode("ascii").split()
        start = end + 1
        if words and not words[0].startswith("#"):
            header[words[0]] = words[1:]
    for name in ("FIELDS", "SIZE", "TYPE", "WIDTH", "HEIGHT", "DATA"):
        if not header.get(name):
            raise ValueError(f"the header has no {name}")
    return header, data[start:]


def _fields(header: dict[str, list[str]], body: bytes, points: int) -> dict[str, NDArray[np.generic]]:
    """Each field's values, (points,) or (points, count)."""
    types = _types(header)
    form = header["DATA"][0]
    if form == "ascii":
        return _ascii_fields(types, body, points)
    if form == "binary":
        rows = np.frombuffer(body, np.dtype([(n, t) if c == 1 else (n, t, c) for n, t, c in types]), points)
        return {name: rows[name] for name, _, _ in types}
    if form != "binary_compressed":
        raise ValueError(f"DATA {form} is not known")
    packed, unpacked = struct.unpack_from("<II", body)
    if unpacked != points * sum(np.dtype(kind).itemsize * count for _, kind, count in types):
        raise ValueError(f"the compressed cloud of {points} points claims {unpacked} bytes")
    flat = decompress_lzf(body[8 : 8 + packed], unpacked)
    fields, start = {}, 0
    for name, kind, count in types:
        fields[name] = np.frombuffer(flat, kind, points * count, start)
        start += points * count * np.dtype(kind).itemsize
    return fields


def _types(header: dict[str, list[str]]) -> list[tuple[str, str, int]]:
    """Name, numpy type and count of each field."""
    counts = [int(word) for word in header.get("COUNT", ["1"] * len(header["FIELDS"]))]
    for name in "xyz":
        if name not in header["FIELDS"]:
            raise ValueError(f"the cloud has no field {name}")
    if min(counts) < 1 or sum(counts) > _MAX_VALUES_PER_POINT:
        raise ValueError(f"COUNT {counts} is not sensible")
    types = []
    for name, kind, size, count in zip(header["FIELDS"], header["TYPE"], header["SIZE"], counts, strict=True):
        if kind not in _KINDS or size not in _SIZES[kind]:
            raise ValueError(f"field {name} has the unknown type {kind}{size}")
        if name in ("x", "y", "z", "label") and count != 1:
            raise ValueError(f"field {name} has {count} values")
        types.append((name, f"<{_KINDS[kind]}{size}", count))
    return types


def _ascii_fields(types: list[tuple[str, str, int]], body: bytes, points: int) -> dict[str, NDArray[np.generic]]:
    table = np.loadtxt(io.BytesIO(body), ndmin=2, max_rows=points) if body.strip() else np.zeros((0, 0))
    width = sum(count for _, _, count in types)
    if table.shape != (points, width):
        raise ValueError(f"the cloud has {table.shape[0]} lines of {table.shape[1]} values, not {points} of {width}")
    fields: dict[str, NDArray[np.generic]] = {}
    start = 0
    for name, _, count in types:
        fields[name] = table[:, start] if count == 1 else table[:, start : start + count]
        start += count
    return fields


def decompress_lzf(packed: bytes, size: int) -> bytes:
    """LibLZF's format: literal runs and references up to 8 KiB back. Raises ValueError on anything else."""
    out = bytearray()
    at = 0
    while at < len(packed):
        control = packed[at]
        at += 1
        if control < 32:
            out += packed[at : at + control + 1]
            at += control + 1
            continue
        length = control >> 5
        if length == 7:
            length += packed[at]
            at += 1
        start = len(out) - ((control & 31) << 8) - packed[at] - 1
        at += 1
        if start < 0 or len(out) > size:
            raise ValueError("the compressed cloud is damaged")
        length += 2
        chunk = bytes(out[start : start + length])
        while len(chunk) < length:  # it may overlap what it makes
            chunk += chunk[: length - len(chunk)]
        out += chunk
    if len(out) != size:
        raise ValueError(f"the compressed cloud has {len(out)} bytes and not {size}")
    return bytes(out)
