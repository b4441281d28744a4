"""Logs of a URG-04LX with wheel encoders (the data of Kohlbrecher's and BreezySLAM's examples).

Blank-separated fields: 0 time in µs, 2 and 3 encoder ticks of the left and right wheel, 24..705 distances in mm,
right to left over 240° (1024 steps a turn). Values under 20 mean that nothing was measured.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from shared.geometry.se2 import Pose2
from shared.messages import ObjectNetwork, Observation, ScanGeometry
from tools.logs.base import LineSource, LogError

_FIRST_BEAM_FIELD = 24
_BEAMS = 682
_FIELDS = _FIRST_BEAM_FIELD + _BEAMS
_SMALLEST_DISTANCE_MM = 20
_STEP_RAD = math.tau / 1024
_GEOMETRY = ScanGeometry(
    first_angle_rad=-_STEP_RAD * (_BEAMS - 1) / 2,
    step_rad=_STEP_RAD,
    beam_interval_s=0.1 / 1024,
    range_min_m=0.02,
    range_max_m=5.6,
    robot_from_scanner=Pose2(0.145, 0.0, 0.0),
)


@dataclass(frozen=True, slots=True)
class _Wheels:
    """The robot of the logs.

    2000 ticks are a whole turn of a wheel. The logs' own description says half a turn, but for a formula that leaves
    out the halves of the mean of both wheels and of the axle; the scans of all logs agree with the whole turn.
    """

    radius_m: float = 0.077
    half_axle_m: float = 0.165
    ticks_per_rad: float = 2000 / math.tau

    def way_m(self, ticks: int) -> float:
        return ticks / self.ticks_per_rad * self.radius_m


@dataclass(frozen=True, slots=True)
class _Record:
    stamp_s: float
    left: int
    right: int


class UrgReader:
    """Observations of one log, odometry integrated from the wheel ticks."""

    def __init__(self, path: Path) -> None:
        self._lines = LineSource(path)
        self._path = path
        self._wheels = _Wheels()
        self.truncated: str | None = None

    def __iter__(self) -> Iterator[Observation]:
        before: _Record | None = None
        pose = Pose2()
        sequence = 0
        for line in self._lines:
            fields = line.text.split()
            if not fields:
                continue
            if len(fields) < _FIELDS and not line.complete:
                self.truncated = f"{self._path}: line {line.number} is cut: {len(fields)} of {_FIELDS} fields"
                return
            try:
                record, ranges = _parse(fields)
            except (ValueError, OverflowError) as error:
                raise LogError(f"{self._path}: line {line.number}: {error}") from error
            step = _Step.between(before or record, record, self._wheels)
            pose = pose @ step.motion()
            yield Observation(
                sequence, record.stamp_s, pose, step.speed_mps, step.yaw_rate_radps, _GEOMETRY, ranges,
                ObjectNetwork(), has_objects=False,
            )  # fmt: skip
            before = record
            sequence += 1
        self.truncated = self._lines.cut
        if sequence == 0 and self.truncated is None:
            raise LogError(f"{self._path}: holds no scan")

    def count(self) -> int:
        """How many scans there are, for a progress bar."""
        return sum(bool(line.text.strip()) for line in LineSource(self._path))


def _parse(fields: list[str]) -> tuple[_Record, np.ndarray[tuple[int], np.dtype[np.float32]]]:
    if len(fields) < _FIELDS:
        raise ValueError(f"{len(fields)} of {_FIELDS} fields")
    millimetres = np.array(fields[_FIRST_BEAM_FIELD:_FIELDS], dtype=np.int32)
    ranges = np.where(millimetres < _SMALLEST_DISTANCE_MM, np.nan, millimetres * 1e-3).astype(np.float32)
    return _Record(int(fields[0]) * 1e-6, int(fields[2]), int(fields[3])), ranges


@dataclass(frozen=True, slots=True)
class _Step:
    """What the wheels did between two records."""

    way_m: float
    turn_rad: float
    seconds: float

    @staticmethod
    def between(before: _Record, now: _Record, wheels: _Wheels) -> _Step:
        left, right = wheels.way_m(now.left - before.left), wheels.way_m(now.right - before.right)
        return _Step((left + right) / 2, (right - left) / (2 * wheels.half_axle_m), now.stamp_s - before.stamp_s)

    def motion(self) -> Pose2:
        chord = self.way_m * float(np.sinc(self.turn_rad / math.tau))
        return Pose2(chord * math.cos(self.turn_rad / 2), chord * math.sin(self.turn_rad / 2), self.turn_rad)

    @property
    def speed_mps(self) -> float:
        return self.way_m / self.seconds if self.seconds > 0 else 0.0

    @property
    def yaw_rate_radps(self) -> float:
        return self.turn_rad / self.seconds if self.seconds > 0 else 0.0
