"""What the process may ask for is decided by its limits; asked for in a process of its own."""

from __future__ import annotations

import subprocess
import sys

import pytest

from robot_app import schedule

SCRIPT = """
import logging, os, resource, sys, threading
from robot_app import schedule
from robot_app.real_time import ask_for_real_time, take_priority
from shared.runtime.clock import MonotonicClock
from shared.runtime.runner import Task, ThreadRunner

limits = {{resource.RLIMIT_RTPRIO: {priority}, resource.RLIMIT_MEMLOCK: {memory}}}
resource.getrlimit = lambda which: (limits[which], limits[which])  # only systemd can raise them
logging.basicConfig(level=logging.INFO, stream=sys.stdout, format="%(message)s")
ask_for_real_time()
seen, ticked = {{}}, {{row.name: threading.Event() for row in (schedule.CONTROL, schedule.DEPTH)}}

def step(row):
    seen[row.name] = os.sched_getscheduler(0) & ~os.SCHED_RESET_ON_FORK, os.sched_getparam(0).sched_priority
    ticked[row.name].set()

tasks = [Task(row, lambda row=row: step(row)) for row in (schedule.CONTROL, schedule.DEPTH)]
runner = ThreadRunner(tasks, MonotonicClock(), lambda row, error: None, take_priority)
runner.start()
assert all(event.wait(20.0) for event in ticked.values())
runner.stop()
locked = next(line for line in open("/proc/self/status") if line.startswith("VmLck"))
print(seen["control"], seen["depth"], int(locked.split()[1]) > 0)
"""


def run(priority: int, memory: int) -> list[str]:
    script = SCRIPT.format(priority=priority, memory=memory)
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, timeout=60, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout.splitlines()


def test_without_limits_raised_nothing_is_asked_for() -> None:
    assert run(0, 65_536) == ["real time: memory is not locked, no FIFO priority", "(0, 0) (0, 0) False"]


def test_each_task_takes_the_priority_of_its_row_and_memory_stays() -> None:
    lines = run(80, -1)
    if any("runs without priority" in line or "cannot be locked" in line for line in lines):
        pytest.skip("this machine forbids what its limits permit")
    assert lines == ["real time: memory is locked, FIFO priority up to 80", "(1, 45) (0, 0) True"]


def test_a_priority_above_the_limit_is_not_asked_for() -> None:
    assert run(30, 65_536)[-1] == "(0, 0) (0, 0) False"


def test_tasks_with_a_priority_go_by_their_rate_and_slow_ones_have_none() -> None:
    rows = [row for row in schedule.TABLE if row.priority]
    assert [row.name for row in sorted(rows, key=lambda row: -row.priority)] == [
        "odometry",
        "control",
        "scan",
        "commands",
    ]
    assert all(row.budget_s * row.rate_hz <= 0.5 for row in rows)
