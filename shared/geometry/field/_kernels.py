"""Kernels of fields on a grid: values between its cells, and how far each cell is from the nearest of some."""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


@njit(nogil=True, cache=True)
def bilinear(field: Floats, u: float, v: float) -> float:
    """Of a (rows, columns) array at column `u` and row `v`, both from 0 to less than the last index.

    What there is beyond the border is the caller's business.
    """
    j = int(u)
    i = int(v)
    a = u - j
    b = v - i
    lower = (1 - a) * field[i, j] + a * field[i, j + 1]
    upper = (1 - a) * field[i + 1, j] + a * field[i + 1, j + 1]
    return float((1 - b) * lower + b * upper)


@njit(nogil=True, cache=True)
def _lower_envelope(row: Floats, result: Floats, hull: Ints, border: Floats) -> None:
    """One line of the squared distance transform (Felzenszwalb and Huttenlocher 2012, algorithm 1)."""
    n = len(row)
    k = 0
    hull[0] = 0
    border[0] = -math.inf
    border[1] = math.inf
    for q in range(1, n):
        cut = ((row[q] + q * q) - (row[hull[k]] + hull[k] * hull[k])) / (2.0 * q - 2.0 * hull[k])
        while cut <= border[k]:
            k -= 1
            cut = ((row[q] + q * q) - (row[hull[k]] + hull[k] * hull[k])) / (2.0 * q - 2.0 * hull[k])
        k += 1
        hull[k] = q
        border[k] = cut
        border[k + 1] = math.inf
    k = 0
    for q in range(n):
        while border[k + 1] < q:
            k += 1
        result[q] = (q - hull[k]) * (q - hull[k]) + row[hull[k]]


@njit(nogil=True, cache=True)
def _transform_rows(field: Floats) -> None:
    rows, columns = field.shape
    hull = np.empty(columns, np.int64)
    border = np.empty(columns + 1)
    line = np.empty(columns)
    result = np.empty(columns)
    for i in range(rows):
        for j in range(columns):
            line[j] = field[i, j]
        _lower_envelope(line, result, hull, border)
        for j in range(columns):
            field[i, j] = result[j]


@njit(nogil=True, cache=True)
def to_distances(field: Floats, cell_m: float) -> None:
    """The distance transform of `field` (rows, columns), in place: in cells squared, 0 where something is and a bound
    elsewhere; then in metres, `cell_m` a cell, from each cell's centre to the nearest where something is."""
    _transform_rows(field.T)
    _transform_rows(field)
    for i in range(field.shape[0]):
        for j in range(field.shape[1]):
            field[i, j] = cell_m * math.sqrt(field[i, j])
