"""The simulated room and car: steps the physics and lets the sensors look at each step."""

from __future__ import annotations

import math
import threading
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from robot_app.drivers.base import Setting
from shared.geometry.se2 import Pose2
from tools.simulator.contacts import CollisionCounter
from tools.simulator.engine import mujoco
from tools.simulator.machines import make_machine
from tools.simulator.mjcf import STEP_S, mjcf
from tools.simulator.powertrain import Battery
from tools.simulator.scenario import Scenario
from tools.simulator.track import Track

_POWER_EVERY = 10  # steps
_TRUTH_EVERY = 10  # steps: 50 Hz
_SETTLE_STEPS = 250  # the car finds its contacts with the floor before the mission begins


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
        self._machine = make_machine(scenario, self.model)
        self.battery = Battery(scenario.battery)
        self.slipped_s = 0.0  # real time that the world stood still because the machine was too slow
        self._offset_s = start_s
        self._observers: list[StepObserver] = []
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

    def set_drive(self, setting: Setting) -> Setting:
        """Returns what is applied after limits."""
        with self.moved:
            return self._machine.set(setting)

    def cut_motor(self) -> None:
        with self.moved:
            self._machine.cut()

    def room_from_robot(self) -> Pose2:
        """The true pose now."""
        x, y, _, qw, qx, qy, qz = self.data.qpos[:7].tolist()
        return Pose2(x, y, math.atan2(2 * (qw * qz + qx * qy), 1 - 2 * (qy * qy + qz * qz)))

    def speed_mps(self) -> float:
        """True forward speed now."""
        theta = self.room_from_robot().theta_rad
        return float(self.data.qvel[0]) * math.cos(theta) + float(self.data.qvel[1]) * math.sin(theta)

    def motor_command_radps(self) -> float:
        """How fast the car's wheels would turn without load by the duty as it is now, positive forward."""
        return float(self.data.ctrl[2])

    def wheel_angles_rad(self) -> tuple[float, ...]:
        """How far each wheel with an encoder has turned forward: of a car the left and the right rear one."""
        return self._machine.wheel_angles_rad(self.data)

    @property
    def steering_rad(self) -> float:
        """Where the servo stands."""
        return self._machine.steering_rad

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

    def _settle(self) -> None:
        self.place(self.scenario.start.room_from_robot)
        mujoco.mj_step(self.model, self.data, _SETTLE_STEPS)
        self.place(self.scenario.start.room_from_robot)
        self.truth.record(self.time_s, self.room_from_robot())

    def _step(self) -> None:
        if self.steps % _POWER_EVERY == 0:
            self._update_battery()
        self._machine.before_step(self.data, self.battery.voltage_v)
        began_s = self.time_s
        mujoco.mj_step(self.model, self.data)
        self.steps += 1
        self.collisions.look(self.data, began_s)
        if self.steps % _TRUTH_EVERY == 0:
            self.truth.record(self.time_s, self.room_from_robot())
        for observer in self._observers:
            observer.after_step()

    def _update_battery(self) -> None:
        current_a, share = self._machine.current_a(self.data)
        self.battery.step(_POWER_EVERY * STEP_S, current_a, share)
