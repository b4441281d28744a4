"""From a depth buffer to what a depth camera reports, one pass over the pixels."""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

_F32 = NDArray[np.float32]


@njit(nogil=True, cache=True)
def _mixed(value: np.uint64) -> np.uint64:
    """A hash of 64 bits (the finaliser of SplitMix64)."""
    value = (value ^ (value >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    value = (value ^ (value >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return value ^ (value >> np.uint64(31))


@njit(nogil=True, cache=True)
def metric_depth(buffer: _F32, near_m: float, far_m: float, depth_m: _F32) -> None:
    """Distances along the axis from a reversed, zero-to-one depth buffer whose first row is the lowest.

    `buffer`, `depth_m`: (H, W); 0 where nothing was hit before `far_m`.
    """
    height, width = buffer.shape
    scale = far_m * near_m / (far_m - near_m)
    offset = near_m / (far_m - near_m)
    for row in range(height):
        source = height - 1 - row
        for column in range(width):
            value = buffer[source, column]
            depth_m[row, column] = np.float32(scale / (value + offset)) if value > 0.0 else np.float32(0.0)


@njit(nogil=True, cache=True)
def noisy_depth(
    depth_m: _F32,
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
    reflectivity: float,
    min_signal: float,
    above: _F32,
    out: NDArray[np.uint16],
) -> None:
    """What the camera reports for the true depths (H, W), 0 where there is nothing.

    The noise of a pixel shares a part with those on its left and above. The incidence follows from the inverse
    depth, which is linear over a plane: 1/z = (n · (x/z, y/z, 1)) / d. Echoes below twice `min_signal` get lost.
    `key` selects the frame's random numbers; `above`: (W,) scratch.
    """
    height, width = depth_m.shape
    share = math.sqrt(max(0.0, 1.0 - 2.0 * correlation * correlation))
    dx = column_slope[1] - column_slope[0]
    dy = row_slope[1] - row_slope[0]
    above[:] = np.float32(0.0)
    for row in range(height):
        left = 0.0
        y = row_slope[row]
        other_row = row + 1 if row + 1 < height else row - 1
        step_y = dy if row + 1 < height else -dy
        for column in range(width):
            bits = _mixed(key + np.uint64(row * width + column + 1) * np.uint64(0x9E3779B97F4A7C15))
            # Irwin and Hall: the sum of four uniform numbers, of variance 1/3, is Gaussian to three sigma.
            gauss = (
                (bits & np.uint64(0xFFFF))
                + ((bits >> np.uint64(16)) & np.uint64(0xFFFF))
                + ((bits >> np.uint64(32)) & np.uint64(0xFFFF))
                + (bits >> np.uint64(48))
            ) * (1.0 / 65536.0) - 2.0
            gauss *= 1.7320508
            noise = share * gauss + correlation * (left + above[column])
            left = gauss
            above[column] = np.float32(gauss)
            out[row, column] = 0
            z = depth_m[row, column]
            if z <= 0.0:
                continue
            other_column = column + 1 if column + 1 < width else column - 1
            step_x = dx if column + 1 < width else -dx
            z_side = depth_m[row, other_column]
            z_below = depth_m[other_row, column]
            chance = _mixed(bits)
            u1 = (chance & np.uint64(0xFFFFF)) * (1.0 / 1048576.0)
            u2 = ((chance >> np.uint64(20)) & np.uint64(0xFFFFF)) * (1.0 / 1048576.0)
            u3 = ((chance >> np.uint64(40)) & np.uint64(0xFFFFF)) * (1.0 / 1048576.0)
            partner = z_side if abs(z_side - z) > abs(z_below - z) else z_below
            x = column_slope[column]
            w = 1.0 / z
            ray2 = 1.0 + x * x + y * y
            at_edge = abs(partner - z) > edge_fraction * z
            if at_edge:
                # A plane seen at a slant changes as fast as an edge, but its inverse depth goes on evenly.
                before_column = max(0, min(width - 1, 2 * column - other_column))
                before_row = max(0, min(height - 1, 2 * row - other_row))
                z_before = depth_m[row, before_column] if partner == z_side else depth_m[before_row, column]
                if partner > 0.0 and z_before > 0.0:
                    even = 2.0 * w - 1.0 / z_before
                    at_edge = abs(even * partner - 1.0) > edge_fraction
            if at_edge:
                if u1 < edge_lost:
                    continue
                if u1 > 1.0 - edge_flying and partner > 0.0:
                    z += np.float32(u2) * (partner - z)
            elif z_side > 0.0 and z_below > 0.0:
                gx = (1.0 / z_side - w) / step_x
                gy = (1.0 / z_below - w) / step_y
                gz = w - x * gx - y * gy
                cosine = w / math.sqrt((gx * gx + gy * gy + gz * gz) * ray2)
                signal = reflectivity * min(1.0, cosine) / (z * z * ray2)
                if u3 < 2.0 - signal / min_signal:
                    continue
            if u2 < dropout:
                continue
            measured = z + noise * (sigma_1m_m + sigma_slope * (z - 1.0))
            if range_min_m <= measured <= range_max_m:
                out[row, column] = np.uint16(measured / unit_m + 0.5)
