"""The command buttons, and when which of them makes sense."""

from __future__ import annotations

from dataclasses import dataclass

from PySide6.QtCore import Qt, Signal
from PySide6.QtWidgets import QGridLayout, QPushButton

from shared.messages import MissionState
from station_gui.model.view import LinkState, OperatorView
from station_gui.qt.widgets import ElidedLabel, Panel

_RUNNING = {MissionState.OBSERVE, MissionState.COMMAND, MissionState.RETURN}
_PAUSE, _CONTINUE = "Pause", "Continue"


@dataclass(frozen=True, slots=True)
class Allowed:
    """What the operator may ask for now."""

    start: bool = False
    stop: bool = False
    emergency: bool = False
    go_to: bool = False
    drive: bool = False
    pause: bool = False
    resume: bool = False
    go_home: bool = False


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
        start=state not in _RUNNING,
        stop=state is not MissionState.HALTED,
        emergency=True,
        go_to=state is MissionState.COMMAND and view.snapshot is not None and view.snapshot.located,
        drive=state in {MissionState.OBSERVE, MissionState.COMMAND},
        pause=state in _RUNNING,
        resume=state in {MissionState.PAUSED, MissionState.HALTED},
        go_home=state in {MissionState.OBSERVE, MissionState.COMMAND, MissionState.PAUSED},
    )


class CommandPanel(Panel):
    """Start, pause, go on, return, stop, go to, drive by hand."""

    start_asked = Signal()
    stop_asked = Signal()
    pause_asked = Signal()
    resume_asked = Signal()
    return_asked = Signal()
    goal_mode_changed = Signal(bool)
    drive_mode_changed = Signal(bool)

    def __init__(self, stale_after_s: float) -> None:
        super().__init__("Mission")
        self._stale_after_s = stale_after_s
        self.start = _button("Start observation", "The robot goes round the room by itself and maps it")
        self.start.setProperty("role", "primary")
        self.pause = _button(_PAUSE, "Stand still and keep the mission; press again to go on with it")
        self.go_home = _button("Return", "Go back to where the mission was started, by the robot's own map")
        self.stop = _button("Stop", "End the mission; the robot stands still until it is told to start or to continue")
        self.stop.setProperty("role", "stop")
        self.go_to = _button("Go to…", "Then click on the map; a right click on the map does it at any time")
        self.drive = _button("Drive by hand", "Use the pad, the arrow keys or W A S D")
        for toggle in (self.go_to, self.drive):
            toggle.setCheckable(True)
        self.hint = ElidedLabel("muted")
        self._lay_out()
        self.start.clicked.connect(self.start_asked)
        self.stop.clicked.connect(self.stop_asked)
        self.pause.clicked.connect(self._pause_clicked)
        self.go_home.clicked.connect(self.return_asked)
        self.go_to.toggled.connect(self.goal_mode_changed)
        self.drive.toggled.connect(self.drive_mode_changed)

    def show_view(self, view: OperatorView) -> None:
        now = allowed(view, self._stale_after_s)
        for button, on in (
            (self.start, now.start),
            (self.stop, now.stop),
            (self.pause, now.pause or now.resume),
            (self.go_home, now.go_home),
            (self.go_to, now.go_to),
            (self.drive, now.drive),
        ):
            button.setEnabled(on)
            if not on and button.isChecked():
                button.setChecked(False)
        self.pause.setText(_CONTINUE if now.resume else _PAUSE)
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

    def _pause_clicked(self) -> None:
        (self.resume_asked if self.pause.text() == _CONTINUE else self.pause_asked).emit()

    def _lay_out(self) -> None:
        grid = QGridLayout()
        grid.setSpacing(6)
        grid.addWidget(self.start, 0, 0, 1, 2)
        grid.addWidget(self.pause, 1, 0)
        grid.addWidget(self.go_home, 1, 1)
        grid.addWidget(self.stop, 2, 0, 1, 2)
        grid.addWidget(self.go_to, 3, 0)
        grid.addWidget(self.drive, 3, 1)
        grid.setColumnStretch(0, 1)
        grid.setColumnStretch(1, 1)
        self.body.addLayout(grid)
        self.body.addWidget(self.hint)


def _button(text: str, tip: str) -> QPushButton:
    button = QPushButton(text)
    button.setToolTip(tip)
    button.setFocusPolicy(Qt.FocusPolicy.TabFocus)  # a click must not take the keyboard from the drive pad
    return button
