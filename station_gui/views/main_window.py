"""The operator's window."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path

from PySide6.QtCore import Qt, QTimer
from PySide6.QtGui import QCloseEvent, QKeySequence, QResizeEvent, QShortcut
from PySide6.QtWidgets import QFrame, QHBoxLayout, QLabel, QMainWindow, QSplitter, QVBoxLayout, QWidget

from shared.runtime.clock import stopwatch_s
from station_gui.model.view import Operator, OperatorView
from station_gui.qt import theme
from station_gui.qt.bridge import Guard
from station_gui.qt.widgets import picture_of
from station_gui.views import words
from station_gui.views.commands import CommandPanel, allowed
from station_gui.views.config import WindowConfig
from station_gui.views.connection import ConnectionPanel
from station_gui.views.details import DetailsPanel
from station_gui.views.drive_pad import DrivePanel
from station_gui.views.gauges import GaugePanel
from station_gui.views.map2d import Map2dCanvas
from station_gui.views.map3d import Map3dCanvas
from station_gui.views.map_files import MapFileMenu
from station_gui.views.mission_bar import MissionBar
from station_gui.views.mission_log import MissionLog

_SIDE_PX = 286
_BOTTOM_PX = 212
_TALL_PX = 920  # from this height on there is room for the details …
_TALLER_PX = 1060  # … and here for all of the connection menu at once
_SMOOTHING = 0.1  # of the shown cost of a refresh


class MainWindow(QMainWindow):
    """Looks at the operator's view at a fixed rate and draws what changed; knows no threads."""

    def __init__(self, operator: Operator, config: WindowConfig, radio_ports: tuple[str, ...] = ()) -> None:
        """`radio_ports`: what the connection menu offers at first."""
        super().__init__()
        self._operator = operator
        self._config = config
        self._refresh_s = 0.0
        self._view: OperatorView | None = None
        stale_after_s = config.gauges.stale_after_s
        self.mission = MissionBar(stale_after_s)
        self.connection = ConnectionPanel(config, radio_ports, operator.serial_ports)
        self.commands = CommandPanel(stale_after_s)
        self.drive = DrivePanel(config)
        self.details = DetailsPanel()
        self.gauges = GaugePanel(config.gauges)
        self.map2d = Map2dCanvas()
        self.map_files = MapFileMenu()
        self.map2d.header.insertWidget(1, self.map_files)
        self.map3d = Map3dCanvas()
        self.log = MissionLog(config.log_lines)
        self._mapping = QLabel()
        self._cost = QLabel()
        self._guards: list[tuple[Guard, Callable[[OperatorView], None]]] = [
            (Guard(name), draw) for name, draw in self._parts()
        ]
        self._look = Guard("the station's state")
        self._lay_out()
        self._connect()
        self._timer = QTimer(self)
        self._timer.setInterval(round(1000 / config.refresh_hz))
        self._timer.timeout.connect(self.refresh)
        self._timer.start()
        self.refresh()

    @property
    def shown(self) -> OperatorView | None:
        """The view that is on the screen."""
        return self._view

    @property
    def refresh_cost_s(self) -> float:
        """What a refresh takes without the painting, smoothed."""
        return self._refresh_s

    def refresh(self) -> None:
        """Draw the present view; the timer does this."""
        self._look.run(self._refresh)

    def save_pictures(
        self, window_png: Path, map3d_png: Path | None = None, map3d_px: tuple[int, int] = (1280, 960)
    ) -> None:
        """Write the window as it is, 3D included, and the 3D map alone; OSError when a file cannot be written."""
        self.refresh()
        self.map3d.polish()
        _save(picture_of(self).save(str(window_png)), window_png)
        if map3d_png is not None:
            _save(self.map3d.picture(*map3d_px).save(str(map3d_png)), map3d_png)

    def closeEvent(self, event: QCloseEvent) -> None:  # noqa: N802 - Qt's name
        if self._timer.isActive():  # a window may be closed twice
            self._timer.stop()
            self.drive.stick.let_go()
            self.map_files.close_dialog()
            self.map3d.close_gl()
            self._operator.disconnect()
        super().closeEvent(event)

    def resizeEvent(self, event: QResizeEvent) -> None:  # noqa: N802 - Qt's name
        height_px = event.size().height()
        self.details.setVisible(height_px >= _TALL_PX)
        self.connection.set_short(height_px < _TALLER_PX)
        super().resizeEvent(event)

    def _parts(self) -> tuple[tuple[str, Callable[[OperatorView], None]], ...]:
        return (
            ("the mission's state", self.mission.show_view),
            ("the connection", self.connection.show_view),
            ("the commands", self.commands.show_view),
            ("the gauges", self.gauges.show_view),
            ("the details", self.details.show_view),
            ("the map", self.map2d.show_view),
            ("the map files", self.map_files.show_view),
            ("the 3D map", self.map3d.show_view),
            ("the log", lambda view: self.log.show_log(self._operator, view.log_length)),
            ("the status bar", self._show_status),
        )

    def _refresh(self) -> None:
        started_s = stopwatch_s()
        view = self._view = self._operator.view()
        for guard, draw in self._guards:
            guard.run(partial(draw, view))
        self._refresh_s += _SMOOTHING * (stopwatch_s() - started_s - self._refresh_s)

    def _show_status(self, view: OperatorView) -> None:
        self._mapping.setText(status_text(view))
        self._cost.setText(f"refresh {words.number(self._refresh_s * 1e3, 0, 'ms')}")

    def _connect(self) -> None:
        self.connection.connect_asked.connect(self._operator.connect)
        self.connection.disconnect_asked.connect(self._operator.disconnect)
        self.commands.start_asked.connect(self._operator.start)
        self.commands.pause_asked.connect(self._operator.pause)
        self.commands.resume_asked.connect(self._operator.resume)
        self.commands.return_asked.connect(self._operator.return_to_start)
        self.commands.stop_asked.connect(self._operator.stop)
        self.commands.goal_mode_changed.connect(self.map2d.set_goal_mode)
        self.commands.drive_mode_changed.connect(self.drive.set_on)
        self.drive.drive_asked.connect(self._operator.drive)
        self.map2d.goal_picked.connect(self._on_goal)
        self.map_files.save_asked.connect(lambda path: self._operator.save_map(Path(path)))
        self.map_files.open_asked.connect(self._on_open_map)
        self.map_files.export_asked.connect(lambda path: self._operator.export_map(Path(path)))
        self.mission.emergency_asked.connect(self._on_emergency)
        for key in (Qt.Key.Key_Space, Qt.Key.Key_Escape):
            shortcut = QShortcut(QKeySequence(key), self)
            shortcut.setContext(Qt.ShortcutContext.ApplicationShortcut)
            shortcut.setAutoRepeat(False)
            shortcut.activated.connect(self._on_emergency)

    def _on_open_map(self, path: str, localise: bool) -> None:
        self._operator.open_map(Path(path), localise=localise)

    def _on_emergency(self) -> None:
        self._operator.emergency_stop()
        self.commands.drive.setChecked(False)
        self.commands.go_to.setChecked(False)

    def _on_goal(self, x_m: float, y_m: float) -> None:
        if self._view is not None and allowed(self._view, self._config.gauges.stale_after_s).go_to:
            self._operator.go_to(x_m, y_m)
            self.commands.go_to.setChecked(False)

    def _lay_out(self) -> None:
        self.setWindowTitle("Low-bandwidth mapper: station")
        self.resize(self._config.width_px, self._config.height_px)
        self.setMinimumSize(1120, 740)
        centre = QWidget()
        outer = QVBoxLayout(centre)
        outer.setContentsMargins(theme.SPACING_PX, theme.SPACING_PX, theme.SPACING_PX, theme.SPACING_PX)
        outer.setSpacing(theme.SPACING_PX)
        outer.addWidget(self.mission)
        below = QHBoxLayout()
        below.setSpacing(theme.SPACING_PX)
        below.addWidget(self._side())
        right = QVBoxLayout()
        right.setSpacing(theme.SPACING_PX)
        right.addWidget(self._maps(), 1)
        right.addWidget(self._bottom())
        below.addLayout(right, 1)
        outer.addLayout(below, 1)
        self.setCentralWidget(centre)
        self.statusBar().addWidget(self._mapping, 1)
        self.statusBar().addPermanentWidget(self._cost)
        self.statusBar().setSizeGripEnabled(False)

    def _side(self) -> QWidget:
        side = QFrame()
        side.setFixedWidth(_SIDE_PX)
        column = QVBoxLayout(side)
        column.setContentsMargins(0, 0, 0, 0)
        column.setSpacing(theme.SPACING_PX)
        column.addWidget(self.connection)
        column.addWidget(self.commands)
        column.addWidget(self.drive, 1)
        column.addWidget(self.details)
        return side

    def _maps(self) -> QWidget:
        maps = QSplitter(Qt.Orientation.Horizontal)
        maps.setHandleWidth(theme.SPACING_PX)
        maps.setChildrenCollapsible(False)
        maps.addWidget(self.map2d)
        maps.addWidget(self.map3d)
        maps.setSizes([500, 500])
        return maps

    def _bottom(self) -> QWidget:
        bottom = QFrame()
        bottom.setFixedHeight(_BOTTOM_PX)
        row = QHBoxLayout(bottom)
        row.setContentsMargins(0, 0, 0, 0)
        row.setSpacing(theme.SPACING_PX)
        row.addWidget(self.gauges, 3)
        row.addWidget(self.log, 2)
        return bottom


def status_text(view: OperatorView) -> str:
    """What the mapping does, in one line."""
    snapshot = view.snapshot
    if snapshot is None:
        return "No map yet"
    rows, columns = snapshot.grid.probability.shape
    cell_m = snapshot.grid.cell_m
    parts = (
        words.map_state(snapshot),
        f"map {snapshot.revision}",
        f"{snapshot.observations} observations",
        f"{len(snapshot.trajectory)} keyframes",
        f"{len(snapshot.closures)} loops",
        f"grid {words.number(columns * cell_m, 1)} × {words.number(rows * cell_m, 1, 'm')}"
        f" in {words.number(cell_m * 100, 1, 'cm')} cells",
        f"SLAM {words.number(snapshot.slam_s * 1e3, 0, 'ms')}",
        f"3D {words.number(snapshot.combine_s * 1e3, 0, 'ms')}",
    )
    return "   ·   ".join(parts)


def _save(written: bool, path: Path) -> None:
    if not written:
        raise OSError(f"{path}: the picture cannot be written")
