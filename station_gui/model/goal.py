"""Brings the robot to a point of the map: plans, sends the path, follows it up as the map moves under it."""

from __future__ import annotations

import math
import threading
from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from shared.geometry.se2 import Pose2
from shared.messages import Command, Drive, GoTo, MissionState, Telemetry
from station_gui.mapping.snapshot import MapSnapshot
from station_gui.model.goal_figures import GoalFigures, GoalState
from station_gui.model.journal import Journal
from station_gui.model.view import Severity
from station_gui.planning.path_planner import PathPlanner, Plan, PlanningError
from station_gui.planning.rehearsal import rehearse

_ARRIVED_M = 0.08
_RESEND_M = 0.02  # the path is sent again when the map has moved its end so far in the odom frame
_STANDS_S = 1.5  # after so long without following, the robot has ended the path
_STANDS_RADIO_S = 5.0  # the same over LoRa, where a path takes a while to get there
_REPLAN_EVERY_S = 1.5
_TRIES = 4
_LOOK_AHEAD_POINTS = 12


class GoalKeeper:
    """One goal at a time. `step` is called by one thread, the rest by any."""

    def __init__(self, planner: PathPlanner, send: Callable[[Command], bool], journal: Journal) -> None:
        self._planner = planner
        self._send = send
        self._journal = journal
        self._lock = threading.Lock()
        self._asked: tuple[float, float] | None = None
        self._goal: tuple[float, float] | None = None
        self._plan: Plan | None = None
        self._goal_id = 0
        self._sent_end: NDArray[np.float64] | None = None
        self._tries = 0
        self._at = 0  # the point of the path that the robot has come to
        self._planned_s = -math.inf
        self._followed_s = -math.inf
        self._stands_s = _STANDS_S
        self._figures: GoalFigures | None = None

    def use_planner(self, planner: PathPlanner) -> None:
        """From the next plan on: another robot is there."""
        self._planner = planner

    @property
    def figures(self) -> GoalFigures | None:
        """Of the goal that was asked for last, None before the first."""
        return self._figures

    @property
    def goal_m(self) -> tuple[float, float] | None:
        return self._goal

    @property
    def path_m(self) -> NDArray[np.float64] | None:
        """(N, 2), map frame."""
        plan = self._plan
        return None if plan is None else plan.path[:, :2]

    def ask(self, x_m: float, y_m: float) -> None:
        with self._lock:
            self._asked = (x_m, y_m)

    def forget(self) -> None:
        with self._lock:
            self._asked = None
            self._end(GoalState.FORGOTTEN)

    def step(self, snapshot: MapSnapshot | None, telemetry: Telemetry | None, slow_link: bool = False) -> None:
        """Do what is due for the goal. The first time of all it makes the planning ready, which takes a moment."""
        rehearse()
        self._stands_s = _STANDS_RADIO_S if slow_link else _STANDS_S
        with self._lock:
            asked, self._asked = self._asked, None
        if asked is not None:
            self._begin(asked, snapshot, telemetry)
        elif self._goal is not None and snapshot is not None and telemetry is not None:
            self._follow_up(snapshot, telemetry)

    def _begin(self, goal: tuple[float, float], snapshot: MapSnapshot | None, telemetry: Telemetry | None) -> None:
        self._end(GoalState.FORGOTTEN)
        number = 1 if self._figures is None else self._figures.number + 1
        self._figures = GoalFigures(number, goal, GoalState.GOING)
        if snapshot is None or telemetry is None:
            self._refuse("there is no map yet")
        elif telemetry.state is not MissionState.COMMAND:
            self._refuse("this is possible once the observation has finished")
        elif not snapshot.located:
            self._refuse("this is possible once the robot's place in the map is known")
        else:
            self._goal, self._tries = goal, 0
            self._goal_id += 1
            self._plan_and_send(snapshot, telemetry)

    def _refuse(self, reason: str) -> None:
        figures = self._figures
        assert figures is not None
        self._journal.add(Severity.WARNING, f"go to {figures.goal_m[0]:.2f}, {figures.goal_m[1]:.2f}: {reason}")
        self._end(GoalState.REFUSED, reason)

    def _give_up(self, reason: str) -> None:
        self._journal.add(Severity.WARNING, f"goal given up: {reason}")
        self._end(GoalState.GIVEN_UP, reason)
        self._send(Drive(0.0, 0.0))  # whoever takes the wheel ends the path

    def _end(self, state: GoalState, reason: str = "") -> None:
        self._goal = None
        self._plan = None
        if self._figures is not None and self._figures.state is GoalState.GOING:
            self._figures = replace(self._figures, state=state, reason=reason)

    def _follow_up(self, snapshot: MapSnapshot, telemetry: Telemetry) -> None:
        if telemetry.state is not MissionState.COMMAND:
            self.forget()
            return
        if not snapshot.located:
            self._give_up("the robot's place in the map is no longer known")
            return
        now_s = telemetry.stamp_s
        if telemetry.following_goal == self._goal_id:
            self._followed_s = now_s
        elif now_s - self._followed_s > self._stands_s:
            self._ended(snapshot, telemetry)
            return
        plan = self._plan
        if plan is None or now_s - self._planned_s < _REPLAN_EVERY_S:
            return
        self._at = _nearest_ahead(plan.path, self._at, snapshot.map_from_robot)
        if not self._planner.path_is_free(plan.path[self._at :], snapshot.grid, snapshot.map_from_robot):
            self._journal.add(Severity.INFO, "something new stands in the way: planning again")
            self._plan_and_send(snapshot, telemetry)
        elif self._has_moved(plan, snapshot):
            self._send_path(plan, snapshot)

    def _ended(self, snapshot: MapSnapshot, telemetry: Telemetry) -> None:
        goal = self._goal
        if goal is None:
            return
        pose = snapshot.map_from_robot
        error_m = math.hypot(pose.x_m - goal[0], pose.y_m - goal[1])
        if error_m <= _ARRIVED_M:
            self._journal.add(Severity.INFO, f"goal reached, {100 * error_m:.0f} cm off by the map")
            self._end(GoalState.REACHED)
        elif self._tries < _TRIES:
            self._plan_and_send(snapshot, telemetry)
        else:
            self._give_up(f"{100 * error_m:.0f} cm away after {_TRIES} tries")

    def _plan_and_send(self, snapshot: MapSnapshot, telemetry: Telemetry) -> None:
        goal = self._goal
        if goal is None:
            return
        self._tries += 1
        self._planned_s = self._followed_s = telemetry.stamp_s
        try:
            plan = self._planner.plan(snapshot.grid, snapshot.map_from_robot, goal)
        except PlanningError as refusal:
            if self._plan is None:
                self._refuse(str(refusal))
            else:
                self._give_up(str(refusal))
            return
        with self._lock:
            if self._goal != goal:  # forgotten while the plan was made
                return
            self._plan, self._at = plan, 0
            self._figures = self._told(plan)
        self._journal.add(
            Severity.INFO,
            f"going to {goal[0]:.2f}, {goal[1]:.2f}: {plan.length_m:.1f} m, "
            f"{100 * plan.clearance_m:.0f} cm clear, planned in {1000 * plan.planning_s:.0f} ms",
        )
        self._send_path(plan, snapshot)

    def _told(self, plan: Plan) -> GoalFigures:
        figures = self._figures
        assert figures is not None
        return replace(
            figures,
            length_m=plan.length_m,
            clearance_m=plan.clearance_m,
            planning_s=plan.planning_s,
            slowest_s=max(figures.slowest_s, plan.planning_s),
            plans=figures.plans + 1,
        )

    def _has_moved(self, plan: Plan, snapshot: MapSnapshot) -> bool:
        end = _in_odom(plan.path[-1:], snapshot.map_from_odom)[0]
        return self._sent_end is None or math.dist(end[:2], self._sent_end[:2]) > _RESEND_M

    def _send_path(self, plan: Plan, snapshot: MapSnapshot) -> None:
        rest = plan.path[min(self._at, len(plan.path) - 2) :]
        path = _in_odom(rest, snapshot.map_from_odom)
        with self._lock:
            if self._plan is not plan:  # forgotten meanwhile
                return
            self._sent_end = path[-1]
            self._send(GoTo(self._goal_id, path.astype(np.float32)))


def _in_odom(path: NDArray[np.float64], map_from_odom: Pose2) -> NDArray[np.float64]:
    """(N, 3) poses from the map frame to the odom frame."""
    odom_from_map = map_from_odom.inverse()
    moved = np.empty_like(path)
    moved[:, :2] = odom_from_map.apply(path[:, :2])
    moved[:, 2] = path[:, 2] + odom_from_map.theta_rad
    return moved


def _nearest_ahead(path: NDArray[np.float64], at: int, map_from_robot: Pose2) -> int:
    """How far along the path the robot is; a path may cross itself, so only what comes next is looked at."""
    ahead = path[at : at + _LOOK_AHEAD_POINTS]
    return at + int(np.argmin(np.hypot(ahead[:, 0] - map_from_robot.x_m, ahead[:, 1] - map_from_robot.y_m)))
