"""The ground that the car sweeps when it drives on with a given steering, checked against obstacle points."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from robot_app.control import _kernels
from shared.geometry.ackermann import CarGeometry

ORIGIN = np.zeros(3)
NONE = np.zeros((0, 2))


@dataclass(frozen=True, slots=True, eq=False)
class Sweep:
    """`free_m` until a point comes within the margin; `clearance_m` to the nearest point; `end` (4,): the last
    free pose x, y, theta, in the frame of the start, and the steering there."""

    steering_rad: float
    free_m: float
    clearance_m: float
    end: NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class SweepConfig:
    margin_m: float = 0.03  # no point may come nearer to the body
    step_m: float = 0.02  # a point 1 cm deep in the margin is not missed between two steps
    steering_rad_per_m: float = 12.0  # how fast the servo turns while the car drives slowly


class Footprint:
    """The car among obstacle points, robot frame."""

    def __init__(
        self, car: CarGeometry, config: SweepConfig, points_m: NDArray[np.float64], unseen_m: NDArray[np.float64] = NONE
    ) -> None:
        """`points_m`: (N, 2), robot frame. A point that is within the margin already must not come nearer.

        `unseen_m`: (M, 2), robot frame, ground that the body must not cover, but may come near to.
        """
        self._car = car
        self._config = config
        self._points_m = np.vstack((points_m, unseen_m))
        self._margins_m = np.zeros(len(self._points_m))
        half = car.width_m / 2
        seen = len(points_m)
        _kernels.point_margins(
            self._points_m[:seen], car.front_m, car.rear_m, half, config.margin_m, self._margins_m[:seen]
        )

    def sweep(
        self,
        steering_rad: float,
        target_rad: float,
        forward: bool,
        horizon_m: float,
        start: NDArray[np.float64] = ORIGIN,
    ) -> Sweep:
        """Drive from `start`, (3,), with the wheels turning from `steering_rad` to `target_rad`."""
        end = np.empty(4)
        free_m, clearance_m = _kernels.sweep(
            self._points_m,
            self._margins_m,
            start,
            steering_rad,
            target_rad,
            self._config.steering_rad_per_m,
            1.0 if forward else -1.0,
            self._car.wheelbase_m,
            self._car.front_m,
            self._car.rear_m,
            self._car.width_m / 2,
            self._config.step_m,
            horizon_m,
            end,
        )
        return Sweep(target_rad, free_m, clearance_m, end)
