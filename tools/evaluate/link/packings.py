"""How many bytes an observation takes in packings that anyone would try first."""

from __future__ import annotations

import bz2
import lzma
import struct
import zlib
from collections.abc import Callable

import numpy as np
import zstandard

from shared.messages import Observation
from shared.protocol import ascii as ascii_profile
from shared.protocol.codec import encode

PAPER_LORA_BYTES = 471  # paper 1: what one refresh took over LoRa
PAPER_WIFI_BYTES = 932  # and over Wi-Fi, as text


def packed(observation: Observation) -> bytes:
    """Plain numbers in a row: time, pose, speeds, ranges in mm, nodes in mm, edges."""
    pose = observation.odom_from_robot
    head = struct.pack(
        "<IIfffffHHH", observation.sequence, round(observation.stamp_s * 1e3) & 0xFFFFFFFF,
        pose.x_m, pose.y_m, pose.theta_rad, observation.speed_mps, observation.yaw_rate_radps,
        len(observation.ranges_m), len(observation.objects.nodes_m), len(observation.objects.edges),
    )  # fmt: skip
    return head + b"".join(column.tobytes() for column in _columns(observation))


def _columns(observation: Observation) -> list[np.ndarray[tuple[int, ...], np.dtype[np.generic]]]:
    millimetres = np.round(1e3 * np.nan_to_num(observation.ranges_m, nan=0.0))
    nodes = np.round(1e3 * observation.objects.nodes_m)
    return [millimetres.astype("<u2"), np.clip(nodes, -32_768, 32_767).astype("<i2"), observation.objects.edges]


def cbor(observation: Observation) -> bytes:
    """RFC 8949: an array of the same values, whole numbers in their shortest form."""
    pose = observation.odom_from_robot
    ranges, nodes, edges = (column.ravel().tolist() for column in _columns(observation))
    floats = (pose.x_m, pose.y_m, pose.theta_rad, observation.speed_mps, observation.yaw_rate_radps)
    parts = [_head(4, 10), _integer(observation.sequence), _integer(round(observation.stamp_s * 1e3))]
    parts += [b"\xfa" + struct.pack(">f", value) for value in floats]
    parts += [_head(4, len(row)) + b"".join(map(_integer, row)) for row in (ranges, nodes, edges)]
    return b"".join(parts)


def _integer(value: int) -> bytes:
    return _head(0, value) if value >= 0 else _head(1, -1 - value)


def _head(major: int, value: int) -> bytes:
    if value < 24:
        return bytes((major << 5 | value,))
    for code, size in ((24, 1), (25, 2), (26, 4)):
        if value < 1 << 8 * size:
            return bytes((major << 5 | code,)) + value.to_bytes(size, "big")
    return bytes((major << 5 | 27,)) + value.to_bytes(8, "big")


PACKINGS: dict[str, Callable[[Observation], int]] = {
    "ascii": lambda o: len(ascii_profile.encode(o)),
    "full": lambda o: len(encode(o)),
    "struct": lambda o: len(packed(o)),
    "zlib": lambda o: len(zlib.compress(packed(o), 9)),
    "bz2": lambda o: len(bz2.compress(packed(o))),
    "lzma": lambda o: len(lzma.compress(packed(o), format=lzma.FORMAT_RAW, filters=[{"id": lzma.FILTER_LZMA2}])),
    "zstd": lambda o: len(zstandard.ZstdCompressor(level=19).compress(packed(o))),
    "cbor": lambda o: len(cbor(o)),
}
