"""A log through the SLAM that the station ships, and what each step took."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from shared.messages import Observation
from station_gui.build import build_slam
from station_gui.config import StationConfig, load_config
from station_gui.mapping.saved_map import SavedMap
from station_gui.mapping.scan import PointScan, to_points
from station_gui.mapping.slam2d.localisation.self_locating import SelfLocatingSlam
from station_gui.mapping.slam2d.particle.particle_slam import ParticleSlam
from station_gui.mapping.slam2d.se2_arrays import between
from station_gui.mapping.snapshot import Tracking
from tools.logs.base import LogReader

FloatArray = NDArray[np.float64]
Method = Literal["graph", "particle"]


@dataclass(frozen=True, slots=True)
class Spent:
    """Time of one piece of work: on the clock, by this thread, and by all threads of this process.

    On a loaded machine the clock runs on while the thread waits for a core; what the thread spent does not.
    """

    wall_s: float
    thread_s: float
    process_s: float


class Stopwatch:
    """Runs from when it is made."""

    def __init__(self) -> None:
        self._process_s = time.process_time()
        self._thread_s = time.thread_time()
        self._wall_s = time.perf_counter()

    def spent(self) -> Spent:
        wall_s, thread_s = time.perf_counter() - self._wall_s, time.thread_time() - self._thread_s
        return Spent(wall_s, thread_s, time.process_time() - self._process_s)


@dataclass(frozen=True, slots=True, eq=False)
class Run:
    """`stamps_s`: (N,); `poses`: (N, 3), map_from_robot after the last optimisation; `steps`: of each scan.

    `closure_offsets_m`: how far the places that each closure joins are in the end from where it has them.
    `ranges_m`: of each scan, (B,). `located`: (N,), whether the station knew the robot's place when the scan was taken.
    `resamplings` and `effective_share`: of a particle filter only; the latter is the mean effective number of the
    particles as a share of all.
    """

    scans: list[PointScan]
    ranges_m: list[NDArray[np.float32]]
    poses: FloatArray
    steps: list[Spent]
    finish: Spent
    loop_closures: int
    closure_offsets_m: FloatArray
    located: NDArray[np.bool_]
    resamplings: int | None
    effective_share: float | None
    truncated: str | None

    @property
    def stamps_s(self) -> FloatArray:
        return np.array([scan.stamp_s for scan in self.scans])

    @property
    def unlocated(self) -> int:
        """How many scans came while the station did not know the robot's place."""
        return int(np.count_nonzero(~self.located))

    @property
    def wall_s(self) -> float:
        return sum(step.wall_s for step in self.steps) + self.finish.wall_s

    @property
    def cpu_s(self) -> float:
        """Of all threads."""
        return sum(step.process_s for step in self.steps) + self.finish.process_s


@dataclass(frozen=True, slots=True)
class Part:
    """A `LogReader` of what was read before."""

    observations: Sequence[Observation]
    truncated: str | None = None

    def __iter__(self) -> Iterator[Observation]:
        return iter(self.observations)


def shipped(method: Method, seed: int) -> StationConfig:
    """The station's own configuration with this method; `seed`: of the particle filter."""
    config = load_config(None)
    return replace(config, method=method, particle_slam=replace(config.particle_slam, seed=seed))


def shipped_slam(method: Method, seed: int) -> SelfLocatingSlam:
    """What the station's pipeline is built of."""
    return build_slam(shipped(method, seed))


def play(reader: LogReader, slam: SelfLocatingSlam) -> Run:
    """The whole log, in the order of the file. A step begins with the observation, as it does in the station."""
    scans, ranges, steps, located = [], [], [], []
    for observation in reader:
        watch = Stopwatch()
        scan = to_points(observation)
        slam.add(scan)
        steps.append(watch.spent())
        located.append(slam.tracking is Tracking.LOCATED)
        scans.append(scan)
        ranges.append(observation.ranges_m)
    watch = Stopwatch()
    slam.finish()
    finish = watch.spent()
    poses = np.array([slam.pose_of_scan(k).as_array() for k in range(len(scans))]).reshape(-1, 3)
    particles = slam.inner if isinstance(slam.inner, ParticleSlam) else None
    return Run(
        scans,
        ranges,
        poses,
        steps,
        finish,
        loop_closures=len(slam.closures()),
        closure_offsets_m=closure_offsets_m(slam.saved()) if len(slam.closures()) else np.zeros(0),
        located=np.array(located, np.bool_),
        resamplings=particles.resamplings if particles is not None else None,
        effective_share=particles.effective_share if particles is not None else None,
        truncated=reader.truncated,
    )


def closure_offsets_m(saved: SavedMap) -> FloatArray:
    """(L,): between where the second node of each closure is and where the closure has it."""
    pairs = zip(saved.ends[saved.robust].tolist(), saved.measured[saved.robust], strict=True)
    offsets = [between(measured, between(saved.nodes[i], saved.nodes[j])) for (i, j), measured in pairs]
    return np.array([math.hypot(x_m, y_m) for x_m, y_m, _ in offsets])
