from __future__ import annotations

import threading

import pytest

from shared.runtime.clock import ManualClock, MonotonicClock
from shared.runtime.runner import LockstepRunner, OnFault, Row, Task, TaskHealth, ThreadRunner


def row(name: str, rate_hz: float) -> Row:
    return Row(name, rate_hz, 1.0, 1.0, OnFault.RETRY)


def no_fault(row: Row, error: Exception) -> None:
    raise AssertionError(f"{row.name}: {error}")


def test_lockstep_calls_each_task_at_its_rate_and_in_the_order_of_the_table() -> None:
    clock = ManualClock()
    calls: list[tuple[str, float]] = []
    tasks = [
        Task(row("fast", 4.0), lambda: calls.append(("fast", clock.now_s()))),
        Task(row("slow", 2.0), lambda: calls.append(("slow", clock.now_s()))),
    ]
    LockstepRunner(tasks, clock, lambda _: None, no_fault).run_until(0.5)
    assert calls == [("fast", 0.0), ("slow", 0.0), ("fast", 0.25), ("fast", 0.5), ("slow", 0.5)]


def test_lockstep_moves_the_world_before_the_tasks_that_are_due() -> None:
    clock = ManualClock()
    moved: list[float] = []
    seen: list[float] = []
    tasks = [Task(row("look", 10.0), lambda: seen.append(moved[-1] if moved else 0.0))]
    LockstepRunner(tasks, clock, moved.append, no_fault).run_until(0.3)
    assert seen == pytest.approx([0.0, 0.1, 0.2, 0.3])


def test_lockstep_does_not_drift_over_a_million_ticks() -> None:
    clock = ManualClock()
    last: list[float] = [0.0]
    tasks = [Task(row("t", 300.0), lambda: last.__setitem__(0, clock.now_s()))]
    runner = LockstepRunner(tasks, clock, lambda _: None, no_fault)
    runner.run_until(100.0)
    assert last[0] == pytest.approx(100.0, abs=1e-9)
    assert runner.health[0].ticks == 30_001


def test_a_task_that_raises_is_reported_and_called_again() -> None:
    clock = ManualClock()
    faults: list[str] = []
    outcomes = iter([None, RuntimeError("device gone"), None])

    def step() -> None:
        outcome = next(outcomes)
        if outcome is not None:
            raise outcome

    runner = LockstepRunner(
        [Task(row("t", 1.0), step)], clock, lambda _: None, lambda r, e: faults.append(f"{r.name} {e}")
    )
    runner.run_until(1.0)
    assert faults == ["t device gone"]
    assert runner.health[0].fault == "t: device gone"
    runner.run_until(2.0)
    assert runner.health[0].fault is None


def test_a_task_of_lockstep_can_be_made_to_hang() -> None:
    clock, calls = ManualClock(), list[float]()
    runner = LockstepRunner([Task(row("t", 1.0), lambda: calls.append(clock.now_s()))], clock, lambda _: None, no_fault)
    runner.run_until(1.0)
    runner.hang("t", True)
    runner.run_until(4.0)
    assert runner.health[0].hangs(clock.now_s())
    runner.hang("t", False)
    runner.run_until(5.0)
    assert calls == [0.0, 1.0, 5.0]


def test_a_task_that_hangs_is_told_from_one_that_failed_and_one_that_has_not_begun() -> None:
    health = TaskHealth(row("t", 10.0))
    assert not health.hangs(100.0)
    health.finished(1.0, 0.001)
    assert not health.hangs(2.1)
    assert health.hangs(2.3)
    health.failed(2.2, RuntimeError("gone"))
    assert not health.hangs(2.3)
    assert (health.last_good_s, health.last_end_s) == (1.0, 2.2)


def test_threads_run_their_tasks_and_end_when_told() -> None:
    done = threading.Event()
    runner = ThreadRunner([Task(row("t", 200.0), done.set)], MonotonicClock(), no_fault)
    runner.start()
    assert done.wait(5.0)
    assert runner.stop() == []


def test_ticks_that_come_too_late_are_counted_and_not_made_up() -> None:
    clock = ManualClock()
    calls: list[float] = []
    enough = threading.Event()

    def step() -> None:
        calls.append(clock.now_s())
        if len(calls) == 2:
            clock.advance(0.55)  # this tick took five and a half periods
        if len(calls) == 4:
            enough.set()
        if len(calls) > 4:
            enough.wait()

    runner = ThreadRunner([Task(row("t", 10.0), step)], clock, no_fault)
    runner.start()
    assert enough.wait(5.0)
    runner.stop()
    assert calls[:4] == pytest.approx([0.0, 0.1, 0.65, 0.7])
    assert runner.health[0].skipped >= 4
    assert runner.health[0].late >= 1
    assert runner.health[0].latest_s == pytest.approx(0.45)  # of the tick after the long one


def test_each_thread_is_prepared_before_its_first_tick() -> None:
    seen: list[tuple[str, str]] = []
    done = threading.Event()

    def step() -> None:
        seen.append(("tick", threading.current_thread().name))
        done.set()

    runner = ThreadRunner(
        [Task(row("t", 1.0), step)],
        MonotonicClock(),
        no_fault,
        lambda r: seen.append((r.name, threading.current_thread().name)),
    )
    runner.start()
    assert done.wait(5.0)
    runner.stop()
    assert seen[:2] == [("t", "t"), ("tick", "t")]
