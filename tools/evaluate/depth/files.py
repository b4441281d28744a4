"""Reads depth images: PNG (16 bit, mm), .npy(.gz) in metres, organised PCD (ascii, binary, binary_compressed)."""

from __future__ import annotations

import io
import math
import struct
import warnings
import zlib
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from robot_app.drivers.base import DepthImage
from tools.evaluate.depth.pcd import OrganisedCloud, parse_pcd

PNG_UNIT_M = 0.001
FINE_UNIT_M = 0.00025  # the L515's
_MAX_BYTES = 1 << 28  # of an unpacked file
_NO_DEPTH_PNG = 65535
_MOST_UNITS = 65534
_TOO_FAR_M = 1000.0

_FOREIGN = (
    OSError,
    ValueError,
    EOFError,
    KeyError,
    IndexError,
    TypeError,
    OverflowError,
    SyntaxError,
    struct.error,
    zlib.error,
    Image.DecompressionBombError,
    Image.DecompressionBombWarning,
    UserWarning,
)


class DepthFileError(Exception):
    """A file that is no depth image; the text names it, in one line."""


@dataclass(frozen=True, slots=True, eq=False)
class DepthFile:
    """`lens_px` is what the file itself tells of the camera (fx, fy, cx, cy), None where it tells nothing.

    `labels`: (H, W), those of `labels`; None where the file has none.
    """

    image: DepthImage
    lens_px: tuple[float, float, float, float] | None = None
    labels: NDArray[np.int32] | None = None


def read_depth(path: Path) -> DepthFile:
    """Raises DepthFileError."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error", Image.DecompressionBombWarning)
            warnings.simplefilter("error", UserWarning)  # what numpy says of lines that hold nothing
            return _read(path)
    except _FOREIGN as error:
        reason = " ".join(str(error).split()) or type(error).__name__
        raise DepthFileError(f"{path}: {reason}") from error


def _read(path: Path) -> DepthFile:
    name = path.name.lower()
    if name.endswith(".png"):
        return DepthFile(_read_png(path))
    if name.endswith((".npy", ".npy.gz")):
        return DepthFile(_read_npy(path))
    if name.endswith((".pcd", ".pcd.gz")):
        return _from_cloud(parse_pcd(_unpacked(path)))
    raise ValueError("is neither .png, .npy, .npy.gz, .pcd nor .pcd.gz")


def _unpacked(path: Path) -> bytes:
    data = path.read_bytes()
    if path.suffix.lower() != ".gz":
        return data
    reader = zlib.decompressobj(16 + zlib.MAX_WBITS)
    unpacked = reader.decompress(data, _MAX_BYTES)
    if not reader.eof:
        raise ValueError(f"is cut short, or holds more than {_MAX_BYTES} bytes")
    return unpacked


def _read_png(path: Path) -> DepthImage:
    with Image.open(path) as picture:
        if picture.format != "PNG" or not picture.mode.startswith("I"):
            raise ValueError("is no 16 bit PNG of one channel")
        depth = np.asarray(picture)
    return DepthImage(0.0, np.where(depth >= _NO_DEPTH_PNG, 0, depth).astype(np.uint16), PNG_UNIT_M)


def _read_npy(path: Path) -> DepthImage:
    content = io.BytesIO(_unpacked(path))
    _check_size(content)
    depth_m = np.load(content, allow_pickle=False)
    if depth_m.ndim != 2 or not np.issubdtype(depth_m.dtype, np.floating):
        raise ValueError("is no array (height, width) of metres")
    return _from_metres(depth_m)


def _check_size(content: io.BytesIO) -> None:
    """Raises ValueError where the header asks for more than is there, before anything is made for it."""
    version = np.lib.format.read_magic(content)
    read_header = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
    shape, _, dtype = read_header(content)
    if math.prod(shape) * dtype.itemsize > len(content.getvalue()):
        raise ValueError(f"says that it holds {shape} numbers, and is too short for them")
    content.seek(0)


def _from_metres(depth_m: NDArray[np.floating]) -> DepthImage:
    """Raises ValueError where all that was measured is too far to be in metres."""
    known_m = np.nan_to_num(depth_m, nan=0.0, posinf=0.0, neginf=0.0).astype(np.float64)
    units = np.round(np.clip(known_m, 0.0, _TOO_FAR_M) / FINE_UNIT_M)
    depth = np.where(units > _MOST_UNITS, 0, units).astype(np.uint16)
    if units.any() and not depth.any():
        raise ValueError(f"holds no depth of up to {_MOST_UNITS * FINE_UNIT_M:.0f} m: is it in metres?")
    return DepthImage(0.0, depth, FINE_UNIT_M)


def _from_cloud(cloud: OrganisedCloud) -> DepthFile:
    """The lens is fitted to the points' own slopes."""
    x, y, z = np.moveaxis(cloud.points_m, 2, 0)
    known = np.isfinite(z)
    if not known.any():
        raise ValueError("the cloud has no point with a depth")
    height, width = z.shape
    columns, rows = np.meshgrid(np.arange(width) + 0.5, np.arange(height) + 0.5)
    fx, cx = _line(x[known] / z[known], columns[known])
    fy, cy = _line(y[known] / z[known], rows[known])
    return DepthFile(_from_metres(np.where(known, z, 0.0)), (fx, fy, cx, cy), cloud.labels)


def _line(slopes: NDArray[np.float64], pixels: NDArray[np.float64]) -> tuple[float, float]:
    """Focal length and centre of one axis, px."""
    spread = slopes - slopes.mean()
    if float(spread @ spread) < 1e-9:
        raise ValueError("the cloud is a line: its lens cannot be told")
    focal = float(spread @ pixels / (spread @ spread))
    if not 1.0 < focal < 1e6:
        raise ValueError("the points are not those of a camera: its lens cannot be told")
    return focal, float(pixels.mean() - focal * slopes.mean())
