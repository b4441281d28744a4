"""Watches what the motion sensors say together: tilt, an encoder that has failed, a gyro that has drifted."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass

from robot_app.drivers.base import Count, DriveSetting, EncoderCount, ImuSample, OmniCount, OmniSetting, Setting
from robot_app.safety.bands import SafetyConfig
from robot_app.safety.gyro_jump import GyroJumpWatch
from robot_app.safety.omni_wheels import OmniWheelWatch
from robot_app.safety.tilt import TiltWatch
from robot_app.safety.wheels import WheelFault, WheelWatch
from shared.geometry.ackermann import CarGeometry
from shared.geometry.omni3 import OmniGeometry
from shared.messages import StopReason

STANDS_S = 1.5  # after a disagreement: 0.3 s until the car counts as standing, and 1.2 s for the gyro's bias
STALL_STANDS_S = 0.8  # before wheels that were held are driven again, from standing …
_HELD_AGAIN_S = 2.5  # … and when they are held again so soon, the mission ends
_MANY, _WITHIN_S = 3, 30.0
_OF_THE_GYRO = {WheelFault.TURNING, WheelFault.JUMPED, WheelFault.GYRO}


@dataclass(frozen=True, slots=True)
class Alarm:
    """`ends_mission`: else the car may go on once it has stood for `stands_s`. `text` is for the operator."""

    reason: StopReason
    text: str
    ends_mission: bool = True
    speed_mps: float = 0.0  # the last one that is known, where the encoders do not tell it any more
    stands_s: float = STANDS_S


class MotionWatch:
    """Asked only while a mission runs; call `forget` otherwise: whoever carries the robot may turn its wheels."""

    def __init__(self, config: SafetyConfig, body: CarGeometry | OmniGeometry, metres_per_tick: float) -> None:
        self._tilt = TiltWatch(config.tilt)
        self._jumps = GyroJumpWatch(config.gyro_jump)
        self._wheels: WheelWatch | OmniWheelWatch
        if isinstance(body, CarGeometry):
            self._wheels = WheelWatch(config.wheels, body.wheelbase_m, metres_per_tick)
        else:
            self._wheels = OmniWheelWatch(config.omni_wheels, body, metres_per_tick)
        self._apart_s: deque[float] = deque(maxlen=_MANY)
        self._held_s = -math.inf
        self._rests_until_s = -math.inf

    def forget(self) -> None:
        self._wheels.forget()
        self._jumps.forget()
        self._apart_s.clear()
        self._held_s = -math.inf

    def update(
        self,
        now_s: float,
        count: Count | None,
        imu: ImuSample | None,
        motion: tuple[float, float],
        applied: Setting | None,
    ) -> Alarm | None:
        """`motion`: how fast it rolls and turns, by the odometry; `applied` by the drive, None while it is cut."""
        if imu is not None and self._tilt.update(imu):
            return Alarm(StopReason.TILTED, "the robot is tilted")
        fault = self._fault(count, imu, motion, applied)
        if self.rests(now_s):
            self._jumps.forget()  # the gyro is learnt anew meanwhile
            return None
        if fault is None:
            return None
        self._wheels.forget()
        self._jumps.forget()
        return self._wheel_alarm(fault, now_s, self._wheels.speed_before_mps)

    def _fault(
        self, count: Count | None, imu: ImuSample | None, motion: tuple[float, float], applied: Setting | None
    ) -> WheelFault | None:
        speed_mps, yaw_rate_radps = motion
        if isinstance(self._wheels, WheelWatch) and isinstance(count, EncoderCount):
            setting = applied if isinstance(applied, DriveSetting) else None
            fault = self._wheels.update(count, yaw_rate_radps, speed_mps, setting)
            jumped = imu is not None and self._jumps.update(imu.stamp_s, imu.gyro_radps[2], speed_mps)
            return fault or (WheelFault.JUMPED if jumped else None)
        if isinstance(self._wheels, OmniWheelWatch) and isinstance(count, OmniCount):
            duties = applied if isinstance(applied, OmniSetting) else None
            return self._wheels.update(count, yaw_rate_radps, speed_mps, duties)
        return None

    def _wheel_alarm(self, fault: WheelFault, now_s: float, speed_before_mps: float) -> Alarm:
        if fault is WheelFault.SILENT:
            return self.stalled(now_s, speed_before_mps)
        if fault not in _OF_THE_GYRO:
            return Alarm(StopReason.ENCODER_FAULT, fault.value, speed_mps=speed_before_mps)
        self._rests_until_s = now_s + STANDS_S
        self._apart_s.append(now_s)
        again = len(self._apart_s) == _MANY and now_s - self._apart_s[0] < _WITHIN_S
        return Alarm(StopReason.SENSORS_DISAGREE, fault.value, ends_mission=again)

    def stalled(self, now_s: float, speed_mps: float) -> Alarm:
        """The wheels do not turn, though the motor pushes. `speed_mps`: how fast they may turn unseen."""
        again = now_s - self._held_s < _HELD_AGAIN_S
        self._held_s, self._rests_until_s = now_s, now_s + STALL_STANDS_S
        return Alarm(StopReason.STALLED, WheelFault.SILENT.value, again, speed_mps, STALL_STANDS_S)

    def rests(self, now_s: float) -> bool:
        """The car is to stand after an alarm."""
        return now_s < self._rests_until_s
