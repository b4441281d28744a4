"""The sensors' inner loops: beams of a sweep, pixels of a depth image."""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

_F32 = NDArray[np.float32]
_F64 = NDArray[np.float64]


@njit(nogil=True, cache=True)
def beam_directions(angles: _F64, late_s: _F64, yaw_rate: float, rotation: _F64, directions: _F64) -> None:
    """Fill `directions` (B, 3): beams at `angles` (B,) of a scanner that was `rotation` (9,) `late_s` (B,) ago."""
    for i in range(angles.shape[0]):
        c = math.cos(angles[i] + yaw_rate * late_s[i])
        s = math.sin(angles[i] + yaw_rate * late_s[i])
        for axis in range(3):
            directions[i, axis] = c * rotation[3 * axis] + s * rotation[3 * axis + 1]


@njit(nogil=True, cache=True)
def echoes(
    directions: _F64,
    normals: _F64,
    hit_m: _F64,
    geom: NDArray[np.int32],
    reflectivity_of_geom: _F64,
    nothing_m: float,
    range_m: _F64,
    signal: _F64,
) -> None:
    """Range (B,) and signal (B,), reflectivity times the cosine of the incidence; `nothing_m` and 0 for a miss."""
    for i in range(geom.shape[0]):
        if geom[i] < 0:
            range_m[i] = nothing_m
            signal[i] = 0.0
            continue
        cosine = 0.0
        for axis in range(3):
            cosine += directions[i, axis] * normals[i, axis]
        range_m[i] = hit_m[i]
        signal[i] = reflectivity_of_geom[geom[i]] * abs(cosine)


@njit(nogil=True, cache=True)
def any_pair(pairs: NDArray[np.int32], kind: NDArray[np.int64], wanted: int) -> bool:
    """Whether the kinds of any of the `pairs` (N, 2) add up to `wanted`."""
    found = False
    for i in range(pairs.shape[0]):
        found |= kind[pairs[i, 0]] + kind[pairs[i, 1]] == wanted
    return found


@njit(nogil=True, cache=True)
def _mixed(value: np.uint64) -> np.uint64:
    """A hash of 64 bits (the finaliser of SplitMix64)."""
    value = (value ^ (value >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    value = (value ^ (value >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return value ^ (value >> np.uint64(31))


@njit(nogil=True, cache=True)
def inverse_depth(buffer: _F32, near_m: float, far_m: float, inverse: _F32) -> None:
    """Inverse distances along the axis from a reversed, zero-to-one depth buffer whose first row is the lowest.

    `buffer`, `inverse`: (H, W); 0 where nothing was hit before `far_m`.
    """
    height, width = buffer.shape
    factor = (far_m - near_m) / (far_m * near_m)
    offset = 1.0 / far_m
    for row in range(height):
        source = height - 1 - row
        for column in range(width):
            value = buffer[source, column]
            inverse[row, column] = np.float32(value * factor + offset) if value > 0.0 else np.float32(0.0)


@njit(nogil=True, cache=True)
def noisy_depth(
    inverse: _F32,
    column_slope: _F32,
    row_slope: _F32,
    key: np.uint64,
    unit_m: float,
    range_min_m: float,
    range_max_m: float,
    sigma_1m_m: float,
    sigma_slope: float,
    correlation: float,
    dropout: float,
    edge_fraction: float,
    edge_lost: float,
    edge_flying: float,
    weak_signal: float,
    above: _F32,
    out: NDArray[np.uint16],
) -> None:
    """What the camera reports for the true inverse depths (H, W), 0 where there is nothing.

    The noise of a pixel shares a part with those on its left and above. Inverse depth is linear over a plane,
    1/z = (n · (x/z, y/z, 1)) / d: its slopes give the incidence, its bends the edges. Echoes whose cosine over
    squared range is below `weak_signal` begin to get lost, at half of it all are.
    `key` selects the frame's random numbers; `above`: (W,) scratch.
    """
    height, width = inverse.shape
    share = math.sqrt(max(0.0, 1.0 - 2.0 * correlation * correlation))
    per_column = 1.0 / (column_slope[1] - column_slope[0])
    per_row = 1.0 / (row_slope[1] - row_slope[0])
    drop_below = np.uint64(dropout * 65536.0)
    per_unit = 1.0 / unit_m
    gauss_scale = math.sqrt(3.0) / 4096.0
    above[:] = np.float32(0.0)
    for row in range(height):
        left = 0.0
        y = row_slope[row]
        row_before, row_after = max(row - 1, 0), min(row + 1, height - 1)
        for column in range(width):
            bits = _mixed(key + np.uint64(row * width + column + 1) * np.uint64(0x9E3779B97F4A7C15))
            # Irwin and Hall: the sum of four uniform numbers, of variance 1/3, is Gaussian to three sigma.
            total = (
                (bits & np.uint64(0xFFF))
                + ((bits >> np.uint64(12)) & np.uint64(0xFFF))
                + ((bits >> np.uint64(24)) & np.uint64(0xFFF))
                + ((bits >> np.uint64(36)) & np.uint64(0xFFF))
            )
            gauss = (np.float64(total) - 8190.0) * gauss_scale
            noise = share * gauss + correlation * (left + above[column])
            left = gauss
            above[column] = np.float32(gauss)
            out[row, column] = 0
            w = inverse[row, column]
            if w <= 0.0 or (bits >> np.uint64(48)) < drop_below:
                continue
            w_left, w_right = inverse[row, max(column - 1, 0)], inverse[row, min(column + 1, width - 1)]
            w_up, w_down = inverse[row_before, column], inverse[row_after, column]
            bend = max(abs(w_left + w_right - 2.0 * w), abs(w_up + w_down - 2.0 * w))
            z = 1.0 / w
            if bend > edge_fraction * w and 0 < row < height - 1 and 0 < column < width - 1:
                chance = _mixed(bits)
                lot = (chance & np.uint64(0xFFFFF)) * (1.0 / 1048576.0)
                if lot < edge_lost:
                    continue
                if lot > 1.0 - edge_flying:
                    partner = w_left
                    for other in (w_right, w_up, w_down):
                        if abs(other - w) > abs(partner - w):
                            partner = other
                    if partner > 0.0:
                        z += ((chance >> np.uint64(20)) & np.uint64(0xFFFFF)) * (1.0 / 1048576.0) * (1.0 / partner - z)
            else:
                gx = 0.5 * (w_right - w_left) * per_column
                gy = 0.5 * (w_down - w_up) * per_row
                gz = w - column_slope[column] * gx - y * gy
                ray2 = 1.0 + column_slope[column] * column_slope[column] + y * y
                # cosine = w / (|g| |ray|) and range = |ray| / w, compared in squares to save the roots
                needed = weak_signal * ray2 * z * z
                slant2 = (gx * gx + gy * gy + gz * gz) * ray2
                if w * w < needed * needed * slant2:
                    strength = w / (needed * math.sqrt(slant2))  # below 1; lost for sure at a half
                    lot = (_mixed(bits) & np.uint64(0xFFFFF)) * (1.0 / 1048576.0)
                    if lot < 2.0 - 2.0 * strength:
                        continue
            measured = z + noise * (sigma_1m_m + sigma_slope * (z - 1.0))
            if range_min_m <= measured <= range_max_m:
                out[row, column] = np.uint16(measured * per_unit + 0.5)
