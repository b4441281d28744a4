"""How the robot's computer does: schedule, processor, memory, fan and what the drivers had to drop."""

from __future__ import annotations

import os
import resource
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from robot_app.drivers.base import Hardware, TemperatureSample
from shared.messages import FanState, TaskVitals, Vitals
from shared.runtime.runner import TaskHealth

_STATM = Path("/proc/self/statm")
_PAGE_MB = os.sysconf("SC_PAGE_SIZE") / 2**20
_BAD_SHARE = 0.005
_MOST_BAD = 2


class VitalsMeter:
    """Rates and shares are those since the last call."""

    def __init__(self, hardware: Hardware, now_s: float) -> None:
        self._hardware = hardware
        self._last_s = now_s
        self._last_processor_s = _processor_s()
        self._last: dict[str, tuple[int, int, int]] = {}  # ticks, late ones, those over their budget

    def measure(self, now_s: float, health: Sequence[TaskHealth], temperature: TemperatureSample | None) -> Vitals:
        elapsed_s, processor_s = max(now_s - self._last_s, 1e-3), _processor_s()
        cores = (processor_s - self._last_processor_s) / elapsed_s
        self._last_s, self._last_processor_s = now_s, processor_s
        return Vitals(
            stamp_s=now_s,
            cores=cores,
            memory_mb=_memory_mb(),
            fan=_fan(temperature),
            throttling=temperature.throttling if temperature is not None else (),
            tasks=tuple(self._task(h, elapsed_s) for h in health),
            counters=self._hardware.losses,
        )

    def _task(self, health: TaskHealth, elapsed_s: float) -> TaskVitals:
        now = health.ticks, health.late, health.over_budget
        ticks, late, over = (n - b for n, b in zip(now, self._last.get(health.row.name, (0, 0, 0)), strict=True))
        self._last[health.row.name] = now
        each = 1 / max(ticks, 1)
        return TaskVitals(
            health.row.name, ticks / elapsed_s, late * each, over * each, health.latest_s, health.longest_s
        )


def brief(vitals: Vitals) -> Vitals:
    """What is worth the time on LoRa: the two tasks that are worst off, and counters that count something."""
    bad = [t for t in vitals.tasks if max(t.late_share, t.over_budget_share) > _BAD_SHARE]
    worst = sorted(bad, key=lambda t: -max(t.late_share, t.over_budget_share))[:_MOST_BAD]
    return replace(vitals, tasks=tuple(worst), counters=tuple(c for c in vitals.counters if c[1]))


def _fan(temperature: TemperatureSample | None) -> FanState:
    if temperature is None or temperature.fan is None:
        return FanState.UNKNOWN
    return FanState.ON if temperature.fan else FanState.OFF


def _processor_s() -> float:
    used = resource.getrusage(resource.RUSAGE_SELF)
    return used.ru_utime + used.ru_stime


def _memory_mb() -> float:
    """What of the process is in RAM; 0 where the system does not tell."""
    try:
        return int(_STATM.read_text("ascii").split()[1]) * _PAGE_MB
    except (OSError, ValueError, IndexError):
        return 0.0
