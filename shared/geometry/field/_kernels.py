"""Kernels: values between the cells of a grid."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray


@njit(nogil=True, cache=True)
def bilinear(field: NDArray[np.float64], u: float, v: float) -> float:
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
