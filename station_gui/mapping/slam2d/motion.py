"""Where the robot should be by now: odometry, corrected for what matching has shown of it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from station_gui.mapping.slam2d.belief import odometry_sigma
from station_gui.mapping.slam2d.config import MatchConfig, MotionConfig
from station_gui.mapping.slam2d.matching.scan_matcher import Match
from station_gui.mapping.slam2d.se2_arrays import between

FloatArray = NDArray[np.float64]
_LEAST_STEP_M = 0.01


@dataclass(frozen=True, slots=True, eq=False)
class Prediction:
    """`motion`: (3,) since the scan before, in the robot's frame then; `sigma`: (3,) standard deviations."""

    motion: FloatArray
    sigma: FloatArray


class MotionModel:
    """Learns the scale of the wheels' way (slip, a worn tyre) where the scans hold the robot well.

    It counts where they do not: along a bare corridor the odometry alone says how long it is. Where the wheels
    report nothing although the scans show motion, the robot is taken to go on as before.
    """

    def __init__(self, config: MotionConfig, match: MatchConfig) -> None:
        self._config = config
        self._match = match
        self._way_m = config.scale_prior_m  # odometry's, as far as it is remembered
        self._matched_m = config.scale_prior_m
        self._silent_scans = 0  # in a row, while the robot moved
        self._last_step = np.zeros(3)

    @property
    def scale(self) -> float:
        """True way for each metre that odometry reports."""
        return self._matched_m / self._way_m

    def predict(self, odometry: FloatArray) -> Prediction:
        """`odometry`: (3,), the motion that it reports."""
        config, match = self._config, self._match
        if self._silent_scans >= config.silent_scans and not odometry.any():
            shift_m, turn_rad = config.silent_shift_m, config.silent_turn_rad
            return Prediction(self._last_step, np.array([shift_m, shift_m, turn_rad]))
        motion = odometry * (self.scale, self.scale, 1.0)
        return Prediction(motion, odometry_sigma(match, motion))

    def learn(self, odometry: FloatArray, before: FloatArray, match: Match) -> None:
        """From a match that is believed; `before`: (3,), the pose that it was predicted from."""
        self._last_step = between(before, match.pose)
        held = match.information[:2, :2] * self._match.noise_m**2  # in points
        if odometry.any():
            self._silent_scans = 0
            self._learn_scale(odometry, match.pose[2] - odometry[2], held)
        elif self._moved() and float(np.linalg.eigvalsh(held)[0]) > self._match.weak_points:
            self._silent_scans += 1

    def miss(self) -> None:
        """A match was not believed: what the robot did before says less and less."""
        self._last_step = 0.5 * self._last_step

    def _learn_scale(self, odometry: FloatArray, heading_rad: float, held: FloatArray) -> None:
        config = self._config
        way_m = float(np.hypot(odometry[0], odometry[1]))
        if way_m < _LEAST_STEP_M:
            return
        ahead = odometry[:2] / way_m
        c, s = np.cos(heading_rad), np.sin(heading_rad)
        in_map = np.array([c * ahead[0] - s * ahead[1], s * ahead[0] + c * ahead[1]])
        if float(in_map @ held @ in_map) < config.scale_points:
            return
        matched_m = float(self._last_step[:2] @ ahead)
        if not 0.5 * way_m < matched_m < 2.0 * way_m:  # the wheels spun, or the robot was pushed
            return
        fade = min(1.0, config.scale_memory_m / (self._way_m + way_m))
        self._way_m = fade * (self._way_m + way_m)
        self._matched_m = fade * (self._matched_m + matched_m)

    def _moved(self) -> bool:
        config, step = self._config, self._last_step
        return bool(np.hypot(step[0], step[1]) > config.moved_m or abs(step[2]) > config.moved_rad)
