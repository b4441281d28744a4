"""CARMEN logs of planar laser scanners (Radish): FLASER or ROBOTLASER1 lines to observations.

`FLASER n r1..rn LASER_POSE ROBOT_POSE ipc_time host logger_time`, a pose being x, y and theta;
`ROBOTLASER1 type start_angle field_of_view resolution max_range accuracy remission_mode n r1..rn m e1..em LASER_POSE
ROBOT_POSE tv rv forward_safety side_safety turn_axis ipc_time host logger_time`.
The order of the file is the true order, stamps may go back. Whatever else a log holds is left out.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from shared.geometry.se2 import Pose2
from shared.messages import ObjectNetwork, Observation, ScanGeometry
from tools.logs.base import Line, LineSource, LogError

RANGE_MIN_M = 0.05
RANGE_MAX_M = 50.0  # FLASER lines mark "nothing there" by values from here on: 50, 51, 80, 81.83, 81.91
MAX_BEAMS = 4096
_POSE_AND_STAMP = 7  # laser pose, robot pose, ipc_time; host and logger_time follow
_TAIL_FIELDS = 9
_ROBOT_TAIL_FIELDS = 14
_NEAR_MAX_SHARE = 0.998  # of a declared max_range: 81.83 and 81.91 both say "nothing" where it is 81.91

# SICK scanners of 180° at 1° or 0.5° (180 and 360 beams leave out the last one) wrote most logs. These wrote others:
# the first beam's angle and the step in degrees by the number of beams.
_OTHER_SCANNERS = {401: (-50.0, 0.25), 541: (-135.0, 0.5), 1081: (-135.0, 0.25)}

# A reading that means "nothing there" can be any number, as 8.1 or 8.19 where a SICK measures millimetres. Then it is
# the largest of the log and frequent, while few beams are a little shorter: real ranges spread.
_CEILING_BIN_M = 0.01
_CEILING_MIN_BEAMS = 20
_CEILING_BELOW_BINS = 10
_CEILING_RATIO = 5
_CEILING_EVERY = 8  # scans


class CarmenReader:
    """Observations of one log. The first kind of scan that comes is the log's; each line carries the odometry."""

    def __init__(self, path: Path) -> None:
        self._lines = LineSource(path)
        self._path = path
        self.truncated: str | None = None

    def __iter__(self) -> Iterator[Observation]:
        kind: str | None = None
        sequence = 0
        nothing_m = _ceiling_m(self._path)
        for line in self._lines:
            if not _is_scan(line, kind):
                continue
            fields = line.text.split()
            kind = fields[0]
            try:
                observation = _KINDS[kind](fields, sequence, nothing_m, line.complete)
            except ValueError as error:
                if not line.complete:
                    self.truncated = f"{self._path}: line {line.number} is cut: {error}"
                    return
                raise LogError(f"{self._path}: line {line.number}: {error}") from error
            yield observation
            sequence += 1
        self.truncated = self._lines.cut
        if sequence == 0 and self.truncated is None:
            raise LogError(f"{self._path}: holds no FLASER or ROBOTLASER1 line")

    def count(self) -> int:
        """How many scans there are, for a progress bar."""
        return sum(1 for _ in _scans(self._path))


def _is_scan(line: Line, kind: str | None) -> bool:
    """`kind` None: of any kind."""
    first = line.text.split(None, 1)[:1]
    return bool(first) and (first[0] == kind or (kind is None and first[0] in _KINDS))


def _scans(path: Path) -> Iterator[Line]:
    """The lines with scans of the log's kind."""
    kind: str | None = None
    for line in LineSource(path):
        if _is_scan(line, kind):
            kind = line.text.split(None, 1)[0]
            yield line


def _ceiling_m(path: Path) -> float:
    """The smallest reading that means "nothing there" in this log, as far as the readings themselves tell."""
    counts = np.zeros(round(RANGE_MAX_M / _CEILING_BIN_M), np.int64)
    for number, line in enumerate(_scans(path)):
        if number % _CEILING_EVERY == 0:
            try:
                bins = np.round(_readings(line.text.split()) / _CEILING_BIN_M)
            except ValueError:
                continue  # whoever reads the line tells what is wrong with it
            counts += np.bincount(bins[(bins >= 0) & (bins < len(counts))].astype(np.int64), minlength=len(counts))
    found = np.flatnonzero(counts)
    if not len(found):
        return RANGE_MAX_M
    top = int(found[-1])
    below = int(counts[max(0, top - _CEILING_BELOW_BINS) : top].sum())
    is_code = counts[top] >= _CEILING_MIN_BEAMS and counts[top] > _CEILING_RATIO * below
    return (top - 0.5) * _CEILING_BIN_M if is_code else RANGE_MAX_M


def _beams(fields: list[str], at: int, tail_fields: int, complete: bool) -> int:
    """The number of beams, which the field at `at` tells; what follows must be long enough."""
    if len(fields) <= at:
        raise ValueError("no number of beams")
    beams = int(fields[at])
    if not 1 < beams <= MAX_BEAMS:
        raise ValueError(f"{beams} beams")
    optional = _TAIL_FIELDS - _POSE_AND_STAMP if complete else 0  # some logs leave out host and logger_time
    wanted = at + 1 + beams + tail_fields - optional
    if len(fields) < wanted:
        raise ValueError(f"{len(fields)} fields where {beams} beams need {wanted}")
    return beams


def _readings(fields: list[str]) -> NDArray[np.float64]:
    at = 1 if fields[0] == "FLASER" else 8
    beams = _beams(fields, at, _TAIL_FIELDS, complete=True)
    return np.nan_to_num(np.array(fields[at + 1 : at + 1 + beams], dtype=np.float64), nan=-1.0, posinf=-1.0)


def _from_flaser(fields: list[str], sequence: int, nothing_m: float, complete: bool) -> Observation:
    beams = _beams(fields, 1, _TAIL_FIELDS, complete)
    ranges_m = np.array(fields[2 : 2 + beams], dtype=np.float64)
    numbers = _numbers(fields[2 + beams : 2 + beams + _POSE_AND_STAMP])
    first_deg, step_deg = _OTHER_SCANNERS.get(beams, (-90.0, 180.0 / (beams - beams % 2)))
    return _observation(
        sequence, ranges_m, min(nothing_m, RANGE_MAX_M), math.radians(first_deg), math.radians(step_deg),
        numbers[:6], numbers[6], (0.0, 0.0),
    )  # fmt: skip


def _from_robotlaser(fields: list[str], sequence: int, nothing_m: float, complete: bool) -> Observation:
    beams = _beams(fields, 8, 1 + _ROBOT_TAIL_FIELDS, complete)
    first_rad, field_rad, step_rad, max_m = _numbers(fields[2:6]).tolist()
    ranges_m = np.array(fields[9 : 9 + beams], dtype=np.float64)
    remissions = int(fields[9 + beams])
    if not 0 <= remissions <= MAX_BEAMS:
        raise ValueError(f"{remissions} remissions")
    tail = fields[10 + beams + remissions :]
    if len(tail) < _ROBOT_TAIL_FIELDS - (2 if complete else 0):
        raise ValueError(f"{len(tail)} fields after the readings where {_ROBOT_TAIL_FIELDS} are needed")
    numbers = _numbers(tail[:12])
    if step_rad <= 0:
        step_rad = field_rad / (beams - 1)
    if not 0 < step_rad * (beams - 1) < 1.001 * math.tau:
        raise ValueError(f"{beams} beams of {step_rad} rad")
    limit_m = _NEAR_MAX_SHARE * max_m if max_m > 0 else RANGE_MAX_M
    return _observation(
        sequence, ranges_m, min(nothing_m, limit_m) if nothing_m < RANGE_MAX_M else limit_m, first_rad, step_rad,
        numbers[:6], numbers[11], (float(numbers[6]), float(numbers[7])),
    )  # fmt: skip


def _numbers(fields: list[str]) -> NDArray[np.float64]:
    numbers = np.array(fields, dtype=np.float64)
    if not np.isfinite(numbers).all():
        raise ValueError("a pose, an angle or a stamp is not finite")
    return numbers


def _observation(
    sequence: int,
    ranges_m: NDArray[np.float64],
    nothing_m: float,
    first_rad: float,
    step_rad: float,
    poses: NDArray[np.float64],
    stamp_s: float,
    motion: tuple[float, float],
) -> Observation:
    """`poses`: (6,) of laser and robot in the odometry's frame; `motion`: speed in m/s and yaw rate in rad/s."""
    odom_from_laser, odom_from_robot = Pose2.from_array(poses[:3]), Pose2.from_array(poses[3:])
    with np.errstate(invalid="ignore"):
        seen_m = np.where(ranges_m >= nothing_m, np.nan, ranges_m).astype(np.float32)
    robot_from_scanner = odom_from_robot.inverse() @ odom_from_laser
    return Observation(
        sequence=sequence,
        stamp_s=float(stamp_s),
        odom_from_robot=odom_from_robot,
        speed_mps=motion[0],
        yaw_rate_radps=motion[1],
        geometry=ScanGeometry(first_rad, step_rad, 0.0, RANGE_MIN_M, nothing_m, robot_from_scanner),
        ranges_m=seen_m,
        objects=ObjectNetwork(),
        has_objects=False,
    )


_KINDS: dict[str, Callable[[list[str], int, float, bool], Observation]] = {
    "FLASER": _from_flaser,
    "ROBOTLASER1": _from_robotlaser,
}
