"""Gyroscope and accelerometer of the LSM9DS1."""

from __future__ import annotations

import math

import numpy as np

from robot_app.drivers.base import ImuSample
from tools.simulator.mailbox import Mailbox
from tools.simulator.mjcf import STEP_S
from tools.simulator.world import World

_G_MPS2 = 9.80665
_GYRO_LIMIT_DPS, _ACCELERATION_LIMIT_G = 245.0, 2.0


class SimulatedImu:
    """Samples the physics at its own rate, with noise, bias and the converter's steps."""

    def __init__(self, world: World) -> None:
        self._world = world
        p = self._parameters = world.scenario.imu
        self._random = world.random("imu")
        self.samples: Mailbox[ImuSample] = Mailbox(world.moved)
        self._every = round(1 / (p.rate_hz * STEP_S))
        self._phase = int(self._random.integers(self._every))
        root_bandwidth = math.sqrt(p.rate_hz / 2)
        self._gyro_sigma_radps = math.radians(p.gyro_noise_dps_rthz) * root_bandwidth
        self._walk_sigma_radps = math.radians(p.gyro_walk_dps_rts) / math.sqrt(p.rate_hz)
        self._acceleration_sigma_mps2 = p.acceleration_noise_mg_rthz * 1e-3 * _G_MPS2 * root_bandwidth
        self.gyro_bias_radps = math.radians(p.gyro_bias_dps) * self._random.standard_normal(3)
        self._acceleration_bias_mps2 = p.acceleration_bias_mg * 1e-3 * _G_MPS2 * self._random.standard_normal(3)

    def after_step(self) -> None:
        if self._world.steps % self._every != self._phase:
            return
        p, true = self._parameters, self._world.data.sensordata
        noise = self._random.standard_normal((3, 3))
        self.gyro_bias_radps = self.gyro_bias_radps + self._walk_sigma_radps * noise[0]
        gyro = true[3:6] + self.gyro_bias_radps + self._gyro_sigma_radps * noise[1]
        acceleration = true[:3] + self._acceleration_bias_mps2 + self._acceleration_sigma_mps2 * noise[2]
        gx, gy, gz = _digitised(gyro, math.radians(p.gyro_step_dps), math.radians(_GYRO_LIMIT_DPS))
        step_mps2 = p.acceleration_step_mg * 1e-3 * _G_MPS2
        ax, ay, az = _digitised(acceleration, step_mps2, _ACCELERATION_LIMIT_G * _G_MPS2)
        # The physics computed these at the beginning of the step.
        stamp_s = self._world.time_s - STEP_S
        self.samples.put(ImuSample(stamp_s, (gx, gy, gz), (ax, ay, az)))


def _digitised(values: np.ndarray[tuple[int], np.dtype[np.float64]], step: float, limit: float) -> list[float]:
    rounded: list[float] = np.clip(np.round(values / step) * step, -limit, limit).tolist()
    return rounded
