"""The simulated room and car: steps the physics and lets the sensors look at each step."""

from __future__ import annotations

import math
import threading
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from robot_app.drivers.base import DriveSetting
from shared.geometry.se2 import Pose2
from tools.simulator.contacts import CollisionCounter
from tools.simulator.engine import mujoco
from tools.simulator.mjcf import STEP_S, mjcf
from tools.simulator.powertrain import Battery, SteeringServo
from tools.simulator.scenario import Scenario
from tools.simulator.track import Track

_POWER_EVERY = 10  # steps
_TRUTH_EVERY = 10  # steps: 50 Hz
_SETTLE_STEPS = 250  # the car finds its contacts with the floor before the mission begins
_RIGHT_REAR_SPIN, _LEFT_REAR_SPIN = "rr_spin", "rl_spin"


class StepObserver(Protocol):
    """A sensor that looks at the world after each step."""

    def after_step(self) -> None: ...


class World:
    """The room, the car in it, and the time.

    `moved` guards everything and is notified when the world has moved. Physics run from zero in steps of 2 ms;
    `time_s` is that time on the clock of the robot, `start_s` at the beginning.
    After a step the positions of bodies and sites, the sensors and the contacts are those of the step's beginning,
    `qpos` and `qvel` those of its end.
    """

    def __init__(self, scenario: Scenario, seed: int, start_s: float = 0.0) -> None:
        self.scenario = scenario
        self.seed = seed
        self.moved = threading.Condition(threading.RLock())
        self.model: Any = mujoco.MjModel.from_xml_string(mjcf(scenario))
        self.data: Any = mujoco.MjData(self.model)
        self.steps = 0
        self.truth = Track(scenario.start.room_from_robot)
        self.collisions = CollisionCounter(self.model)
        self.servo = SteeringServo(scenario.car)
        self.battery = Battery(scenario.battery)
        self.slipped_s = 0.0  # real time that the world stood still because the machine was too slow
        self._offset_s = start_s
        self._duty = 0.0
        self._no_load_radps = scenario.car.no_load_speed_mps / scenario.car.wheel_radius_m
        self._observers: list[StepObserver] = []
        self._left, self._right = self._joint_address(_LEFT_REAR_SPIN), self._joint_address(_RIGHT_REAR_SPIN)
        self._settle()

    def random(self, device: str) -> np.random.Generator:
        """A generator for one device: what another device draws does not change its numbers."""
        return np.random.default_rng([self.seed, *device.encode()])

    def add_observer(self, observer: StepObserver) -> None:
        self._observers.append(observer)

    @property
    def elapsed_s(self) -> float:
        """Physical time since the beginning."""
        return self.steps * STEP_S

    @property
    def time_s(self) -> float:
        return self.elapsed_s + self._offset_s

    def clock_time_s(self, elapsed_s: float) -> float:
        return elapsed_s + self._offset_s

    def advance_to(self, time_s: float) -> None:
        """Step until the next step would pass `time_s` on the robot's clock."""
        with self.moved:
            wanted = math.floor((time_s - self._offset_s) / STEP_S + 1e-6)
            while self.steps < wanted:
                self._step()
            self.moved.notify_all()

    def set_clock(self, time_s: float) -> None:
        """Say what time it is on the robot's clock, before the world moves for the first time."""
        with self.moved:
            assert self.steps == 0, "the world has moved already"
            self._offset_s = time_s

    def stand_still(self, seconds: float) -> None:
        """Let the clock run on without the world."""
        with self.moved:
            self._offset_s += seconds
            self.slipped_s += seconds

    def set_drive(self, setting: DriveSetting) -> DriveSetting:
        """Returns what is applied after limits."""
        limit = self.scenario.car.max_steering_rad
        applied = DriveSetting(max(-1.0, min(1.0, setting.duty)), max(-limit, min(limit, setting.steering_rad)))
        with self.moved:
            self._duty = applied.duty
            self.servo.target_rad = applied.steering_rad
        return applied

    def cut_motor(self) -> None:
        """Duty 0: the bridge shorts the motor, which brakes the car. The servo stays where it is."""
        with self.moved:
            self._duty = 0.0

    def room_from_robot(self) -> Pose2:
        """The true pose now."""
        x, y, _, qw, qx, qy, qz = self.data.qpos[:7].tolist()
        return Pose2(x, y, math.atan2(2 * (qw * qz + qx * qy), 1 - 2 * (qy * qy + qz * qz)))

    def speed_mps(self) -> float:
        """True forward speed now."""
        theta = self.room_from_robot().theta_rad
        return float(self.data.qvel[0]) * math.cos(theta) + float(self.data.qvel[1]) * math.sin(theta)

    def wheel_angles_rad(self) -> tuple[float, float]:
        """How far the left and the right rear wheel have turned forward."""
        return float(self.data.qpos[self._left]), float(self.data.qpos[self._right])

    def camera_state(self) -> NDArray[np.float64]:
        """(nq,): all that an image of this moment depends on."""
        state: NDArray[np.float64] = self.data.qpos.copy()
        return state

    def place(self, room_from_robot: Pose2) -> None:
        """Put the car somewhere, at rest."""
        with self.moved:
            half = room_from_robot.theta_rad / 2
            self.data.qpos[:2] = room_from_robot.x_m, room_from_robot.y_m
            self.data.qpos[3:7] = math.cos(half), 0.0, 0.0, math.sin(half)
            self.data.qvel[:] = 0.0
            mujoco.mj_forward(self.model, self.data)

    def _joint_address(self, name: str) -> int:
        joint = mujoco.mj_name2id(self.model, mujoco.mjtObj.mjOBJ_JOINT, name)
        return int(self.model.jnt_qposadr[joint])

    def _settle(self) -> None:
        self.place(self.scenario.start.room_from_robot)
        mujoco.mj_step(self.model, self.data, _SETTLE_STEPS)
        self.place(self.scenario.start.room_from_robot)
        self.truth.record(self.time_s, self.room_from_robot())

    def _step(self) -> None:
        if self.servo.step(STEP_S):
            self.data.ctrl[0], self.data.ctrl[1] = self.servo.wheel_angles_rad()
        if self.steps % _POWER_EVERY == 0:
            self._update_battery()
        nominal_v = self.scenario.battery.nominal_v
        self.data.ctrl[2] = self._duty * self._no_load_radps * self.battery.voltage_v / nominal_v
        began_s = self.time_s
        mujoco.mj_step(self.model, self.data)
        self.steps += 1
        self.collisions.look(self.data, began_s)
        if self.steps % _TRUTH_EVERY == 0:
            self.truth.record(self.time_s, self.room_from_robot())
        for observer in self._observers:
            observer.after_step()

    def _update_battery(self) -> None:
        car = self.scenario.car
        torque_nm = abs(float(self.data.actuator_force[2]))
        current_a = torque_nm / car.stall_torque_nm * car.stall_current_a
        self.battery.step(_POWER_EVERY * STEP_S, current_a, self._duty)
