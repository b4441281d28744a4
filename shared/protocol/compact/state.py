"""What both sides know after an observation, bit for bit the same."""

from __future__ import annotations

import math
import zlib
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from shared.geometry.se2 import Pose2
from shared.messages import ScanGeometry
from shared.protocol.compact import tables
from shared.protocol.compact.model import Model

IntArray = NDArray[np.int64]

VERSION = 1  # another one is not understood: it is part of every check
VIEWS = 4  # scans that are kept: the newest, and earlier ones from places apart
MOST_BEAMS = 2048
NODES = 512
EDGES = 768
TURN_RATE_UNIT = 512  # of a turn rate on the wire, in angle units per second: 3.1 mrad/s
SPEED_UNIT_MM = 5
POSITION_UNIT_MM = 1
HEADING_UNIT = 128  # in angle units: 0.77 mrad
UNITS_PER_RAD = tables.TURN / math.tau


# The car's own: a UBG-04LX read with every third of its 682 steps, 25 cm before the rear axle.
CAR_BEAMS = 227
CAR_SCANNER = ScanGeometry(
    first_angle_rad=float(np.float32(-2.0800779)),
    step_rad=float(np.float32(3 * math.tau / 1024)),
    beam_interval_s=float(np.float32(3 * 0.04 / 1024)),
    range_min_m=float(np.float32(0.06)),
    range_max_m=4.0,
    robot_from_scanner=Pose2(0.25, 0.0, 0.0),
)


class Unfit(Exception):
    """Values that no observation has; the text says which."""


@dataclass(slots=True, eq=False)
class Store:
    """Nodes and edges that the other side has; see `objects._kernels`."""

    places: IntArray = field(default_factory=lambda: np.zeros((NODES, 3), np.int64))
    used: IntArray = field(default_factory=lambda: np.zeros(NODES, np.int64))
    last: IntArray = field(default_factory=lambda: np.zeros(NODES, np.int64))
    edges: IntArray = field(default_factory=lambda: np.tile(np.array([-1, -1, 0], np.int64), (EDGES, 1)))

    def copy(self) -> Store:
        return Store(self.places.copy(), self.used.copy(), self.last.copy(), self.edges.copy())


@dataclass(slots=True, eq=False)
class State:
    """`odom`: x, y in mm and the heading in `HEADING_UNIT`, as sent; `here`: where the last scan was placed, by
    odometry and corrections, 1/16 mm and angle units; `key`: the same of the last scan that was set aside.
    """

    model: Model
    number: int = 0  # of observations since the keyframe
    digest: int = 0
    boot_id: int = 0
    sequence: int = -1
    stamp_ms: int = 0
    intervals_ms: tuple[int, int] = (100, 100)
    odom: tuple[int, int, int] = (0, 0, 0)
    speed: int = 0
    turn_rate: int = 0
    geometry: ScanGeometry = CAR_SCANNER
    step_mm: int = 21
    here: tuple[int, int, int] = (0, 0, 0)
    key: tuple[int, int, int] = (0, 0, 0)
    scans: IntArray = field(default_factory=lambda: np.zeros((VIEWS, CAR_BEAMS, 4), np.int64))
    before_mm: IntArray = field(default_factory=lambda: np.zeros(CAR_BEAMS, np.int64))
    store: Store = field(default_factory=Store)

    @staticmethod
    def initial() -> State:
        """What both sides know before a keyframe."""
        return State(Model.trained(), digest=VERSION)

    def copy(self) -> State:
        return replace(
            self,
            model=self.model.copy(),
            scans=self.scans.copy(),
            before_mm=self.before_mm.copy(),
            store=self.store.copy(),
        )

    def seal(self) -> None:
        """Put everything that a difference would show in into the digest."""
        scalars = (self.number, self.boot_id, self.sequence, self.stamp_ms, *self.odom, *self.here, self.step_mm)
        digest = zlib.crc32(repr(scalars).encode(), self.digest)
        for array in (self.model.weights, self.scans[0], self.before_mm, self.store.places, self.store.edges):
            digest = zlib.crc32(array.tobytes(), digest)
        self.digest = digest

    @property
    def odom_from_robot(self) -> Pose2:
        x, y, heading = self.odom
        return Pose2(x * 1e-3, y * 1e-3, math.remainder(heading * HEADING_UNIT / UNITS_PER_RAD, math.tau))


@dataclass(frozen=True, slots=True, eq=False)
class Sweep:
    """A `ScanGeometry` in whole numbers; see `casting._kernels`."""

    mount: IntArray
    interval_ns: int
    first: int
    step: int

    @staticmethod
    def of(geometry: ScanGeometry) -> Sweep:
        """Raises `Unfit` for what no scanner has."""
        pose = geometry.robot_from_scanner
        values = (geometry.first_angle_rad, geometry.step_rad, geometry.beam_interval_s, pose.x_m, pose.y_m)
        if not all(math.isfinite(v) and abs(v) < 100 for v in (*values, pose.theta_rad)):
            raise Unfit("a scanner's geometry that is none")
        step = round(geometry.step_rad * UNITS_PER_RAD * 4096)
        interval_ns = round(geometry.beam_interval_s * 1e9)
        if not 4096 <= step <= tables.TURN * 512 or not 0 <= interval_ns <= 10_000_000:
            raise Unfit("beams too close or too far apart")
        mount = (round(pose.x_m * 16_000), round(pose.y_m * 16_000), round(pose.theta_rad * UNITS_PER_RAD))
        return Sweep(
            np.array(mount, np.int64), interval_ns, round(geometry.first_angle_rad * UNITS_PER_RAD * 4096), step
        )

    def motion(self, speed: int, turn_rate: int) -> IntArray:
        """(5,) for the kernels, of a speed and a turn rate as they are sent."""
        return np.array(
            (speed * SPEED_UNIT_MM, turn_rate * TURN_RATE_UNIT, self.interval_ns, self.first, self.step), np.int64
        )
