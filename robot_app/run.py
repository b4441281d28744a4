"""Runs a robot app in real time until somebody stops it; the same on the Pi and in the simulator."""

from __future__ import annotations

import gc
import logging
import signal
import sys
import threading
from collections.abc import Callable

from robot_app import schedule
from robot_app.app import RobotApp
from robot_app.real_time import steady_memory
from robot_app.service import ServiceManager
from robot_app.timing import timing_report
from shared.runtime.clock import Clock
from shared.runtime.runner import Row, TaskHealth, ThreadRunner

_log = logging.getLogger(__name__)
SWITCH_INTERVAL_S = 0.0005  # a Python thread may keep the others waiting for so long
_LOOK_AFTER_S = 0.5  # a watchdog of 2 s or longer hears from us in time


def stop_on_signals() -> threading.Event:
    """Set by SIGINT and SIGTERM."""
    stop = threading.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: stop.set())
    return stop


def run_robot(
    app: RobotApp,
    clock: Clock,
    stop: threading.Event,
    service: ServiceManager,
    on_ready: Callable[[], None],
    prepare: Callable[[Row], None] | None = None,
) -> tuple[TaskHealth, ...]:
    """Run the tasks of a warm app until `stop` is set. The car stops first, then the devices are closed.

    Returns how the tasks did.
    `prepare`: called in the thread of each task before its first tick.
    """
    sys.setswitchinterval(SWITCH_INTERVAL_S)
    runner = ThreadRunner(app.tasks(), clock, app.on_fault, prepare)
    app.use_health(lambda: runner.health)
    gc.collect()
    gc.freeze()
    steady_memory()
    began_s = clock.now_s()
    runner.start()
    try:
        on_ready()
        service.ready()
        _look_after(runner.health, clock, stop, service)
    finally:
        try:
            app.stop_for_good()
        finally:
            service.stopping()
            left = runner.stop()
            app.shut_down()
        for line in timing_report(runner.health, clock.now_s() - began_s):
            _log.info("%s", line)
        if left:
            _log.error("these tasks did not end in time: %s", ", ".join(left))
    return runner.health


def _look_after(health: tuple[TaskHealth, ...], clock: Clock, stop: threading.Event, service: ServiceManager) -> None:
    """systemd starts the app again when the control task stands still for as long as its watchdog waits.

    One that fails, as with a drive that is gone, does not stand still: the operator has to hear why the car stands.
    """
    control = next(h for h in health if h.row is schedule.CONTROL)
    seen_s = control.last_end_s
    while not clock.wait(stop, clock.now_s() + _LOOK_AFTER_S):
        if control.last_end_s > seen_s:
            seen_s = control.last_end_s
            service.alive()
