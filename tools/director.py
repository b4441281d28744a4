"""Plays the operator of the demo mission: connect, start, observe once around, go to a goal, stop."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum
from typing import Protocol

from shared.messages import MissionState
from station_gui.model.view import LinkState, OperatorView

_CONNECT_TIMEOUT_S = 60.0
_SETTLE_S = 3.0  # the gyro's bias is learnt while the robot stands
_OBSERVE_TIMEOUT_S = 600.0
_GO_TIMEOUT_S = 120.0
_STOP_TIMEOUT_S = 10.0
_LOST_TIMEOUT_S = 15.0
_REPEAT_S = 2.0  # an order that has no effect is given again
_LINGER_S = 1.0


class Hands(Protocol):
    """How the director gives orders: through a station's model, or with real clicks in its window."""

    def connect(self) -> None: ...
    def start(self) -> None: ...
    def go_to(self, x_m: float, y_m: float) -> None: ...
    def stop(self) -> None: ...


class Step(Enum):
    CONNECT = "connecting"
    SETTLE = "standing still while the gyro's bias is learnt"
    START = "starting the observation"
    OBSERVE = "observing once around the room"
    GO = "going to the goal"
    STOP = "stopping"
    DONE = "done"


@dataclass(frozen=True, slots=True)
class Outcome:
    """`failure` is empty when everything was done."""

    failure: str
    began_s: float
    ended_s: float


class Director:
    """Step it a few times a second with the present view; tells `say` about each new step."""

    def __init__(self, hands: Hands, goals_m: tuple[tuple[float, float], ...], say: Callable[[str], None]) -> None:
        self._hands = hands
        self._goals = list(goals_m)
        self._say = say
        self._step = Step.CONNECT
        self._since_s: float | None = None
        self._ordered_s = -math.inf
        self._began_s = 0.0
        self._connected_s = 0.0
        self._goal_seen = False
        self._stopped = False
        self.outcome: Outcome | None = None

    def step(self, view: OperatorView) -> None:
        """Look at the view and do the next thing."""
        if self.outcome is not None:
            return
        now_s = view.time_s
        if self._since_s is None:
            self._since_s = self._began_s = now_s
            self._say(self._step.value)
        if failure := self._watch(view, now_s):
            self._end(failure, now_s)
            return
        self._act(view, now_s)

    def _act(self, view: OperatorView, now_s: float) -> None:
        acts = {
            Step.CONNECT: self._connect,
            Step.SETTLE: self._settle,
            Step.START: self._start,
            Step.OBSERVE: self._observe,
            Step.GO: self._go,
            Step.STOP: self._stop,
        }
        if self._step in acts:
            acts[self._step](view, now_s)

    def _connect(self, view: OperatorView, now_s: float) -> None:
        if view.link_state is LinkState.CONNECTED and view.telemetry is not None:
            self._next(Step.SETTLE, now_s)
        elif view.link_state is LinkState.DISCONNECTED:
            self._order(self._hands.connect, now_s)

    def _settle(self, _: OperatorView, now_s: float) -> None:
        if now_s - self._entered_s >= _SETTLE_S:
            self._next(Step.START, now_s)

    def _start(self, view: OperatorView, now_s: float) -> None:
        self._order(self._hands.start, now_s)
        if _state(view) is MissionState.OBSERVE:
            self._next(Step.OBSERVE, now_s)

    def _observe(self, view: OperatorView, now_s: float) -> None:
        if _state(view) is MissionState.COMMAND:
            self._next(Step.GO if self._goals else Step.STOP, now_s)

    @property
    def _entered_s(self) -> float:
        return self._since_s or 0.0

    def _go(self, view: OperatorView, now_s: float) -> None:
        goal = self._goals[0]
        if view.goal_m is not None:
            self._goal_seen = True
        elif self._goal_seen:  # reached, or given up
            self._goal_seen = False
            del self._goals[0]
            self._next(Step.GO if self._goals else Step.STOP, now_s)
        else:
            self._order(lambda: self._hands.go_to(*goal), now_s)

    def _stop(self, view: OperatorView, now_s: float) -> None:
        if _state(view) is MissionState.HALTED:
            self._stopped = True
        else:
            self._order(self._hands.stop, now_s)
        if self._stopped and now_s - self._entered_s >= _LINGER_S:
            self._end("", now_s)

    def _watch(self, view: OperatorView, now_s: float) -> str:
        limits = {
            Step.CONNECT: _CONNECT_TIMEOUT_S,
            Step.START: _STOP_TIMEOUT_S,
            Step.OBSERVE: _OBSERVE_TIMEOUT_S,
            Step.GO: _GO_TIMEOUT_S,
            Step.STOP: _STOP_TIMEOUT_S,
        }
        taken_s = now_s - self._entered_s
        if taken_s > limits.get(self._step, math.inf):
            return f"{self._step.value} took longer than {limits[self._step]:.0f} s"
        self._connected_s = now_s if view.link_state is LinkState.CONNECTED else self._connected_s
        if self._step is not Step.CONNECT and now_s - self._connected_s > _LOST_TIMEOUT_S:
            return "the link to the robot was lost and did not come back"
        telemetry = view.telemetry
        running = self._step in {Step.OBSERVE, Step.GO}
        if running and telemetry is not None and telemetry.state is MissionState.HALTED:
            return f"the robot has halted: {telemetry.stop_reason.name.lower().replace('_', ' ')}"
        return ""

    def _order(self, give: Callable[[], None], now_s: float) -> None:
        if now_s - self._ordered_s >= _REPEAT_S:
            self._ordered_s = now_s
            give()

    def _next(self, step: Step, now_s: float) -> None:
        self._step, self._since_s, self._ordered_s = step, now_s, -math.inf
        self._say(step.value)

    def _end(self, failure: str, now_s: float) -> None:
        self._step = Step.DONE
        self.outcome = Outcome(failure, self._began_s, now_s)
        self._say(failure or "done")


def _state(view: OperatorView) -> MissionState | None:
    return view.telemetry.state if view.telemetry is not None else None
