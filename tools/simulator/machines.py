"""What drives a robot in the physics: from a drive setting to the actuators, step by step."""

from __future__ import annotations

import math
from typing import Any, Protocol

import numpy as np

from robot_app.drivers.base import DriveSetting, OmniSetting, Setting
from shared.geometry.omni3 import WHEELS
from tools.simulator.engine import mujoco
from tools.simulator.mjcf import STEP_S, TRACTION_NS_PER_M, grip_n
from tools.simulator.powertrain import SteeringServo
from tools.simulator.scenario import Scenario


class Machine(Protocol):
    """One for each robot; the world holds its lock while it calls."""

    @property
    def steering_rad(self) -> float:
        """Where the wheels are steered to; 0 where none is."""
        ...

    def set(self, setting: Setting) -> Setting:
        """Returns what is applied after limits."""
        ...

    def cut(self) -> None: ...

    def before_step(self, data: Any, voltage_v: float) -> None:
        """`voltage_v`: of the battery now."""
        ...

    def wheel_angles_rad(self, data: Any) -> tuple[float, ...]:
        """How far each wheel with an encoder has turned forward."""
        ...

    def current_a(self, data: Any) -> tuple[float, float]:
        """Of the motors, and for what share of the time the battery carries it."""
        ...


def make_machine(scenario: Scenario, model: Any) -> Machine:
    return CarMachine(scenario, model) if scenario.robot == "car" else OmniMachine(scenario)


class CarMachine:
    """A servo at the front wheels and one motor at the rear ones."""

    def __init__(self, scenario: Scenario, model: Any) -> None:
        self._car = scenario.car
        self._nominal_v = scenario.battery.nominal_v
        self.servo = SteeringServo(scenario.car)
        self._duty = 0.0
        self._no_load_radps = scenario.car.no_load_speed_mps / scenario.car.wheel_radius_m
        self._rear = tuple(_joint_address(model, name) for name in ("rl_spin", "rr_spin"))

    @property
    def steering_rad(self) -> float:
        return self.servo.angle_rad

    def set(self, setting: Setting) -> DriveSetting:
        assert isinstance(setting, DriveSetting)
        limit = self._car.max_steering_rad
        applied = DriveSetting(max(-1.0, min(1.0, setting.duty)), max(-limit, min(limit, setting.steering_rad)))
        self._duty = applied.duty
        self.servo.target_rad = applied.steering_rad
        return applied

    def cut(self) -> None:
        """Duty 0: the bridge shorts the motor, which brakes the car. The servo stays where it is."""
        self._duty = 0.0

    def before_step(self, data: Any, voltage_v: float) -> None:
        if self.servo.step(STEP_S):
            data.ctrl[0], data.ctrl[1] = self.servo.wheel_angles_rad()
        data.ctrl[2] = self._duty * self._no_load_radps * voltage_v / self._nominal_v

    def wheel_angles_rad(self, data: Any) -> tuple[float, ...]:
        """Of the left and the right rear wheel."""
        return tuple(float(data.qpos[address]) for address in self._rear)

    def current_a(self, data: Any) -> tuple[float, float]:
        torque_nm = abs(float(data.actuator_force[2]))
        return torque_nm / self._car.stall_torque_nm * self._car.stall_current_a, self._duty


class OmniMachine:
    """Three motors, each with a wheel that pulls the robot along its own direction, as far as the floor holds it.

    The physics know the robot as a body on frictionless feet that three velocity servos pull at (SIMULATION, A4: exact,
    and 20 times as fast as real rollers); the wheels turn here, so that they can spin and lock. Each step is implicit:
    the wheel is so light that it follows the floor within a millisecond.
    """

    def __init__(self, scenario: Scenario) -> None:
        self._omni = o = scenario.omni
        self._nominal_v = scenario.battery.nominal_v
        self._grip_n = grip_n(o, scenario.floor_friction)
        self._damping = o.stall_torque_nm / (o.no_load_speed_mps / o.wheel_radius_m)
        self._duties = [0.0] * WHEELS
        self._speeds_radps = [0.0] * WHEELS
        self._angles_rad = [0.0] * WHEELS

    @property
    def steering_rad(self) -> float:
        return 0.0

    def set(self, setting: Setting) -> OmniSetting:
        assert isinstance(setting, OmniSetting)
        right, left, back = (max(-1.0, min(1.0, duty)) for duty in setting.duties)
        self._duties = [right, left, back]
        return OmniSetting((right, left, back))

    def cut(self) -> None:
        """Duty 0: the bridges short the motors, which brakes."""
        self._duties = [0.0] * WHEELS

    def before_step(self, data: Any, voltage_v: float) -> None:
        r, stall_nm = self._omni.wheel_radius_m, self._omni.stall_torque_nm * voltage_v / self._nominal_v
        for i, floor_mps in enumerate(data.actuator_velocity.tolist()):
            motor_nm = stall_nm * self._duties[i]
            speed = self._turned(i, motor_nm + r * TRACTION_NS_PER_M * floor_mps, r * r * TRACTION_NS_PER_M)
            pull_n = TRACTION_NS_PER_M * (speed * r - floor_mps)
            if abs(pull_n) > self._grip_n:
                speed = self._turned(i, motor_nm - r * math.copysign(self._grip_n, pull_n), 0.0)
            self._speeds_radps[i] = speed
            self._angles_rad[i] += speed * STEP_S
            data.ctrl[i] = speed * r

    def _turned(self, wheel: int, torque_nm: float, load: float) -> float:
        """Its speed after a step with this torque less `load` times the speed, motor and friction included."""
        inertia = self._omni.wheel_inertia_kgm2 / STEP_S
        whole = inertia + self._damping + load
        free = (inertia * self._speeds_radps[wheel] + torque_nm) / whole
        return math.copysign(max(abs(free) - self._omni.gear_friction_nm / whole, 0.0), free)

    def wheel_angles_rad(self, data: Any) -> tuple[float, ...]:
        """In the order of `OmniGeometry`."""
        return tuple(self._angles_rad)

    def current_a(self, data: Any) -> tuple[float, float]:
        torques_nm = np.abs(data.actuator_force) * self._omni.wheel_radius_m
        currents_a = torques_nm / self._omni.stall_torque_nm * self._omni.stall_current_a
        total_a = float(currents_a.sum())
        return total_a, float(currents_a @ np.abs(self._duties)) / max(total_a, 1e-9)


def _joint_address(model: Any, name: str) -> int:
    joint = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_JOINT, name)
    return int(model.jnt_qposadr[joint])
