"""Runs the tasks of a schedule: each in a thread of its own, or all in one thread on a manual clock.

A task is called at absolute deadlines. Ticks that came too late are counted and skipped, never made up in a
burst. What happens when a task raises is written in its row of the schedule.
"""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from enum import Enum

from shared.runtime.clock import Clock, ManualClock, processor_time_s, stopwatch_s

_log = logging.getLogger(__name__)
_JOIN_TIMEOUT_S = 3.0
_HANGS_S = 0.2  # longer than its output is good for
LATE_S = 0.005  # half a period of the fastest task


class OnFault(Enum):
    """What a task that raises does to the mission."""

    HALT = "halt"  # stop the robot, keep trying
    DEGRADE = "degrade"  # go on without it, keep trying
    RETRY = "retry"  # transient by nature: log and try again


@dataclass(frozen=True, slots=True)
class Row:
    """A row of the schedule table."""

    name: str
    rate_hz: float
    max_age_s: float  # an output older than this is stale
    budget_s: float  # processor time that one tick may take; waiting for a device is none
    on_fault: OnFault
    priority: int = 0  # of its thread among the FIFO threads of the system, where it asks for one; 0: an ordinary one


@dataclass(frozen=True, slots=True)
class Task:
    row: Row
    step: Callable[[], None]


class TaskHealth:
    """Counters of one task; written by its thread, read by any."""

    def __init__(self, row: Row) -> None:
        self.row = row
        self.ticks = 0
        self.skipped = 0
        self.late = 0  # of the ticks, those that began more than LATE_S after they were due
        self.latest_s = 0.0
        self.over_budget = 0
        self.longest_s = 0.0  # processor time of a tick …
        self.busy_s = 0.0  # … and of all of them
        self.last_good_s = self.last_end_s = float("-inf")  # of the ticks that did not raise, and of all of them
        self.fault: str | None = None

    def began(self, late_s: float) -> None:
        self.late += late_s > LATE_S
        self.latest_s = max(self.latest_s, late_s)

    def finished(self, now_s: float, took_s: float) -> None:
        self.ticks += 1
        self.last_good_s = self.last_end_s = now_s
        self.longest_s = max(self.longest_s, took_s)
        self.busy_s += took_s
        self.over_budget += took_s > self.row.budget_s
        if self.fault is not None:
            _log.warning("%s works again", self.row.name)
            self.fault = None

    def hangs(self, now_s: float) -> bool:
        """It has worked, and does not any more, and has not failed either."""
        return self.fault is None and self.ticks > 0 and now_s - self.last_good_s > self.row.max_age_s + _HANGS_S

    def failed(self, now_s: float, error: Exception) -> None:
        self.last_end_s = now_s
        if self.fault is None:  # a fault is logged when it begins and when it ends
            _log.error("%s failed: %s", self.row.name, error, exc_info=error)
        self.fault = f"{self.row.name}: {error}"


FaultHandler = Callable[[Row, Exception], None]


class _Guarded:
    """A task whose exceptions end at its own tick."""

    def __init__(self, task: Task, clock: Clock, on_fault: FaultHandler) -> None:
        self.task = task
        self.health = TaskHealth(task.row)
        self._clock = clock
        self._on_fault = on_fault

    def tick(self) -> None:
        began_s = processor_time_s()
        try:
            self.task.step()
        except Exception as error:  # noqa: BLE001 - the runner is where a task's fault ends
            self.health.failed(self._clock.now_s(), error)
            self._tell(error)
        else:
            self.health.finished(self._clock.now_s(), processor_time_s() - began_s)

    def _tell(self, error: Exception) -> None:
        try:
            self._on_fault(self.task.row, error)
        except Exception:  # noqa: BLE001 - the task must be called again even when the answer to its fault fails
            _log.exception("the answer to the fault of %s failed", self.task.row.name)


class ThreadRunner:
    """One thread per task, in real time. `prepare` is called in each thread before its first tick."""

    def __init__(
        self,
        tasks: Sequence[Task],
        clock: Clock,
        on_fault: FaultHandler,
        prepare: Callable[[Row], None] | None = None,
    ) -> None:
        self._clock = clock
        self._prepare = prepare
        self._stop = threading.Event()
        self._guarded = [_Guarded(task, clock, on_fault) for task in tasks]
        self._threads = [
            threading.Thread(target=self._run, args=(g,), name=g.task.row.name, daemon=True) for g in self._guarded
        ]

    @property
    def health(self) -> tuple[TaskHealth, ...]:
        return tuple(g.health for g in self._guarded)

    def start(self) -> None:
        for thread in self._threads:
            thread.start()

    def stop(self) -> list[str]:
        """End all tasks; returns the names of those that did not end in time."""
        self._stop.set()
        until_s = stopwatch_s() + _JOIN_TIMEOUT_S  # for all of them together
        for thread in self._threads:
            if thread.ident is not None and thread is not threading.current_thread():
                thread.join(max(0.0, until_s - stopwatch_s()))
        return [thread.name for thread in self._threads if thread.is_alive()]

    def _run(self, guarded: _Guarded) -> None:
        if self._prepare is not None:
            self._prepare(guarded.task.row)
        period_s = 1.0 / guarded.task.row.rate_hz
        due_s, missed_s = self._clock.now_s(), 0.0
        while not self._stop.is_set():
            guarded.health.began(self._clock.now_s() - due_s + missed_s)
            guarded.tick()
            due_s += period_s
            late_s = self._clock.now_s() - due_s
            missed = int(late_s / period_s) if late_s > period_s else 0
            guarded.health.skipped += missed
            missed_s = missed * period_s
            due_s += missed_s
            if self._clock.wait(self._stop, due_s):
                return


class LockstepRunner:
    """All tasks in the caller's thread on a manual clock: deterministic and as fast as the machine.

    `advance(time_s)` moves the world to a time before the tasks due then are called, in the table's order.
    """

    def __init__(
        self,
        tasks: Sequence[Task],
        clock: ManualClock,
        advance: Callable[[float], None],
        on_fault: FaultHandler,
    ) -> None:
        self._clock = clock
        self._advance = advance
        self._guarded = [_Guarded(task, clock, on_fault) for task in tasks]
        self._ticks_done = [0] * len(tasks)
        self._hanging: set[str] = set()
        self._start_s = clock.now_s()

    @property
    def health(self) -> tuple[TaskHealth, ...]:
        return tuple(g.health for g in self._guarded)

    def hang(self, name: str, hangs: bool) -> None:
        """Whether the task stands in the middle of a tick from now on."""
        (self._hanging.add if hangs else self._hanging.discard)(name)

    def replace_step(self, name: str, step: Callable[[], None]) -> Callable[[], None]:
        """Call `step` in the place of what the task has done so far, which is returned."""
        guarded = next(g for g in self._guarded if g.task.row.name == name)
        before = guarded.task
        guarded.task = Task(before.row, step)
        return before.step

    def run_until(self, time_s: float) -> None:
        """Call everything due up to and including `time_s`."""
        while True:
            due_s = min(self._due_s(i) for i in range(len(self._guarded)))
            if due_s > time_s:
                break
            self._move_to(due_s)
            for i, guarded in enumerate(self._guarded):
                if self._due_s(i) <= due_s:
                    self._ticks_done[i] += 1
                    if guarded.task.row.name not in self._hanging:
                        guarded.tick()
        self._move_to(time_s)

    def _due_s(self, index: int) -> float:
        return self._start_s + self._ticks_done[index] / self._guarded[index].task.row.rate_hz

    def _move_to(self, time_s: float) -> None:
        if time_s > self._clock.now_s():
            self._advance(time_s)
            self._clock.advance_to(max(time_s, self._clock.now_s()))
