"""`calibrate motor`: which way it turns. The wheels are in the air."""

from __future__ import annotations

from robot_app.calibrate.change import Change
from robot_app.calibrate.guide import CalibrationError, Guide
from robot_app.calibrate.sampling import pause
from robot_app.config import RobotConfig
from robot_app.drivers.base import Drive, DriveSetting, EncoderCount, Encoders
from shared.runtime.clock import Clock

_TICK_S = 0.02
_MOST_DUTY, _DUTY_PER_S = 0.35, 0.1
_ENOUGH_TICKS = 20


def calibrate_motor(drive: Drive, encoders: Encoders, config: RobotConfig, guide: Guide, clock: Clock) -> list[Change]:
    """Raises `CalibrationError` when the wheels do not turn, or not both the same way."""
    guide.say("Calibrate the encoders first. Put the car on a box so that no wheel touches anything.")
    if not guide.agree("THE REAR WHEELS WILL TURN, slowly at first. Are they in the air?"):
        raise CalibrationError("nothing turned and nothing was changed")
    try:
        left, right = _turn(drive, encoders, clock)
    finally:
        drive.stop()
    if left * right <= 0 or min(abs(left), abs(right)) < _ENOUGH_TICKS / 4:
        raise CalibrationError(f"left counted {left:+d} ticks and right {right:+d}: robot-app calibrate encoders first")
    is_reversed = config.devices.drive.motor_reversed
    certainty = f"left {left:+d} ticks, right {right:+d}"
    return [Change("devices.drive.motor_reversed", is_reversed, is_reversed ^ (left < 0), certainty)]


def _turn(drive: Drive, encoders: Encoders, clock: Clock) -> tuple[int, int]:
    start = encoders.read(0.0)
    duty = 0.0
    while duty < _MOST_DUTY:
        duty += _DUTY_PER_S * _TICK_S
        drive.set(DriveSetting(duty, 0.0))
        pause(clock, _TICK_S)
        count = encoders.read(0.0)
        if not (isinstance(start, EncoderCount) and isinstance(count, EncoderCount)):
            raise CalibrationError("the encoders say nothing")
        left, right = count.left - start.left, count.right - start.right
        if max(abs(left), abs(right)) >= _ENOUGH_TICKS:
            return left, right
    raise CalibrationError(
        f"nothing turned up to duty {_MOST_DUTY:g}: is the bridge supplied, are its three wires connected?"
    )
