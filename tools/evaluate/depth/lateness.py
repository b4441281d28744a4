"""`evaluate lateness`: by how much extraction and tracking delay the robot's 100 Hz task; under 1 ms at p99."""

from __future__ import annotations

import argparse
import gc
import json
import math
import sys
import threading
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from robot_app import schedule
from robot_app.drivers.base import DepthImage
from robot_app.perception.config import PerceptionConfig
from robot_app.perception.identity.tracker import ObjectTracker
from robot_app.perception.object_extractor import ObjectExtractor
from robot_app.run import SWITCH_INTERVAL_S
from shared.command_line import number_in, whole_number_in
from shared.geometry.se2 import Pose2
from shared.runtime.clock import MonotonicClock
from shared.runtime.runner import Row, Task, ThreadRunner
from tools.evaluate.depth.extraction import intrinsics_of, mount_of
from tools.evaluate.depth.files import DepthFileError, read_depth
from tools.evaluate.depth.lab_frames import lab_camera, lab_frames

_SETTLE_TICKS = 20
_FAST = schedule.ODOMETRY


@dataclass(frozen=True, slots=True)
class Lateness:
    """How much later than its deadline the 100 Hz task was called."""

    ticks: int
    p50_ms: float
    p99_ms: float
    max_ms: float


@dataclass(frozen=True, slots=True)
class Report:
    """`alone`: with an idle second thread, `beside`: with the extraction at `rate_hz`; the medians of the rounds.

    `extractions`: how many frames were taken, `longest_ms`: the longest, with its tracking, as its thread saw it.
    """

    rate_hz: float
    alone: Lateness
    beside: Lateness
    p99_delay_ms: float
    extractions: int
    longest_ms: float


class DueClock(MonotonicClock):
    """For one task: tells when it asked to be called next."""

    def __init__(self) -> None:
        super().__init__()
        self.due_s = math.nan

    def wait(self, event: threading.Event, until_s: float) -> bool:
        self.due_s = until_s
        return super().wait(event, until_s)


class Metronome:
    """The 100 Hz task: it notes how late it is called and does a little arithmetic, as odometry does."""

    def __init__(self, clock: DueClock, most: int) -> None:
        self._clock = clock
        self._late_s = np.zeros(most)
        self.calls = 0

    def tick(self) -> None:
        if self.calls < len(self._late_s):
            self._late_s[self.calls] = self._clock.now_s() - self._clock.due_s
            self.calls += 1

    def late_ms(self) -> NDArray[np.float64]:
        """Against the deadlines, (N,), without those while the threads start."""
        late_ms: NDArray[np.float64] = 1e3 * self._late_s[_SETTLE_TICKS : self.calls]
        return late_ms


class Frames:
    """The depth task: extracts and tracks one frame after the other.

    To the tracker all are seen from one place: it has to compare each with what it knows of the others.
    """

    def __init__(self, jobs: list[tuple[ObjectExtractor, DepthImage]]) -> None:
        self._jobs = jobs
        self._tracker = ObjectTracker(PerceptionConfig().tracking)
        self._tracker.warm_up()
        self.done = 0

    def tick(self) -> None:
        extractor, image = self._jobs[self.done % len(self._jobs)]
        self._tracker.update(extractor.extract(image), Pose2())
        self.done += 1


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.description = "Measure by how much the extraction on its thread delays the robot's 100 Hz task."
    parser.add_argument("files", nargs="*", type=Path, metavar="FILE", help="depth frames; the simulated lab's without")
    parser.add_argument("--rate", type=number_in(0.1, 100.0), default=30.0, metavar="HZ", help="of extractions (30)")
    parser.add_argument("--seconds", type=number_in(0.1, 3600.0), default=5.0, help="of each measurement (default 5)")
    parser.add_argument("--rounds", type=whole_number_in(1, 100), default=3, help="without and with it (3)")
    parser.add_argument("--json", action="store_true", help="print one JSON object")


def run(args: argparse.Namespace) -> int:
    """Exit code 2 when a file cannot be read."""
    try:
        jobs = _jobs(args.files)
    except DepthFileError as error:
        print(error, file=sys.stderr)
        return 2
    report = measure(jobs, args.rate, args.seconds, args.rounds)
    if args.json:
        print(json.dumps(asdict(report)))
        return 0
    print(f"{'':12s}{'ticks':>8s}{'p50 ms':>9s}{'p99 ms':>9s}{'max ms':>9s}")
    for name, row in (("alone", report.alone), (f"at {report.rate_hz:g} Hz", report.beside)):
        print(f"{name:12s}{row.ticks:8d}{row.p50_ms:9.3f}{row.p99_ms:9.3f}{row.max_ms:9.3f}")
    print(
        f"delay at p99: {report.p99_delay_ms:.3f} ms; {report.extractions} frames, longest {report.longest_ms:.1f} ms"
    )
    return 0


def _jobs(files: list[Path]) -> list[tuple[ObjectExtractor, DepthImage]]:
    if not files:
        extractor = ObjectExtractor(PerceptionConfig(), *lab_camera())
        return [(extractor, image) for image in lab_frames()]
    jobs = []
    for path in files:
        file = read_depth(path)
        intrinsics = intrinsics_of(path, file.image, file.lens_px)
        mount = mount_of("search", file.image, intrinsics)
        jobs.append((ObjectExtractor(PerceptionConfig(), intrinsics, mount), file.image))
    return jobs


def measure(jobs: list[tuple[ObjectExtractor, DepthImage]], rate_hz: float, seconds: float, rounds: int) -> Report:
    """By turns without and with the extraction, on the robot's own runner and as its process is set up."""
    for extractor, _ in jobs:
        extractor.warm_up()
    interval_s = sys.getswitchinterval()
    sys.setswitchinterval(SWITCH_INTERVAL_S)
    gc.collect()
    gc.freeze()
    alone, beside = [], []
    frames = Frames(jobs)
    longest_s = 0.0
    try:
        for _ in range(rounds):
            late_ms, _ = _listen(lambda: None, rate_hz, seconds)
            alone.append(late_ms)
            late_ms, took_s = _listen(frames.tick, rate_hz, seconds)
            beside.append(late_ms)
            longest_s = max(longest_s, took_s)
    finally:
        gc.unfreeze()
        sys.setswitchinterval(interval_s)
    calm, busy = _summary(alone), _summary(beside)
    return Report(rate_hz, calm, busy, round(busy.p99_ms - calm.p99_ms, 3), frames.done, round(1e3 * longest_s, 2))


def _listen(work: Callable[[], None], rate_hz: float, seconds: float) -> tuple[NDArray[np.float64], float]:
    """How late the 100 Hz task was, ms, and how long one call of `work` took at the most, s."""
    clock = DueClock()
    metronome = Metronome(clock, int(2 * seconds * _FAST.rate_hz) + _SETTLE_TICKS)
    fast = ThreadRunner([Task(_FAST, metronome.tick)], clock, _give_up)
    depth = ThreadRunner([Task(replace(schedule.DEPTH, rate_hz=rate_hz), work)], MonotonicClock(), _give_up)
    fast.start()
    depth.start()
    end = MonotonicClock()
    end.wait(threading.Event(), end.now_s() + seconds)
    depth.stop()
    fast.stop()
    return metronome.late_ms(), depth.health[0].longest_s


def _give_up(row: Row, error: Exception) -> None:
    raise error


def _summary(rounds: list[NDArray[np.float64]]) -> Lateness:
    """Of each figure the median over the rounds, so that one disturbance from outside does not count."""
    return Lateness(
        sum(len(late) for late in rounds),
        *(round(float(np.median([np.quantile(late, share) for late in rounds])), 3) for share in (0.5, 0.99, 1.0)),
    )
