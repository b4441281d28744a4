"""`calibrate magnetometer`: what the robot itself adds to the earth's field, by an ellipsoid."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from robot_app.calibrate.change import Change
from robot_app.calibrate.guide import CalibrationError, Guide
from robot_app.config import AnyRobotConfig
from robot_app.drivers.lsm9ds1_magnetometer import Magnetometer, corrected_ut

_FEWEST = 300
_LEAST_COVER = 0.12  # smallest eigenvalue of the directions' second moment; 1/3 where all were seen alike
_MOST_STRETCH = 1.6
_MOST_RESIDUAL = 0.08
_EARTH_UT = (20.0, 70.0)
_OUTLIER = 3.0

Vector = NDArray[np.float64]


def calibrate_magnetometer(magnetometer: Magnetometer, config: AnyRobotConfig, guide: Guide) -> list[Change]:
    """`magnetometer`: uncorrected. Raises `CalibrationError`."""
    field: list[tuple[float, float, float]] = []

    def take() -> None:
        sample = magnetometer.read(0.0)
        if sample is not None:
            field.append(sample.field_ut)

    guide.say(
        "Away from iron: not on a table with steel legs, not near a loudspeaker. Battery in, motor off. Lift the\n"
        "robot and turn it slowly about all its axes, as if to show each of its six sides to the floor and the walls."
    )
    guide.until_enter("Turn it for a minute", take)
    if len(field) < _FEWEST:
        raise CalibrationError(f"only {len(field)} measurements came; turn it for longer")
    offset_ut, matrix, residual = fit_ellipsoid(np.array(field))
    size_ut = float(np.linalg.norm(corrected_ut(np.array(field), offset_ut, matrix), axis=1).mean())
    guide.say(f"The field is {size_ut:.1f} µT, the fit is off by {100 * residual:.1f} % of it.")
    if not _EARTH_UT[0] <= size_ut <= _EARTH_UT[1]:
        raise CalibrationError(f"{size_ut:.0f} µT is not the earth's field, which has 20 to 70; is there iron nearby?")
    m = config.devices.magnetometer
    heading_deg = float(np.degrees(residual))
    return [
        Change(
            "devices.magnetometer.offset_ut", m.offset_ut, tuple(offset_ut.tolist()), f"± {residual * size_ut:.1f} µT"
        ),
        Change("devices.magnetometer.matrix", m.matrix, _six(matrix), f"heading ± {heading_deg:.1f}°"),
    ]


def _six(matrix: Vector) -> tuple[float, ...]:
    return tuple(float(matrix[i, j]) for i, j in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)))


def fit_ellipsoid(field_ut: Vector) -> tuple[Vector, Vector, float]:
    """Offset (3,), symmetric matrix (3, 3) of determinant 1, and the rest as a share of the field; of (N, 3).

    What is corrected, `matrix @ (field - offset)`, lies on a sphere. Raises `CalibrationError` where the measurements
    do not show one.
    """
    centre, scale = field_ut.mean(axis=0), float(field_ut.std())
    points = (field_ut - centre) / scale
    good = np.ones(len(points), bool)
    for _ in range(3):
        offset, matrix = _algebraic(points[good])
        sizes = np.linalg.norm((points - offset) @ matrix.T, axis=1)
        rest = sizes / np.median(sizes) - 1
        spread = max(1.4826 * float(np.median(np.abs(rest[good]))), 1e-6)
        good = np.abs(rest) < _OUTLIER * spread
    residual = float(np.sqrt(np.mean(rest[good] ** 2)))
    directions = ((points - offset) @ matrix.T)[good]
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    if np.linalg.eigvalsh(directions.T @ directions / len(directions))[0] < _LEAST_COVER:
        raise CalibrationError("it was turned about too few axes; show each of its six sides to the floor")
    stretch = np.linalg.eigvalsh(matrix)
    if residual > _MOST_RESIDUAL or stretch[-1] / stretch[0] > _MOST_STRETCH:
        raise CalibrationError("the measurements lie on no sphere: is iron near, or did the motor run?")
    return centre + scale * offset, matrix, residual


def _algebraic(points: Vector) -> tuple[Vector, Vector]:
    """Least squares of the nine coefficients of an ellipsoid about points of size 1."""
    x, y, z = points.T
    design = np.column_stack([x * x, y * y, z * z, 2 * x * y, 2 * x * z, 2 * y * z, 2 * x, 2 * y, 2 * z])
    a, b, c, d, e, f, g, h, k = np.linalg.lstsq(design, np.ones(len(points)), rcond=None)[0]
    form = np.array([[a, d, e], [d, b, f], [e, f, c]])
    values, vectors = np.linalg.eigh(form)
    if values[0] <= 1e-6:
        raise CalibrationError("it was turned about too few axes; show each of its six sides to the floor")
    offset = -np.linalg.solve(form, np.array([g, h, k]))
    root = np.sqrt(values / np.cbrt(values.prod()))
    return offset, vectors @ np.diag(root) @ vectors.T
