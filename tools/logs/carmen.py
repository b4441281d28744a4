"""CARMEN logs of planar laser scanners (Radish): FLASER lines to observations.

`FLASER n r1..rn laser_x laser_y laser_theta robot_x robot_y robot_theta ipc_time host logger_time`; beam 0 points to
the right, beams run counter-clockwise over 180°. The order of the file is the true order, stamps may go back.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from shared.geometry.se2 import Pose2
from shared.messages import ObjectNetwork, Observation, ScanGeometry
from tools.logs.base import Line, LineSource, LogError

RANGE_MIN_M = 0.05
RANGE_MAX_M = 50.0  # scanners of these logs mark "nothing there" by values from 51 to 82 m
MAX_BEAMS = 4096
_TAIL_FIELDS = 9


class CarmenReader:
    """Observations of one log; ODOM lines are left out: each FLASER line carries the odometry at its moment."""

    def __init__(self, path: Path) -> None:
        self._lines = LineSource(path)
        self._path = path
        self.truncated: str | None = None

    def __iter__(self) -> Iterator[Observation]:
        sequence = 0
        for line in self._lines:
            if not line.text.startswith("FLASER "):
                continue
            try:
                observation = _to_observation(line.text.split(), sequence)
            except ValueError as error:
                if not line.complete:
                    self.truncated = f"{self._path}: line {line.number} is cut: {error}"
                    return
                raise LogError(f"{self._path}: line {line.number}: {error}") from error
            yield observation
            sequence += 1
        self.truncated = self._lines.cut
        if sequence == 0 and self.truncated is None:
            raise LogError(f"{self._path}: holds no FLASER line")

    def count(self) -> int:
        """How many scans there are, for a progress bar."""
        return sum(_is_scan(line) for line in LineSource(self._path))


def _is_scan(line: Line) -> bool:
    return line.text.startswith("FLASER ")


def _to_observation(fields: list[str], sequence: int) -> Observation:
    if len(fields) < 2:
        raise ValueError("no number of beams")
    beams = int(fields[1])
    if not 1 < beams <= MAX_BEAMS:
        raise ValueError(f"{beams} beams")
    if len(fields) < 2 + beams + _TAIL_FIELDS:
        raise ValueError(f"{len(fields)} fields where {beams} beams need {2 + beams + _TAIL_FIELDS}")
    ranges = np.array(fields[2 : 2 + beams], dtype=np.float64)
    tail = fields[2 + beams :]
    numbers = np.array([*tail[:6], tail[6]], dtype=np.float64)
    if not np.isfinite(numbers).all():
        raise ValueError("a pose or stamp is not finite")
    odom_from_laser = Pose2.from_array(numbers[:3])
    odom_from_robot = Pose2.from_array(numbers[3:6])
    return Observation(
        sequence=sequence,
        stamp_s=float(numbers[6]),
        odom_from_robot=odom_from_robot,
        speed_mps=0.0,
        yaw_rate_radps=0.0,
        geometry=_geometry(beams, odom_from_robot.inverse() @ odom_from_laser),
        ranges_m=_without_misses(ranges),
        objects=ObjectNetwork(),
        has_objects=False,
    )


def _geometry(beams: int, robot_from_scanner: Pose2) -> ScanGeometry:
    """180° over n beams of 1° or 0.5°, from -90°; 181 and 361 beams include the last one at +90°."""
    step_rad = math.pi / (beams - beams % 2)
    return ScanGeometry(-math.pi / 2, step_rad, 0.0, RANGE_MIN_M, RANGE_MAX_M, robot_from_scanner)


def _without_misses(ranges_m: NDArray[np.float64]) -> NDArray[np.float32]:
    with np.errstate(invalid="ignore"):
        return np.where(ranges_m > RANGE_MAX_M, np.nan, ranges_m).astype(np.float32)
