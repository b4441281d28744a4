"""Steering servo and H-bridge of the car: two hardware PWM channels and two direction lines."""

from __future__ import annotations

import contextlib
import logging
from collections.abc import Callable
from contextlib import ExitStack

from robot_app.drivers.base import DeviceError, DriveSetting, Setting
from robot_app.drivers.config import DriveConfig
from robot_app.drivers.gpio import GpioOutputs
from robot_app.drivers.guardian.guardian import Guardian, Will
from robot_app.drivers.sysfs_pwm import SysfsPwm
from shared.geometry.ackermann import CarGeometry
from shared.runtime.clock import Clock

_log = logging.getLogger(__name__)
_SERVO_PERIOD_NS = 20_000_000  # 50 Hz
_ROLLS_S = 0.12  # the speed of a car follows its duty with this delay: so does what it takes to brake it
_AGAINST = 1.2  # duty against the way, of the one along it: a car that stops twice as fast as ours is sent back by 2 cm
_LONGEST_STEP_S = 0.5


class AckermannDrive:
    """Opens with the motor cut and the wheels straight.

    The kernel's PWM goes on when the process is killed or hangs: `stop` cannot run then, and the guardian cuts the
    motor and brakes. A setting therefore holds for 0.06 s.
    """

    def __init__(self, config: DriveConfig, car: CarGeometry, clock: Clock) -> None:
        self._config = config
        self._max_steering_rad = car.max_steering_rad
        self._centre_us = config.servo_centre_us + config.servo_trim_us
        self._motor_period_ns = round(1e9 / config.motor_hz)
        self._closed = False
        self._told: set[str] = set()
        self._is_forward: bool | None = None
        self._clock = clock
        self._pushed = 0.0  # smoothed duty, in place of the speed, which nobody tells a drive
        self._pushed_s = clock.now_s()
        with ExitStack() as opened:
            # The lines first: whoever has them drives, and a PWM channel can be opened by anybody.
            lines = (config.forward_line, config.reverse_line)
            self._direction = GpioOutputs("drive direction", config.gpio_chip, lines)
            opened.callback(self._direction.close)
            self._motor = SysfsPwm("drive motor", config.pwm_chip, config.motor_channel, self._motor_period_ns, clock)
            opened.callback(self._motor.close)
            self._servo = SysfsPwm("drive servo", config.pwm_chip, config.servo_channel, _SERVO_PERIOD_NS, clock)
            opened.callback(self._servo.close)
            self._guardian = Guardian([self._motor.duty_file], self._direction.file_descriptor)
            opened.callback(self._guardian.close)
            self._steer(0.0)
            self._devices = opened.pop_all()

    def set(self, setting: Setting) -> DriveSetting:
        """Returns what was applied after the limits of duty, steering and servo."""
        if self._closed:
            raise DeviceError("drive: is closed")
        if not (isinstance(setting, DriveSetting) and setting.is_finite):
            raise DeviceError(f"drive: cannot apply {setting}")
        limit = self._config.max_duty
        duty = max(-limit, min(limit, setting.duty))
        self._guardian.alive(self._will(duty))
        steering_rad = self._steer(setting.steering_rad)
        self._turn_motor(duty)
        return DriveSetting(duty, steering_rad)

    def stop(self) -> None:
        """Cut the motor by each of its two inputs; one that fails does not keep the other from it."""
        self._is_forward = None
        self._pushed = 0.0
        if not self._closed:
            with contextlib.suppress(DeviceError):  # who sets the motor next hears of it
                self._guardian.alive()  # a car that was cut on purpose is not braked
            self._try(lambda: self._motor.set_pulse_ns(0))
            self._try(lambda: self._direction.set(False, False))

    def close(self) -> None:
        if not self._closed:
            self.stop()
            self._closed = True
            self._devices.close()

    def _steer(self, wanted_rad: float) -> float:
        c = self._config
        wanted_rad = max(-self._max_steering_rad, min(self._max_steering_rad, wanted_rad))
        pulse_us = self._centre_us + c.servo_us_per_rad * wanted_rad
        pulse_us = max(c.servo_min_us, min(c.servo_max_us, pulse_us))
        self._servo.set_pulse_ns(round(pulse_us * 1000))
        return (pulse_us - self._centre_us) / c.servo_us_per_rad

    def _will(self, duty: float) -> Will:
        """As hard against the way as it was pushed along it."""
        now_s = self._clock.now_s()
        step_s = min(max(now_s - self._pushed_s, 0.0), _LONGEST_STEP_S)
        self._pushed_s = now_s
        self._pushed += (duty - self._pushed) * step_s / (step_s + _ROLLS_S)
        against = max(-self._config.max_duty, min(self._config.max_duty, -_AGAINST * self._pushed))
        return Will(round(abs(against) * self._motor_period_ns), self._levels(against))

    def _levels(self, duty: float) -> tuple[bool, bool]:
        is_forward = (duty > 0) != self._config.motor_reversed
        return is_forward, not is_forward

    def _turn_motor(self, duty: float) -> None:
        if duty == 0:
            self._motor.set_pulse_ns(0)
            return
        levels = self._levels(duty)
        if levels[0] is not self._is_forward:
            self._motor.set_pulse_ns(0)  # the bridge changes its direction without current
        self._direction.set(*levels)  # each time: the guardian may have turned them round meanwhile
        self._is_forward = levels[0]
        self._motor.set_pulse_ns(round(abs(duty) * self._motor_period_ns))

    def _try(self, action: Callable[[], None]) -> None:
        try:
            action()
        except DeviceError as error:
            if str(error) not in self._told:  # it is cut again with each tick
                _log.error("the motor may not have been cut: %s", error)
            self._told.add(str(error))
