"""The newest telemetry, put together of what comes whole, in pulses over LoRa, and with each observation."""

from __future__ import annotations

import math
from dataclasses import fields, replace

from shared.messages import Observation, Pulse, StopReason, Telemetry
from shared.runtime.latest import Latest, Stamped
from station_gui.model.journal import Journal
from station_gui.model.view import Severity

_ANOTHER_START_S = 5.0  # telemetry that is so much older than the last is of a robot that began anew

_NOT_IN_PULSE = ("following_goal", "faults", "late_ticks")


class TelemetryKeeper:
    """Tells the journal what changed. Written by one thread, read by any."""

    def __init__(self, journal: Journal) -> None:
        self._journal = journal
        self._latest: Latest[Telemetry] = Latest()
        self._reported_s = -math.inf  # robot's time of the last report …
        self._whole_s = -math.inf  # … and of the last whole one

    @property
    def telemetry(self) -> Telemetry | None:
        stamped = self._latest.stamped()
        return None if stamped is None else stamped.value

    def age_s(self, now_s: float) -> float:
        return self._latest.age_s(now_s)

    def take(self, report: Telemetry | Pulse, now_s: float) -> None:
        """`now_s`: station's time. Of a report that another one has overtaken on its way only what a pulse does not say
        counts.
        """
        before = self._latest.stamped()
        if before is not None and 0 < self._reported_s - report.stamp_s < _ANOTHER_START_S:
            if isinstance(report, Telemetry) and report.stamp_s > self._whole_s:
                self._whole_s = report.stamp_s
                self._renew(replace(before.value, **{name: getattr(report, name) for name in _NOT_IN_PULSE}), before)
            return
        self._reported_s = report.stamp_s
        if isinstance(report, Telemetry):
            self._whole_s = report.stamp_s
        telemetry = report if isinstance(report, Telemetry) else _completed(report, before)
        if before is not None and 0 < before.value.stamp_s - telemetry.stamp_s < _ANOTHER_START_S:
            telemetry = _with_motion_of(before.value, telemetry)  # an observation was faster
        self._latest.put(telemetry, now_s)
        self._tell(telemetry, before.value if before is not None else None)

    def _renew(self, telemetry: Telemetry, before: Stamped[Telemetry]) -> None:
        self._latest.put(telemetry, before.stamp_s)
        self._tell(telemetry, before.value)

    def take_motion(self, observation: Observation, now_s: float) -> None:
        """Over LoRa observations come oftener than pulses."""
        last = self.telemetry
        if last is not None and last.stamp_s < observation.stamp_s:
            self._latest.put(_with_motion_of(observation, last), now_s)

    def _tell(self, telemetry: Telemetry, before: Telemetry | None) -> None:
        if before is None or (before.state, before.stop_reason) != (telemetry.state, telemetry.stop_reason):
            self._journal.add(*_mission_event(telemetry))
        for fault in set(telemetry.faults) - set(before.faults if before is not None else ()):
            self._journal.add(Severity.ERROR, f"robot: {fault}")


def _completed(pulse: Pulse, last: Stamped[Telemetry] | None) -> Telemetry:
    """What a pulse leaves out is as it was last told."""
    said = {f.name: getattr(pulse, f.name) for f in fields(Pulse)}
    if last is None:
        return Telemetry(**said, yaw_rate_radps=math.nan, late_ticks=0)
    return replace(last.value, **said)


def _with_motion_of(newer: Observation | Telemetry, telemetry: Telemetry) -> Telemetry:
    return replace(
        telemetry,
        stamp_s=newer.stamp_s,
        odom_from_robot=newer.odom_from_robot,
        speed_mps=newer.speed_mps,
        yaw_rate_radps=newer.yaw_rate_radps,
    )


def _mission_event(telemetry: Telemetry) -> tuple[Severity, str]:
    text = f"mission: {telemetry.state.name.lower()}"
    if telemetry.stop_reason is StopReason.NONE:
        return Severity.INFO, text
    return Severity.WARNING, f"{text}, stopped: {telemetry.stop_reason.name.lower().replace('_', ' ')}"
