"""Painted gauges: a dial with coloured bands, a compass, a battery."""

from __future__ import annotations

import math
from dataclasses import dataclass

from PySide6.QtCore import QPointF, QRectF, QSize, Qt
from PySide6.QtGui import QColor, QFont, QPainter, QPaintEvent, QPen, QPolygonF
from PySide6.QtWidgets import QSizePolicy, QWidget

from station_gui.qt import theme

_TITLE_PX = 18
_VALUE_PX = 22
_NOTE_PX = 16
_SWEEP_DEG = 240.0


@dataclass(frozen=True, slots=True)
class Reading:
    """What a gauge shows; `value` may be NaN: then the pointer is left out."""

    value: float
    text: str
    note: str = ""
    colour: str = theme.TEXT
    stale: bool = False


@dataclass(frozen=True, slots=True)
class Band:
    """A stretch of a scale from the end of the band before it up to `upto`."""

    upto: float
    colour: str


NOTHING = Reading(math.nan, "–", stale=True)


class Gauge(QWidget):
    """Title above, value and note below, and between them what the subclass draws."""

    def __init__(self, title: str, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._title = title
        self._reading = NOTHING
        self.setMinimumSize(96, 128)
        self.setSizePolicy(QSizePolicy.Policy.Expanding, QSizePolicy.Policy.Expanding)
        self.setAccessibleName(title)

    @property
    def reading(self) -> Reading:
        return self._reading

    def show_reading(self, reading: Reading) -> None:
        if reading != self._reading:
            self._reading = reading
            self.update()

    def sizeHint(self) -> QSize:  # noqa: N802 - Qt's name
        return QSize(124, 152)

    def paintEvent(self, _event: QPaintEvent) -> None:  # noqa: N802 - Qt's name
        painter = QPainter(self)
        painter.setRenderHint(QPainter.RenderHint.Antialiasing)
        width, height = float(self.width()), float(self.height())
        self._write(painter, QRectF(0, 0, width, _TITLE_PX), self._title, theme.MUTED, 12)
        below = height - _VALUE_PX - _NOTE_PX
        value_colour = theme.DISABLED if self._reading.stale else theme.TEXT
        self._write(painter, QRectF(0, below, width, _VALUE_PX), self._reading.text, value_colour, 17, bold=True)
        note = QRectF(0, below + _VALUE_PX, width, _NOTE_PX)
        self._write(painter, note, self._reading.note, self._shown(self._reading.colour), 11)
        self._draw(painter, QRectF(4, _TITLE_PX + 2, width - 8, below - _TITLE_PX - 4))
        painter.end()

    def _draw(self, painter: QPainter, area: QRectF) -> None:
        raise NotImplementedError

    def _shown(self, colour: str) -> str:
        """The colour, or grey when what is shown is old."""
        return theme.DISABLED if self._reading.stale else colour

    @staticmethod
    def _write(painter: QPainter, area: QRectF, text: str, colour: str, size_px: int, *, bold: bool = False) -> None:
        font = QFont(painter.font())
        font.setPixelSize(size_px)
        font.setBold(bold)
        painter.setFont(font)
        painter.setPen(QColor(colour))
        painter.drawText(area, int(Qt.AlignmentFlag.AlignCenter), text)


class Dial(Gauge):
    """A round scale from `low` to `high` with bands and a needle; a value beyond the scale stays at its end."""

    def __init__(
        self, title: str, low: float, high: float, bands: tuple[Band, ...], marks: tuple[tuple[float, str], ...] = ()
    ) -> None:
        super().__init__(title)
        self._low, self._high = low, high
        self._bands = bands
        self._marks = marks

    def angle_deg(self, value: float) -> float:
        """Where the scale has `value`: degrees counter-clockwise from three o'clock."""
        share = (value - self._low) / (self._high - self._low)
        return 90 + _SWEEP_DEG / 2 - _SWEEP_DEG * min(max(share, 0.0), 1.0)

    def _draw(self, painter: QPainter, area: QRectF) -> None:
        # The lower quarter of the circle is empty, so it may reach under the area.
        radius = min(area.width() / 2, area.height() / 1.55) - 3
        centre = QPointF(area.center().x(), area.top() + radius + 3)
        self._draw_bands(painter, centre, radius)
        self._draw_marks(painter, centre, radius)
        if math.isfinite(self._reading.value):
            self._draw_needle(painter, centre, radius)

    def _draw_bands(self, painter: QPainter, centre: QPointF, radius: float) -> None:
        box = QRectF(centre.x() - radius, centre.y() - radius, 2 * radius, 2 * radius)
        start = self._low
        for band in self._bands:
            pen = QPen(QColor(self._shown(band.colour)), 6)
            pen.setCapStyle(Qt.PenCapStyle.FlatCap)
            painter.setPen(pen)
            first, last = self.angle_deg(start), self.angle_deg(band.upto)
            painter.drawArc(box, round(first * 16), round((last - first) * 16))
            start = band.upto

    def _draw_marks(self, painter: QPainter, centre: QPointF, radius: float) -> None:
        painter.setPen(QPen(QColor(theme.MUTED), 1.5))
        for value, text in self._marks:
            outer = _on_circle(centre, radius - 4, self.angle_deg(value))
            inner = _on_circle(centre, radius - 9, self.angle_deg(value))
            painter.setPen(QPen(QColor(theme.MUTED), 1.5))
            painter.drawLine(outer, inner)
            place = _on_circle(centre, radius - 18, self.angle_deg(value))
            self._write(painter, QRectF(place.x() - 18, place.y() - 7, 36, 14), text, theme.MUTED, 9)

    def _draw_needle(self, painter: QPainter, centre: QPointF, radius: float) -> None:
        angle = self.angle_deg(self._reading.value)
        colour = QColor(self._shown(theme.TEXT))
        needle = QPolygonF(
            [
                _on_circle(centre, radius - 8, angle),
                _on_circle(centre, 3.5, angle + 90),
                _on_circle(centre, 3.5, angle - 90),
            ]
        )
        painter.setPen(QPen(QColor(theme.PANEL), 1))
        painter.setBrush(colour)
        painter.drawPolygon(needle)
        painter.drawEllipse(centre, 5, 5)


class Compass(Gauge):
    """A heading in degrees, counter-clockwise from the x axis of the map, which points right as on the map."""

    def _draw(self, painter: QPainter, area: QRectF) -> None:
        radius = min(area.width(), area.height()) / 2 - 2
        centre = area.center()
        painter.setPen(QPen(QColor(theme.BORDER), 5))
        painter.setBrush(Qt.BrushStyle.NoBrush)
        painter.drawEllipse(centre, radius - 2, radius - 2)
        for degrees in range(0, 360, 30):
            painter.setPen(QPen(QColor(theme.MUTED), 1.5))
            painter.drawLine(_on_circle(centre, radius - 6, degrees), _on_circle(centre, radius - 10, degrees))
        for degrees, text in ((0, "x"), (90, "y")):
            place = _on_circle(centre, radius - 17, degrees)
            self._write(painter, QRectF(place.x() - 9, place.y() - 8, 18, 16), text, theme.MUTED, 10)
        if math.isfinite(self._reading.value):
            self._draw_arrow(painter, centre, radius)

    def _draw_arrow(self, painter: QPainter, centre: QPointF, radius: float) -> None:
        angle = self._reading.value
        arrow = QPolygonF(
            [
                _on_circle(centre, radius - 8, angle),
                _on_circle(centre, radius * 0.45, angle + 145),
                _on_circle(centre, radius * 0.15, angle + 180),
                _on_circle(centre, radius * 0.45, angle - 145),
            ]
        )
        painter.setPen(Qt.PenStyle.NoPen)
        painter.setBrush(QColor(self._shown(theme.ROBOT)))
        painter.drawPolygon(arrow)


class Battery(Gauge):
    """A battery that is full at `full`, empty at `empty`."""

    def __init__(self, title: str, empty: float, full: float) -> None:
        super().__init__(title)
        self._empty, self._full = empty, full

    def share(self, value: float) -> float:
        return min(max((value - self._empty) / (self._full - self._empty), 0.0), 1.0)

    def _draw(self, painter: QPainter, area: QRectF) -> None:
        width = min(area.width() * 0.72, area.height() * 1.5)
        height = width * 0.48
        body = QRectF(area.center().x() - width / 2 - 2, area.center().y() - height / 2, width, height)
        painter.setPen(QPen(QColor(theme.MUTED), 2))
        painter.setBrush(Qt.BrushStyle.NoBrush)
        painter.drawRoundedRect(body, 4, 4)
        painter.setBrush(QColor(theme.MUTED))
        painter.drawRect(QRectF(body.right() + 2, body.center().y() - height / 6, 3, height / 3))
        if math.isfinite(self._reading.value):
            inner = body.adjusted(4, 4, -4, -4)
            inner.setWidth(max(2.0, inner.width() * self.share(self._reading.value)))
            painter.setPen(Qt.PenStyle.NoPen)
            painter.setBrush(QColor(self._shown(self._reading.colour)))
            painter.drawRoundedRect(inner, 2, 2)


def _on_circle(centre: QPointF, radius: float, angle_deg: float) -> QPointF:
    angle = math.radians(angle_deg)
    return QPointF(centre.x() + radius * math.cos(angle), centre.y() - radius * math.sin(angle))
