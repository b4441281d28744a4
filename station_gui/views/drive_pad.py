"""Driving by hand: hold the stick, the arrows or W A S D; letting go stops."""

from __future__ import annotations

import math

from PySide6.QtCore import QEvent, QPointF, QRectF, QSize, Qt, QTimer, Signal
from PySide6.QtGui import QColor, QFocusEvent, QHideEvent, QKeyEvent, QMouseEvent, QPainter, QPaintEvent, QPen
from PySide6.QtWidgets import QHBoxLayout, QSizePolicy, QSlider, QWidget

from station_gui.qt import theme
from station_gui.qt.widgets import Panel, label
from station_gui.views import words
from station_gui.views.config import WindowConfig

_KEYS = {
    Qt.Key.Key_Up: (0.0, 1.0),
    Qt.Key.Key_W: (0.0, 1.0),
    Qt.Key.Key_Down: (0.0, -1.0),
    Qt.Key.Key_S: (0.0, -1.0),
    Qt.Key.Key_Left: (-1.0, 0.0),
    Qt.Key.Key_A: (-1.0, 0.0),
    Qt.Key.Key_Right: (1.0, 0.0),
    Qt.Key.Key_D: (1.0, 0.0),
}
_KNOB_PX = 17.0
_MAX_PX = 230


class Stick(QWidget):
    """A stick that springs back. `held` gives right and forward, each -1 to 1, at a fixed rate; `released` once."""

    held = Signal(float, float)
    released = Signal()

    def __init__(self, rate_hz: float) -> None:
        super().__init__()
        self._right_forward = (0.0, 0.0)
        self._by_mouse = False
        self._keys: set[int] = set()
        self._timer = QTimer(self)
        self._timer.setInterval(round(1000 / rate_hz))
        self._timer.timeout.connect(self._send)
        self.setFocusPolicy(Qt.FocusPolicy.StrongFocus)
        self.setMinimumSize(116, 116)
        self.setMaximumSize(_MAX_PX, _MAX_PX)
        self.setSizePolicy(QSizePolicy.Policy.Expanding, QSizePolicy.Policy.Expanding)
        self.setAccessibleName("Drive pad")

    @property
    def active(self) -> bool:
        """Whether the operator holds it."""
        return self._timer.isActive()

    def let_go(self) -> None:
        """Spring back, whoever held it."""
        self._keys.clear()
        self._by_mouse = False
        self._move((0.0, 0.0), held=False)

    def sizeHint(self) -> QSize:  # noqa: N802 - Qt's name
        return QSize(_MAX_PX, 140)

    def mousePressEvent(self, event: QMouseEvent) -> None:  # noqa: N802 - Qt's name
        if event.button() is Qt.MouseButton.LeftButton:
            self._by_mouse = True
            self._move(self._share(event.position()), held=True)

    def mouseMoveEvent(self, event: QMouseEvent) -> None:  # noqa: N802 - Qt's name
        if self._by_mouse:
            self._move(self._share(event.position()), held=True)

    def mouseReleaseEvent(self, event: QMouseEvent) -> None:  # noqa: N802 - Qt's name
        if event.button() is Qt.MouseButton.LeftButton:
            self.let_go()

    def keyPressEvent(self, event: QKeyEvent) -> None:  # noqa: N802 - Qt's name
        if event.key() not in _KEYS:
            super().keyPressEvent(event)
        elif not event.isAutoRepeat():
            self._keys.add(event.key())
            self._follow_keys()

    def keyReleaseEvent(self, event: QKeyEvent) -> None:  # noqa: N802 - Qt's name
        if event.key() not in _KEYS:
            super().keyReleaseEvent(event)
        elif not event.isAutoRepeat():
            self._keys.discard(event.key())
            self._follow_keys()

    def focusOutEvent(self, event: QFocusEvent) -> None:  # noqa: N802 - Qt's name
        self.let_go()
        super().focusOutEvent(event)

    def hideEvent(self, event: QHideEvent) -> None:  # noqa: N802 - Qt's name
        self.let_go()
        super().hideEvent(event)

    def changeEvent(self, event: QEvent) -> None:  # noqa: N802 - Qt's name
        if event.type() == QEvent.Type.EnabledChange and not self.isEnabled():
            self.let_go()
        self.update()
        super().changeEvent(event)

    def paintEvent(self, _event: QPaintEvent) -> None:  # noqa: N802 - Qt's name
        painter = QPainter(self)
        painter.setRenderHint(QPainter.RenderHint.Antialiasing)
        centre, reach = self._centre(), self._reach()
        outer = reach + _KNOB_PX
        painter.setPen(QPen(QColor(theme.ACCENT if self.hasFocus() else theme.BORDER), 2))
        painter.setBrush(QColor(theme.BACKGROUND))
        painter.drawEllipse(centre, outer - 1, outer - 1)
        self._draw_letters(painter, centre, outer)
        knob = QPointF(centre.x() + self._right_forward[0] * reach, centre.y() - self._right_forward[1] * reach)
        colour = theme.DISABLED if not self.isEnabled() else theme.ACCENT if self.active else theme.MUTED
        painter.setPen(QPen(QColor(colour).darker(140), 1.5))
        painter.setBrush(QColor(colour))
        painter.drawEllipse(knob, _KNOB_PX, _KNOB_PX)
        painter.end()

    def _draw_letters(self, painter: QPainter, centre: QPointF, outer: float) -> None:
        painter.setPen(QColor(theme.MUTED if self.isEnabled() else theme.DISABLED))
        for text, x, y in (("W", 0, -1), ("S", 0, 1), ("A", -1, 0), ("D", 1, 0)):
            place = QPointF(centre.x() + x * (outer - 11), centre.y() + y * (outer - 11))
            area = QRectF(place.x() - 9, place.y() - 9, 18, 18)
            painter.drawText(area, int(Qt.AlignmentFlag.AlignCenter), text)

    def _follow_keys(self) -> None:
        right = sum(_KEYS[Qt.Key(key)][0] for key in self._keys)
        forward = sum(_KEYS[Qt.Key(key)][1] for key in self._keys)
        self._move((max(-1.0, min(1.0, right)), max(-1.0, min(1.0, forward))), held=bool(self._keys))

    def _move(self, right_forward: tuple[float, float], *, held: bool) -> None:
        if right_forward != self._right_forward:
            self._right_forward = right_forward
            self.update()
        if held and not self._timer.isActive():
            self._timer.start()
            self._send()
        elif not held and self._timer.isActive():
            self._timer.stop()
            self.released.emit()
            self.update()

    def _send(self) -> None:
        self.held.emit(*self._right_forward)

    def _share(self, position: QPointF) -> tuple[float, float]:
        """How far the stick is pushed; beyond its rim it stays on the rim."""
        offset = (position - self._centre()) / self._reach()
        length = max(1.0, math.hypot(offset.x(), offset.y()))
        return offset.x() / length, -offset.y() / length

    def _centre(self) -> QPointF:
        return QRectF(self.rect()).center()

    def _reach(self) -> float:
        return max(1.0, min(self.width(), self.height()) / 2 - _KNOB_PX - 1)


class DrivePanel(Panel):
    """The stick and how fast it drives at most. `drive_asked` gives speed_mps and steering_rad."""

    drive_asked = Signal(float, float)

    def __init__(self, config: WindowConfig) -> None:
        super().__init__("Drive by hand")
        self._config = config
        self.stick = Stick(config.drive_hz)
        self._limit = label("", "muted", Qt.AlignmentFlag.AlignRight)
        self.header.addWidget(self._limit)
        self.slider = QSlider(Qt.Orientation.Horizontal)
        self.slider.setRange(5, round(100 * config.drive_max_speed_mps))  # cm/s
        self.slider.setToolTip("How fast the robot drives with the stick at its rim")
        self.slider.setFocusPolicy(Qt.FocusPolicy.NoFocus)
        self.slider.valueChanged.connect(self._on_limit)
        self.slider.setValue(round(100 * config.drive_speed_mps))
        self._on_limit()
        self.body.addWidget(self.stick, 1, Qt.AlignmentFlag.AlignHCenter)
        row = QHBoxLayout()
        row.addWidget(label("slow", "muted"))
        row.addWidget(self.slider, 1)
        row.addWidget(label("fast", "muted"))
        self.body.addLayout(row)
        self.stick.held.connect(self._on_held)
        self.stick.released.connect(self._on_released)
        self.set_on(False)

    def set_on(self, on: bool) -> None:
        """Let the stick be used, with the keyboard on it."""
        self.stick.setEnabled(on)
        self.slider.setEnabled(on)
        if on:
            self.stick.setFocus(Qt.FocusReason.OtherFocusReason)

    def _on_limit(self) -> None:
        self._limit.setText(f"up to {words.number(self.slider.value() / 100, 2, 'm/s')}")

    def _on_held(self, right: float, forward: float) -> None:
        speed_mps = forward * self.slider.value() / 100
        self.drive_asked.emit(speed_mps, -right * self._config.drive_max_steering_rad)

    def _on_released(self) -> None:
        self.drive_asked.emit(0.0, 0.0)
