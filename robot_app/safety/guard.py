"""Decides whether the car may move at all, and says why not."""

from __future__ import annotations

import math
import threading

from robot_app.safety.bands import BandWatch, SafetyConfig
from robot_app.safety.losses import LossWatch
from shared.messages import StopReason

_SPEAKING_S = 0.3  # longer than the heartbeat's period
_BATTERY_SHARE = 0.15  # of the newest voltage, ten times a second: a motor that starts is no empty battery


class Guard:
    """Collects what speaks against moving. The first reason of the table below that stands is the one reported."""

    def __init__(self, config: SafetyConfig, scan_max_age_s: float, odometry_max_age_s: float, now_s: float) -> None:
        self._scan_max_age_s = scan_max_age_s
        self._odometry_max_age_s = odometry_max_age_s
        self.silence_limit_s = config.command_silence_s  # what the link's present path allows
        self._warmth = BandWatch(config.warm_c)
        self._heat = BandWatch(config.over_temperature_c)
        self._weak = BandWatch(config.weak_battery_v)
        self._home = BandWatch(config.home_battery_v)
        self._is_home_due = False
        self._battery = BandWatch(config.low_battery_v)
        self._battery_v = math.nan
        self._processor: tuple[str, ...] = ()
        self._heard_s = self._back_s = now_s
        self._was_silent = True
        self._faults: dict[str, tuple[StopReason, str]] = {}
        self._losses = LossWatch(config.losses)
        self._late: tuple[str, ...] = ()
        self._pause = StopReason.NONE
        self._pause_until_s = now_s
        self._lock = threading.Lock()

    def heard(self, now_s: float) -> None:
        """A command or a heartbeat came from the station."""
        with self._lock:
            self._notice_silence(now_s)
            if self._was_silent:
                self._was_silent, self._back_s = False, now_s
            self._heard_s = now_s

    def silence_s(self, now_s: float) -> float:
        return now_s - self._heard_s

    def _notice_silence(self, now_s: float) -> None:
        """It lasts until the next word, also where the link changes to a path that allows a longer one."""
        self._was_silent |= self.silence_s(now_s) > self.silence_limit_s

    def _is_spoken_to(self, now_s: float) -> bool:
        """After a silence one word is not enough: it may have lain in some buffer, and its sender be gone."""
        with self._lock:
            self._notice_silence(now_s)
            return not self._was_silent and self._heard_s - self._back_s >= _SPEAKING_S

    def take_temperature(self, cpu_c: float, throttling: tuple[str, ...] = ()) -> None:
        """`throttling`: what holds the processor back, in words."""
        self._warmth.update(cpu_c)
        self._heat.update(cpu_c)
        self._processor = throttling

    def take_battery(self, battery_v: float) -> None:
        before_v = battery_v if math.isnan(self._battery_v) else self._battery_v
        self._battery_v = before_v + _BATTERY_SHARE * (battery_v - before_v)
        was_low = self._home.inside
        for watch in (self._weak, self._home, self._battery):
            watch.update(self._battery_v)
        self._is_home_due = self._home.inside and (self._is_home_due or not was_low)

    @property
    def is_home_due(self) -> bool:
        """The battery is low, and the car has not been sent home for it."""
        return self._is_home_due

    def sent_home(self) -> None:
        """Whoever goes on after that knows what he does."""
        self._is_home_due = False

    @property
    def spares_processor(self) -> bool:
        """It is warm, or held back: what can be done more seldom should be."""
        return self._warmth.inside or bool(self._processor)

    @property
    def warnings(self) -> tuple[str, ...]:
        """For the operator; without figures, which would make a new warning of each."""
        found = [f"waiting for the {sensor}" for sensor in self._late]
        found += [f"processor: {text}" for text in self._processor]
        if self._weak.inside:
            found.append(
                "the battery is low: it drives to its start, if it can" if self._home.inside else "battery low"
            )
        if self._warmth.inside:
            found.append("the processor is hot: fewer depth images")
        return tuple(found)

    def pause(self, reason: StopReason, until_s: float) -> None:
        """The car is to stand for a while, and may then go on."""
        self._pause, self._pause_until_s = reason, until_s

    def fault_began(self, task: str, reason: StopReason, text: str) -> None:
        """A task without which the car must not move has failed."""
        with self._lock:
            self._faults[task] = (reason, text)

    def fault_ended(self, task: str) -> None:
        with self._lock:
            self._faults.pop(task, None)

    @property
    def faults(self) -> tuple[str, ...]:
        with self._lock:
            return tuple(text for _, text in self._faults.values())

    def _first_fault(self) -> StopReason:
        with self._lock:
            return next((reason for reason, _ in self._faults.values()), StopReason.NONE)

    def reason_to_stand(self, now_s: float, scan_age_s: float, odometry_age_s: float) -> StopReason:
        """`StopReason.NONE` when nothing speaks against moving. A loss does so until a while after its end."""
        late = (
            ("scanner", scan_age_s > self._scan_max_age_s),
            ("encoders or the IMU", odometry_age_s > self._odometry_max_age_s),
        )
        self._late = tuple(sensor for sensor, is_late in late if is_late)
        fault = self._first_fault()
        lost = StopReason.SENSOR_STALE if self._late and fault is StopReason.NONE else fault
        loss = self._losses.update(now_s, lost)
        reasons = (
            (loss, loss is not StopReason.NONE),
            (self._pause, now_s < self._pause_until_s),
            (StopReason.OVER_TEMPERATURE, self._heat.inside),
            (StopReason.LOW_BATTERY, self._battery.inside),
            (StopReason.COMMAND_SILENCE, not self._is_spoken_to(now_s)),
        )
        return next((reason for reason, stands in reasons if stands), StopReason.NONE)

    def has_lost(self, now_s: float, is_running: bool) -> bool:
        """Whether what the car waits for has been away for too long; only the time of a running mission counts."""
        if not is_running:
            self._losses.forgive(now_s)
        return is_running and self._losses.ends_mission(now_s)
