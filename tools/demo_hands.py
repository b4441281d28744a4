"""Plays the demo's mission with a mouse: the window cannot tell it from an operator."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from PySide6.QtCore import QPointF, Qt, QTimer
from PySide6.QtTest import QTest
from PySide6.QtWidgets import QAbstractButton

from station_gui.comms.target import Target
from station_gui.model.station import Station
from station_gui.views.main_window import MainWindow
from tools.director import Director, Outcome


class Mouse:
    """The director's hands: clicks in the window."""

    def __init__(self, window: MainWindow, target: Target) -> None:
        self._window = window
        self._target = target

    def connect(self) -> None:
        target, panel = self._target, self._window.connection
        _click(panel.uses["tcp" if not target.radio_ports else "both" if target.host else "radio"])
        if target.host:
            panel.host.setText(target.host)
            panel.port.setText(str(target.port))
        if target.radio_ports:
            panel.radio.setText(" ".join(target.radio_ports))
        _click(panel.button)

    def start(self) -> None:
        _click(self._window.commands.start)

    def go_to(self, x_m: float, y_m: float) -> None:
        button = self._window.commands.go_to
        if not button.isChecked():
            _click(button)
        view_box = self._window.map2d.view_box
        canvas = view_box.scene().views()[0]
        at = canvas.mapFromScene(view_box.mapViewToScene(QPointF(x_m, y_m)))
        QTest.mouseClick(canvas.viewport(), Qt.MouseButton.LeftButton, Qt.KeyboardModifier.NoModifier, at)

    def stop(self) -> None:
        _click(self._window.commands.stop)


def _click(button: QAbstractButton) -> None:
    QTest.mouseClick(button, Qt.MouseButton.LeftButton)


class Performance:
    """Runs a director on the window's timer, takes the pictures and closes the window."""

    def __init__(
        self,
        goals_m: tuple[tuple[float, float], ...],
        target: Target,
        out: Path,
        say: Callable[[str], None],
        step_ms: int,
    ) -> None:
        self._goals_m = goals_m
        self._target = target
        self._out = out
        self._say = say
        self._step_ms = step_ms
        self._timer = QTimer()
        self._station: Station | None = None
        self._outcome: Outcome | None = None

    def begin(self, station: Station, window: MainWindow) -> None:
        """For `run_window`: called once the window stands."""
        self._station = station
        director = Director(Mouse(window, self._target), self._goals_m, self._say)
        self._timer.timeout.connect(lambda: self._step(director, window))
        self._timer.start(self._step_ms)

    def result(self) -> tuple[Station, Outcome]:
        """After the window has closed."""
        if self._station is None:
            raise RuntimeError("the window never opened")
        return self._station, self._outcome or Outcome("the window was closed", 0.0, 0.0)

    def _step(self, director: Director, window: MainWindow) -> None:
        if window.shown is None:
            return
        director.step(window.shown)
        if director.outcome is not None:
            self._timer.stop()
            self._outcome = director.outcome
            window.save_pictures(self._out / "window.png", self._out / "map3d.png")
            window.close()
