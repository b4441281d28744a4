"""Three H-bridges of the omnidirectional robot, each a PWM channel and two direction lines."""

from __future__ import annotations

import logging
from collections.abc import Callable
from contextlib import ExitStack
from functools import partial

from robot_app.drivers.base import DeviceError, OmniSetting, Setting
from robot_app.drivers.config import OmniWheelsConfig
from robot_app.drivers.gpio import GpioOutputs
from robot_app.drivers.guardian.guardian import Guardian
from robot_app.drivers.sysfs_pwm import SysfsPwm
from shared.runtime.clock import Clock

_log = logging.getLogger(__name__)
_NAMES = ("front right", "front left", "back")


class OmniDrive:
    """Opens with the motors cut. The loop on the encoders is closed by whoever sets the duties.

    As with the car, a guardian cuts the motors when the process is killed or hangs.
    """

    def __init__(self, config: OmniWheelsConfig, clock: Clock) -> None:
        self._config = config
        self._period_ns = round(1e9 / config.motor_hz)
        self._closed = False
        self._forward: list[bool | None] = [None] * len(config.wheels)
        with ExitStack() as opened:
            # The lines first: whoever has them drives, and a PWM channel can be opened by anybody.
            lines = tuple(line for wheel in config.wheels for line in (wheel.forward_line, wheel.reverse_line))
            self._direction = GpioOutputs("drive direction", config.gpio_chip, lines)
            opened.callback(self._direction.close)
            self._motors: list[SysfsPwm] = []
            for name, wheel in zip(_NAMES, config.wheels, strict=True):
                motor = SysfsPwm(f"{name} motor", config.pwm_chip, wheel.pwm_channel, self._period_ns, clock)
                opened.callback(motor.close)
                self._motors.append(motor)
            self._guardian = Guardian([motor.duty_file for motor in self._motors])
            opened.callback(self._guardian.close)
            self._devices = opened.pop_all()

    def set(self, setting: Setting) -> OmniSetting:
        """Returns what was applied after the limit of the duty."""
        if self._closed:
            raise DeviceError("drive: is closed")
        if not (isinstance(setting, OmniSetting) and setting.is_finite):
            raise DeviceError(f"drive: cannot apply {setting}")
        self._guardian.alive()
        limit = self._config.max_duty
        right, left, back = (max(-limit, min(limit, duty)) for duty in setting.duties)
        applied = OmniSetting((right, left, back))
        self._choose_directions(applied)
        for motor, duty in zip(self._motors, applied.duties, strict=True):
            motor.set_pulse_ns(round(abs(duty) * self._period_ns))
        return applied

    def stop(self) -> None:
        """Cut all motors by each of their inputs; one that fails does not keep the others from it."""
        self._forward = [None] * len(self._motors)
        if not self._closed:
            for motor in self._motors:
                self._try(partial(motor.set_pulse_ns, 0))
            self._try(lambda: self._direction.set(*[False] * 2 * len(self._motors)))

    def close(self) -> None:
        if not self._closed:
            self.stop()
            self._closed = True
            self._devices.close()

    def _choose_directions(self, setting: OmniSetting) -> None:
        """A motor without a duty keeps its direction; a bridge changes it without current."""
        wanted = list(self._forward)
        for i, (duty, wheel) in enumerate(zip(setting.duties, self._config.wheels, strict=True)):
            if duty != 0:
                wanted[i] = (duty > 0) != wheel.motor_reversed
        if wanted == self._forward:
            return
        for motor, before, after in zip(self._motors, self._forward, wanted, strict=True):
            if before is not after:
                motor.set_pulse_ns(0)
        self._direction.set(*(level for forward in wanted for level in (forward is True, forward is False)))
        self._forward = wanted

    @staticmethod
    def _try(action: Callable[[], None]) -> None:
        try:
            action()
        except DeviceError as error:
            _log.error("a motor may not have been cut: %s", error)
