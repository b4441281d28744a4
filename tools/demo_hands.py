"""Plays the demo's mission with a mouse: the window cannot tell it from an operator."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from PySide6.QtCore import QPointF, Qt, QTimer
from PySide6.QtTest import QTest
from PySide6.QtWidgets import QAbstractButton

from station_gui.model.station import Station
from station_gui.views.main_window import MainWindow
from tools.director import Director, Outcome

_HOST = "127.0.0.1"


class Mouse:
    """The director's hands: clicks in the window."""

    def __init__(self, window: MainWindow, port: int) -> None:
        self._window = window
        self._port = port

    def connect(self) -> None:
        self._window.connection.host.setText(_HOST)
        self._window.connection.port.setText(str(self._port))
        _click(self._window.connection.button)

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
        self, goals_m: tuple[tuple[float, float], ...], port: int, out: Path, say: Callable[[str], None], step_ms: int
    ) -> None:
        self._goals_m = goals_m
        self._port = port
        self._out = out
        self._say = say
        self._step_ms = step_ms
        self._timer = QTimer()
        self._station: Station | None = None
        self._outcome: Outcome | None = None

    def begin(self, station: Station, window: MainWindow) -> None:
        """For `run_window`: called once the window stands."""
        self._station = station
        director = Director(Mouse(window, self._port), self._goals_m, self._say)
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
