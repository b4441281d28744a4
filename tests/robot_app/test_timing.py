from __future__ import annotations

import pytest

from robot_app import schedule
from robot_app.timing import timing_report
from shared.runtime.runner import TaskHealth


def test_the_report_tells_rate_lateness_and_overruns() -> None:
    health = TaskHealth(schedule.ODOMETRY)
    for i in range(1000):
        health.began(0.012 if i == 7 else 0.001)
        health.finished(i * 0.01, 0.006 if i % 100 == 0 else 0.002)
    process, odometry = timing_report([health, TaskHealth(schedule.DEPTH)], 10.0)
    assert process.startswith("ran for 10 s; the process took ")
    assert odometry == (
        "odometry: 100.0 of 100 Hz, 0.10% late by more than 5 ms, at most 12.0 ms; 1.00% over 4 ms, at most 6.0 ms"
    )


@pytest.mark.parametrize("ran_s", [0.0, -1.0])
def test_nothing_is_told_of_a_run_that_was_none(ran_s: float) -> None:
    assert list(timing_report([TaskHealth(schedule.DEPTH)], ran_s)) == []
