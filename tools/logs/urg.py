"""Logs of a URG-04LX with wheel encoders (the data of Kohlbrecher's and BreezySLAM's examples).

Blank-separated fields: 0 time in µs, 2 and 3 encoder ticks of the left and right wheel, 24..705 distances in mm,
right to left over 240° (1024 steps a turn). Values under 20 mean that nothing was measured.

The scanner tells a distance by the phase of modulated light, and is wrong by a wave over the distance; see `true_m`.
That wave, the lag and the wheels are those of the one robot that made the public logs: of another one they are wrong.

The ticks are those of the moment of the stamp; the scan of the same line is older: what the scanner saw the robot do
agrees best with what the wheels did 0.2 s before the stamp, in all three logs to about 0.01 s. Of that 0.07 s are the
sweep and the rest is the way to the computer. Stamps jitter by 15 ms, the scanner does not: it turns once in 0.0987 s.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import median_filter

from shared.geometry.se2 import Pose2, interpolate
from shared.messages import ObjectNetwork, Observation, ScanGeometry
from tools.logs.base import LineSource, LogError

_FIRST_BEAM_FIELD = 24
_BEAMS = 682
_FIELDS = _FIRST_BEAM_FIELD + _BEAMS
_SMALLEST_DISTANCE_MM = 20
_STEP_RAD = math.tau / 1024
_TURN_S = 0.0987
_SWEEP_S = _TURN_S * _BEAMS / 1024
_SCAN_LAG_S = 0.2  # from the first beam of a scan to the stamp of its line
_JITTER_WINDOW = 21  # scans
_WAVE_M = 2.82
_NEAREST_KNOWN_M = 0.3
_GEOMETRY = ScanGeometry(
    first_angle_rad=-_STEP_RAD * (_BEAMS - 1) / 2,
    step_rad=_STEP_RAD,
    beam_interval_s=_TURN_S / 1024,
    range_min_m=0.02,
    range_max_m=5.6,
    robot_from_scanner=Pose2(0.145, 0.0, 0.0),
)


@dataclass(frozen=True, slots=True)
class _Wheels:
    """The robot of the logs, as the scans of all three agree on it.

    Their own description has half a turn of a wheel for 2000 ticks, but for a formula that leaves out the halves of
    the mean of both wheels and of the axle; a radius of 77 mm, 1 % less; and half an axle of 165 mm, 6 % more than what
    the wheels turn about.
    """

    radius_m: float = 0.0777
    half_axle_m: float = 0.155
    ticks_per_rad: float = 2000 / math.tau

    def way_m(self, ticks: int) -> float:
        return ticks / self.ticks_per_rad * self.radius_m


@dataclass(frozen=True, slots=True)
class _Record:
    stamp_s: float
    left: int
    right: int


class UrgReader:
    """Observations of one log, odometry integrated from the wheel ticks and taken when the scan was.

    `corrects`: take the scanner's wave out; without, the distances are the whole millimetres that it sent.
    """

    def __init__(self, path: Path, *, corrects: bool = True) -> None:
        self._corrects = corrects
        self._lines = LineSource(path)
        self._path = path
        self.truncated: str | None = None

    def __iter__(self) -> Iterator[Observation]:
        drive = _Drive(list(_records(self._path)), _Wheels())
        sequence = 0
        for line in self._lines:
            fields = line.text.split()
            if not fields:
                continue
            if len(fields) < _FIELDS and not line.complete:
                self.truncated = f"{self._path}: line {line.number} is cut: {len(fields)} of {_FIELDS} fields"
                return
            try:
                _, ranges_m = _parse(fields)
            except (ValueError, OverflowError) as error:
                raise LogError(f"{self._path}: line {line.number}: {error}") from error
            ranges_m = true_m(ranges_m) if self._corrects else ranges_m
            yield drive.observation(sequence, ranges_m.astype(np.float32))
            sequence += 1
        self.truncated = self._lines.cut
        if sequence == 0 and self.truncated is None:
            raise LogError(f"{self._path}: holds no scan")

    def count(self) -> int:
        """How many scans there are, for a progress bar."""
        return sum(bool(line.text.strip()) for line in LineSource(self._path))


def _records(path: Path) -> Iterator[_Record]:
    """Stamps and ticks of the whole log, up to its first line that cannot be read."""
    for line in LineSource(path):
        fields = line.text.split()
        if not fields:
            continue
        try:
            record, _ = _parse(fields)
        except (ValueError, OverflowError):
            return
        yield record


class _Drive:
    """Where the robot was when each scan began."""

    def __init__(self, records: list[_Record], wheels: _Wheels) -> None:
        arrival_s = np.array([record.stamp_s for record in records])
        self._tick_s = np.maximum.accumulate(arrival_s)
        self._poses = [Pose2()]
        for before, now in itertools.pairwise(records):
            self._poses.append(self._poses[-1] @ _motion(before, now, wheels))
        self._scan_s = scan_times_s(arrival_s)

    def observation(self, sequence: int, ranges_m: NDArray[np.float32]) -> Observation:
        stamp_s = float(self._scan_s[sequence])
        start, end = self._pose_at(stamp_s), self._pose_at(stamp_s + _SWEEP_S)
        motion = start.inverse() @ end
        return Observation(
            sequence, stamp_s, start, motion.x_m / _SWEEP_S, motion.theta_rad / _SWEEP_S, _GEOMETRY, ranges_m,
            ObjectNetwork(), has_objects=False,
        )  # fmt: skip

    def _pose_at(self, stamp_s: float) -> Pose2:
        """Before the first ticks and after the last the robot is taken to stand."""
        after = int(np.searchsorted(self._tick_s, stamp_s, side="right"))
        if after == 0:
            return self._poses[0]
        if after == len(self._tick_s):
            return self._poses[-1]
        before_s, after_s = float(self._tick_s[after - 1]), float(self._tick_s[after])
        return interpolate(self._poses[after - 1], self._poses[after], (stamp_s - before_s) / (after_s - before_s))


def scan_times_s(arrival_s: NDArray[np.float64]) -> NDArray[np.float64]:
    """When the first beam of each scan was measured: the stamps without their jitter, less the lag.

    A scan that was lost shifts those after it by a turn, which a median over neighbours follows at once.
    """
    turns_s = _TURN_S * np.arange(len(arrival_s))
    late_s = median_filter(arrival_s - turns_s, _JITTER_WINDOW, mode="nearest")
    return np.asarray(np.maximum.accumulate(late_s + turns_s) - _SCAN_LAG_S)


def true_m(measured_m: NDArray[np.floating]) -> NDArray[np.float64]:
    """Distances without the scanner's own error: 2 cm too short at 1.4 m, 8 cm too long at 2.8 m.

    Found without a map or wheels: distances of pairs of scans, some tenths of a metre or tens of degrees apart, that
    put the surfaces of both on one another. Any two of the three logs give the wave of all three to 5-10 mm, and what
    is left between two scans falls from 11 to 9.7 mm. A common factor cannot be told that way, and is left at one.
    """
    late_m = 0.032 - 0.051 * np.cos(math.tau * (measured_m - 1.42) / _WAVE_M)
    return np.asarray(measured_m - late_m * np.minimum(measured_m / _NEAREST_KNOWN_M, 1.0))


def _motion(before: _Record, now: _Record, wheels: _Wheels) -> Pose2:
    """What the wheels did between two records: an arc."""
    left_m, right_m = wheels.way_m(now.left - before.left), wheels.way_m(now.right - before.right)
    way_m, turn_rad = (left_m + right_m) / 2, (right_m - left_m) / (2 * wheels.half_axle_m)
    chord_m = way_m * float(np.sinc(turn_rad / math.tau))
    return Pose2(chord_m * math.cos(turn_rad / 2), chord_m * math.sin(turn_rad / 2), turn_rad)


def _parse(fields: list[str]) -> tuple[_Record, NDArray[np.float64]]:
    """Stamp and ticks, and the distances as they were sent; NaN where nothing was measured."""
    if len(fields) < _FIELDS:
        raise ValueError(f"{len(fields)} of {_FIELDS} fields")
    millimetres = np.array(fields[_FIRST_BEAM_FIELD:_FIELDS], dtype=np.int32)
    ranges_m = np.where(millimetres < _SMALLEST_DISTANCE_MM, np.nan, millimetres * 1e-3)
    return _Record(int(fields[0]) * 1e-6, int(fields[2]), int(fields[3])), ranges_m
