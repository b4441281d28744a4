"""A number, and how sure it is."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

_MAD_TO_SIGMA = 1.4826  # of a normal distribution
_OUTLIER_SIGMAS = 4.0
_BATCHES = 10


@dataclass(frozen=True, slots=True)
class Estimate:
    """`sigma`: one standard deviation of `value`."""

    value: float
    sigma: float


def typical(samples: ArrayLike, axis: int = 0) -> NDArray[np.float64]:
    """The mean of what is no outlier, along `axis`: of (N, ...) and axis 0, shape (...)."""
    values = np.asarray(samples, np.float64)
    middle = np.median(values, axis, keepdims=True)
    spread = _MAD_TO_SIGMA * np.median(np.abs(values - middle), axis, keepdims=True)
    good = np.abs(values - middle) <= _OUTLIER_SIGMAS * np.maximum(spread, 1e-12)
    mean: NDArray[np.float64] = np.sum(values * good, axis) / np.sum(good, axis)
    return mean


def steady(samples: ArrayLike) -> Estimate:
    """Of (N,) successive measurements of what does not change.

    The deviation is that of ten means in a row, which sees slow wander where sqrt(N) would not.
    """
    values = np.asarray(samples, np.float64)
    means = np.array([typical(part) for part in np.array_split(values, _BATCHES)])
    return Estimate(float(typical(values)), float(means.std(ddof=1) / np.sqrt(_BATCHES)))


def line(x: ArrayLike, y: ArrayLike) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Intercept and slope of y over x, both (N,), with outliers left out; (2,) and their covariance (2, 2)."""
    xs, ys = np.asarray(x, np.float64), np.asarray(y, np.float64)
    good = np.ones(len(xs), bool)
    for _ in range(4):
        design = np.column_stack([np.ones(good.sum()), xs[good]])
        solution = np.linalg.lstsq(design, ys[good], rcond=None)[0]
        rest = ys - solution[0] - solution[1] * xs
        spread = max(_MAD_TO_SIGMA * float(np.median(np.abs(rest[good]))), 1e-9)
        good = np.abs(rest) <= _OUTLIER_SIGMAS * spread
    freedom = max(int(good.sum()) - 2, 1)
    variance = float(np.sum(rest[good] ** 2)) / freedom
    design = np.column_stack([np.ones(good.sum()), xs[good]])
    covariance: NDArray[np.float64] = variance * np.linalg.inv(design.T @ design)
    return solution, covariance
