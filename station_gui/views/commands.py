"""The command buttons, and when which of them makes sense."""

from __future__ import annotations

from dataclasses import dataclass

from PySide6.QtCore import Qt, Signal
from PySide6.QtWidgets import QGridLayout, QPushButton

from shared.messages import MissionState
from station_gui.model.view import LinkState, OperatorView
from station_gui.qt.widgets import ElidedLabel, Panel


@dataclass(frozen=True, slots=True)
class Allowed:
    """What the operator may ask for now."""

    start: bool = False
    stop: bool = False
    emergency: bool = False
    go_to: bool = False
    drive: bool = False


def allowed(view: OperatorView, stale_after_s: float) -> Allowed:
    """What moves the robot needs fresh news of it; what stops it does not."""
    if view.link_state is LinkState.DISCONNECTED:
        return Allowed()
    connected = view.link_state is LinkState.CONNECTED
    telemetry = view.telemetry
    if not connected or telemetry is None or not view.telemetry_age_s <= stale_after_s:
        return Allowed(stop=True, emergency=True)  # both wait for a link that is lost
    state = telemetry.state
    return Allowed(
        start=state in {MissionState.IDLE, MissionState.HALTED},
        stop=state is not MissionState.HALTED,
        emergency=True,
        go_to=state is MissionState.COMMAND and view.snapshot is not None and view.snapshot.located,
        drive=state in {MissionState.OBSERVE, MissionState.COMMAND},
    )


class CommandPanel(Panel):
    """Start, stop, go to, drive by hand."""

    start_asked = Signal()
    stop_asked = Signal()
    goal_mode_changed = Signal(bool)
    drive_mode_changed = Signal(bool)

    def __init__(self, stale_after_s: float) -> None:
        super().__init__("Mission")
        self._stale_after_s = stale_after_s
        self.start = _button("Start observation", "The robot goes round the room by itself and maps it")
        self.start.setProperty("role", "primary")
        self.stop = _button("Stop", "End the mission; the robot stands still until the next start")
        self.stop.setProperty("role", "stop")
        self.go_to = _button("Go to…", "Then click on the map; a right click on the map does it at any time")
        self.drive = _button("Drive by hand", "Use the pad, the arrow keys or W A S D")
        for toggle in (self.go_to, self.drive):
            toggle.setCheckable(True)
        self.hint = ElidedLabel("muted")
        self._lay_out()
        self.start.clicked.connect(self.start_asked)
        self.stop.clicked.connect(self.stop_asked)
        self.go_to.toggled.connect(self.goal_mode_changed)
        self.drive.toggled.connect(self.drive_mode_changed)

    def show_view(self, view: OperatorView) -> None:
        now = allowed(view, self._stale_after_s)
        for button, on in (
            (self.start, now.start),
            (self.stop, now.stop),
            (self.go_to, now.go_to),
            (self.drive, now.drive),
        ):
            button.setEnabled(on)
            if not on and button.isChecked():
                button.setChecked(False)
        self.hint.show_text(self._hint_text(view, now))

    def _hint_text(self, view: OperatorView, now: Allowed) -> str:
        if self.go_to.isChecked():
            return "Click on the map where it shall go."
        if self.drive.isChecked():
            return "Hold the pad, arrows or W A S D."
        if view.link_state is LinkState.DISCONNECTED:
            return "Connect to a robot first."
        if now.go_to:
            return "Right click on the map: go there."
        if now.drive:
            lost = view.snapshot is not None and not view.snapshot.located
            return "Go to needs its place in the map." if lost else "Go to is possible after the observation."
        return "Go to and driving come after the start." if now.start else ""

    def _lay_out(self) -> None:
        grid = QGridLayout()
        grid.setSpacing(6)
        grid.addWidget(self.start, 0, 0, 1, 2)
        grid.addWidget(self.stop, 1, 0, 1, 2)
        grid.addWidget(self.go_to, 2, 0)
        grid.addWidget(self.drive, 2, 1)
        grid.setColumnStretch(0, 1)
        grid.setColumnStretch(1, 1)
        self.body.addLayout(grid)
        self.body.addWidget(self.hint)


def _button(text: str, tip: str) -> QPushButton:
    button = QPushButton(text)
    button.setToolTip(tip)
    button.setFocusPolicy(Qt.FocusPolicy.TabFocus)  # a click must not take the keyboard from the drive pad
    return button
