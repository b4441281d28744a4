"""Reads depth images: PNG (16 bit, mm), .npy(.gz) in metres, organised PCD."""

from __future__ import annotations

import gzip
import io
import struct
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from robot_app.drivers.base import DepthImage

PNG_UNIT_M = 0.001
FINE_UNIT_M = 0.00025  # the L515's


class DepthFileError(Exception):
    """A file that is no depth image; the text names it."""


@dataclass(frozen=True, slots=True)
class DepthFile:
    """`lens_px` is what the file itself tells of the camera (fx, fy, cx, cy), None where it tells nothing."""

    image: DepthImage
    lens_px: tuple[float, float, float, float] | None = None


def read_depth(path: Path) -> DepthFile:
    """Raises DepthFileError."""
    try:
        if path.suffix == ".png":
            return DepthFile(_read_png(path))
        if path.name.endswith((".npy", ".npy.gz")):
            return DepthFile(_read_npy(path))
        if path.name.endswith((".pcd", ".pcd.gz")):
            return _read_pcd(path)
    except (OSError, ValueError, EOFError, KeyError, IndexError, struct.error) as error:
        raise DepthFileError(f"{path}: {error}") from error
    raise DepthFileError(f"{path}: is neither .png, .npy, .npy.gz, .pcd nor .pcd.gz")


def _unpacked(path: Path) -> bytes:
    data = path.read_bytes()
    return gzip.decompress(data) if path.suffix == ".gz" else data


def _read_png(path: Path) -> DepthImage:
    with Image.open(path) as picture:
        depth = np.asarray(picture)
    if depth.ndim != 2 or depth.dtype == np.uint8:
        raise ValueError("is no 16 bit picture of one channel")
    return DepthImage(0.0, np.where(depth >= 65535, 0, depth).astype(np.uint16), PNG_UNIT_M)


def _read_npy(path: Path) -> DepthImage:
    depth_m = np.load(io.BytesIO(_unpacked(path)), allow_pickle=False)
    if depth_m.ndim != 2 or not np.issubdtype(depth_m.dtype, np.floating):
        raise ValueError("is no array (height, width) of metres")
    return _from_metres(depth_m)


def _from_metres(depth_m: NDArray[np.floating]) -> DepthImage:
    units = np.round(np.nan_to_num(depth_m, nan=0.0, posinf=0.0, neginf=0.0) / FINE_UNIT_M)
    return DepthImage(0.0, np.where((units < 0) | (units > 65534), 0, units).astype(np.uint16), FINE_UNIT_M)


def _read_pcd(path: Path) -> DepthFile:
    """An organised cloud in the camera's frame; its lens is fitted to the points' own slopes."""
    header, body = _split_header(_unpacked(path))
    width, height = int(header["WIDTH"][0]), int(header["HEIGHT"][0])
    if height < 2:
        raise ValueError("the cloud is not organised: HEIGHT is 1")
    fields = _fields(header, body, width * height)
    x, y, z = (fields[name].astype(np.float64).reshape(height, width) for name in ("x", "y", "z"))
    known = np.isfinite(z) & (z > 0)
    if not known.any():
        raise ValueError("the cloud has no point with a depth")
    columns, rows = np.meshgrid(np.arange(width) + 0.5, np.arange(height) + 0.5)
    fx, cx = np.polyfit(x[known] / z[known], columns[known], 1)
    fy, cy = np.polyfit(y[known] / z[known], rows[known], 1)
    return DepthFile(_from_metres(np.where(known, z, 0.0)), (float(fx), float(fy), float(cx), float(cy)))


def _split_header(data: bytes) -> tuple[dict[str, list[str]], bytes]:
    header: dict[str, list[str]] = {}
    start = 0
    while "DATA" not in header:
        end = data.index(b"\n", start)
        words = data[start:end].decode("ascii").split()
        start = end + 1
        if words and not words[0].startswith("#"):
            header[words[0]] = words[1:]
    return header, data[start:]


def _fields(header: dict[str, list[str]], body: bytes, points: int) -> dict[str, NDArray[np.generic]]:
    kinds = {"F": "f", "I": "i", "U": "u"}
    counts = header.get("COUNT", ["1"] * len(header["FIELDS"]))
    types = [
        (name, f"<{kinds[kind]}{size}", int(count))
        for name, kind, size, count in zip(header["FIELDS"], header["TYPE"], header["SIZE"], counts, strict=True)
    ]
    form = header["DATA"][0]
    if form == "ascii":
        table = np.loadtxt(io.BytesIO(body), ndmin=2)[:points]
        return {name: table[:, i] for i, (name, _, _) in enumerate(types)}
    if form == "binary":
        rows = np.frombuffer(body, np.dtype([(n, t) if c == 1 else (n, t, c) for n, t, c in types]), points)
        return {name: rows[name] for name, _, _ in types}
    if form != "binary_compressed":
        raise ValueError(f"DATA {form} is not known")
    packed, unpacked = struct.unpack_from("<II", body)
    flat = decompress_lzf(body[8 : 8 + packed], unpacked)
    fields, start = {}, 0
    for name, kind, count in types:
        fields[name] = np.frombuffer(flat, kind, points * count, start)
        start += points * count * np.dtype(kind).itemsize
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
