"""The figures behind the gauges, for whoever wants to know exactly."""

from __future__ import annotations

import math

from PySide6.QtCore import Qt
from PySide6.QtWidgets import QGridLayout

from shared.geometry.se2 import Pose2
from station_gui.model.view import OperatorView
from station_gui.qt.widgets import ElidedLabel, Panel, label, set_property
from station_gui.views import words
from station_gui.views.pose import robot_on_map

_ROWS = ("On the map", "Odometry", "Turn rate", "Schedule", "Computer", "Devices", "Faults")


class DetailsPanel(Panel):
    """Poses, turn rate, how the robot's computer and its devices do, and standing faults."""

    def __init__(self) -> None:
        super().__init__("Details")
        self.values = {name: ElidedLabel() for name in _ROWS}
        grid = QGridLayout()
        grid.setVerticalSpacing(3)
        for row, (name, value) in enumerate(self.values.items()):
            value.setAlignment(Qt.AlignmentFlag.AlignRight | Qt.AlignmentFlag.AlignVCenter)
            grid.addWidget(label(name, "muted"), row, 0)
            grid.addWidget(value, row, 1)
        grid.setColumnStretch(1, 1)
        self.body.addLayout(grid)

    def show_view(self, view: OperatorView) -> None:
        for name, text in zip(_ROWS, _texts(view), strict=True):
            self.values[name].show_text(text)
        faults = view.telemetry.faults if view.telemetry is not None else ()
        set_property(self.values["Faults"], "tone", "bad" if faults else "")


def _texts(view: OperatorView) -> tuple[str, ...]:
    on_map = _pose_text(robot_on_map(view))
    telemetry = view.telemetry
    if telemetry is None:
        return (on_map, *([words.NO_VALUE] * (len(_ROWS) - 1)))
    return (
        on_map,
        _pose_text(telemetry.odom_from_robot),
        words.number(math.degrees(telemetry.yaw_rate_radps), 0, "°/s"),
        words.schedule_text(telemetry, view.vitals),
        words.computer_text(view.vitals),
        words.losses_text(view.vitals),
        ", ".join(telemetry.faults) or "none",
    )


def _pose_text(pose: Pose2 | None) -> str:
    if pose is None:
        return words.NO_VALUE
    place = f"{words.number(pose.x_m, 2)}, {words.number(pose.y_m, 2, 'm')}"
    return f"{place}, {words.number(math.degrees(pose.theta_rad), 0, '°')}"
