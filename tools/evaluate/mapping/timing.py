"""What each observation costs the station, SLAM apart from everything else."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from shared.geometry.se2 import Pose2
from shared.messages import Observation
from station_gui.build import build_method
from station_gui.config import StationConfig
from station_gui.mapping.pipeline import MappingPipeline
from station_gui.mapping.saved_map import SavedMap
from station_gui.mapping.scan import PointScan
from station_gui.mapping.slam2d.localisation.self_locating import SelfLocatingSlam
from station_gui.mapping.snapshot import GridMap, MapSnapshot
from tools.evaluate.playing import Spent, Stopwatch

T = TypeVar("T")

_NOTHING = Spent(0.0, 0.0, 0.0)


@dataclass(slots=True)
class Costs:
    """Of each observation that entered the map: SLAM with its grid, and all the rest."""

    slam: list[Spent] = field(default_factory=list)
    combine: list[Spent] = field(default_factory=list)

    def figures(self) -> dict[str, float]:
        """Milliseconds on the clock, and `cpu`: by this thread. The last four tell whether a step costs more later."""
        named = {"slam": self.slam, "combine": self.combine}
        found = {}
        for name, spent in named.items():
            for share in (50, 99):
                found[f"{name}_ms_p{share}"] = _percentile([s.wall_s for s in spent], share)
                found[f"{name}_cpu_ms_p{share}"] = _percentile([s.thread_s for s in spent], share)
        steps_s = [(a.wall_s + b.wall_s, a.thread_s + b.thread_s) for a, b in zip(self.slam, self.combine, strict=True)]
        quarter = max(1, len(steps_s) // 4)
        for name, part in (("first", steps_s[:quarter]), ("last", steps_s[-quarter:])):
            found[f"step_ms_p99_{name}_quarter"] = _percentile([wall_s for wall_s, _ in part], 99)
            found[f"step_cpu_ms_p99_{name}_quarter"] = _percentile([thread_s for _, thread_s in part], 99)
        return found


class TimedPipeline:
    """The station's pipeline as it is built, with a snapshot after each observation."""

    def __init__(self, config: StationConfig) -> None:
        self._config = config
        self._slam: _TimedSlam | None = None
        self._pipeline = MappingPipeline(self._make_slam, config.combine)
        self.costs = Costs()

    def add(self, observation: Observation) -> bool:
        """Map it and draw the map; False where it was left out."""
        slam = self._slam
        if slam is None:
            raise RuntimeError("the pipeline has not made its SLAM")
        slam.taken = _NOTHING
        watch = Stopwatch()
        if not self._pipeline.add(observation):
            return False
        self._pipeline.snapshot()
        spent, inner = watch.spent(), slam.taken
        self.costs.slam.append(inner)
        rest = (spent.wall_s - inner.wall_s, spent.thread_s - inner.thread_s, spent.process_s - inner.process_s)
        self.costs.combine.append(Spent(*rest))
        return True

    def finish(self) -> MapSnapshot:
        """The map after the last touch."""
        self._pipeline.finish()
        return self._pipeline.snapshot()

    def _make_slam(self, given: SavedMap | None, fixed: bool) -> SelfLocatingSlam:
        config = self._config
        self._slam = _TimedSlam(config.localisation, config.slam.grid, build_method(config), given, fixed=fixed)
        return self._slam


class _TimedSlam(SelfLocatingSlam):
    taken = _NOTHING

    def add(self, scan: PointScan) -> Pose2:
        return self._timed(lambda: SelfLocatingSlam.add(self, scan))

    def grid(self) -> GridMap:
        return self._timed(lambda: SelfLocatingSlam.grid(self))

    def trajectory(self) -> NDArray[np.float64]:
        return self._timed(lambda: SelfLocatingSlam.trajectory(self))

    def closures(self) -> NDArray[np.int32]:
        return self._timed(lambda: SelfLocatingSlam.closures(self))

    def _timed(self, work: Callable[[], T]) -> T:
        watch, before = Stopwatch(), self.taken
        result = work()
        spent = watch.spent()  # of calls within `work` as well
        self.taken = Spent(
            before.wall_s + spent.wall_s, before.thread_s + spent.thread_s, before.process_s + spent.process_s
        )
        return result


def _percentile(seconds: list[float], share: int) -> float:
    return 1000 * float(np.percentile(seconds, share)) if seconds else float("nan")
