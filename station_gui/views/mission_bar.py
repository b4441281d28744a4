"""The bar on top: which robot, where the mission stands, what that means, and the emergency stop."""

from __future__ import annotations

from PySide6.QtCore import Qt, Signal
from PySide6.QtWidgets import QFrame, QHBoxLayout, QPushButton, QVBoxLayout

from shared.messages import MissionState
from station_gui.mapping.snapshot import Tracking
from station_gui.model.view import LinkState, OperatorView
from station_gui.qt import theme
from station_gui.qt.widgets import ElidedLabel, label, set_property
from station_gui.views import words
from station_gui.views.commands import allowed


class MissionBar(QFrame):
    """The state of the mission that holds is lit."""

    emergency_asked = Signal()

    def __init__(self, stale_after_s: float) -> None:
        super().__init__()
        self.setProperty("role", "panel")
        self._stale_after_s = stale_after_s
        self.robot = ElidedLabel("title")
        self.sentence = ElidedLabel("sentence")
        self.steps = {state: label(name, "step") for state, name in words.STATE_NAMES.items()}
        self.emergency = QPushButton("EMERGENCY STOP")
        self.emergency.setProperty("role", "emergency")
        self.emergency.setToolTip("Cuts the drive at once. Keys: Space or Esc")
        self.emergency.setFocusPolicy(Qt.FocusPolicy.NoFocus)
        self.emergency.setMinimumHeight(46)
        self.emergency.pressed.connect(self.emergency_asked)  # not on release: it must not wait for the finger
        self._lay_out()

    def show_view(self, view: OperatorView) -> None:
        self.robot.show_text(_robot_text(view))
        self.sentence.show_text(words.mission_sentence(view, self._stale_after_s))
        set_property(self.sentence, "tone", self._tone(view))
        state = shown_state(view)
        for step, chip in self.steps.items():
            set_property(chip, "active", step.name.lower() if step is state else "")
        self.emergency.setEnabled(allowed(view, self._stale_after_s).emergency)

    def _tone(self, view: OperatorView) -> str:
        if view.link_state is LinkState.LOST:
            return "bad"
        telemetry = view.telemetry
        if view.link_state is not LinkState.CONNECTED or telemetry is None:
            return ""
        if not view.telemetry_age_s <= self._stale_after_s or telemetry.faults:
            return "warning"
        lost = view.snapshot is not None and view.snapshot.tracking is not Tracking.LOCATED
        return "warning" if telemetry.stop_reason or lost else ""

    def _lay_out(self) -> None:
        row = QHBoxLayout(self)
        row.setContentsMargins(theme.MARGIN_PX, theme.SPACING_PX, theme.MARGIN_PX, theme.SPACING_PX)
        row.setSpacing(theme.SPACING_PX)
        for index, chip in enumerate(self.steps.values()):
            if index:
                row.addWidget(label("›", "muted"))
            row.addWidget(chip)
        row.addSpacing(theme.SPACING_PX)
        texts = QVBoxLayout()
        texts.setSpacing(2)
        texts.addWidget(self.robot)
        texts.addWidget(self.sentence)
        row.addLayout(texts, 1)
        row.addWidget(self.emergency)


def shown_state(view: OperatorView) -> MissionState | None:
    """The mission's state as last heard; None when no robot is connected."""
    if view.link_state is LinkState.DISCONNECTED or view.telemetry is None:
        return None
    return view.telemetry.state


def _robot_text(view: OperatorView) -> str:
    if view.robot is None or view.link_state is LinkState.DISCONNECTED:
        return "NO ROBOT"
    return f"{view.robot.robot_name.upper()}  ·  software {view.robot.software_version}"
