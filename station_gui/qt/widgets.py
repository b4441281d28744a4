"""Small widgets that know nothing of robots."""

from __future__ import annotations

from PySide6.QtCore import QEvent, QRectF, QSize, Qt
from PySide6.QtGui import QColor, QImage, QKeyEvent, QPainter, QPaintEvent
from PySide6.QtWidgets import QFrame, QHBoxLayout, QLabel, QLineEdit, QSizePolicy, QToolButton, QVBoxLayout, QWidget

from station_gui.qt import theme


def set_property(widget: QWidget, name: str, value: str) -> None:
    """Set a property that the style sheet selects by; restyles only on a change."""
    if widget.property(name) == value:
        return
    widget.setProperty(name, value)
    widget.style().unpolish(widget)
    widget.style().polish(widget)
    widget.update()


def label(text: str = "", role: str = "", align: Qt.AlignmentFlag = Qt.AlignmentFlag.AlignLeft) -> QLabel:
    made = QLabel(text)
    if role:
        made.setProperty("role", role)
    made.setAlignment(align | Qt.AlignmentFlag.AlignVCenter)
    return made


def tool_button(text: str, tip: str, *, checkable: bool = False) -> QToolButton:
    """A small button for a panel's header; it never takes the keyboard away from the window."""
    button = QToolButton()
    button.setText(text)
    button.setToolTip(tip)
    button.setCheckable(checkable)
    button.setFocusPolicy(Qt.FocusPolicy.NoFocus)
    return button


def overlay_label(canvas: QWidget) -> QLabel:
    """A sentence in the middle of an empty canvas; the mouse goes through it."""
    hint = label("", "overlay", Qt.AlignmentFlag.AlignHCenter)
    hint.setAttribute(Qt.WidgetAttribute.WA_TransparentForMouseEvents)
    layout = QVBoxLayout(canvas)
    layout.addWidget(hint, 0, Qt.AlignmentFlag.AlignCenter)
    return hint


class Panel(QFrame):
    """A framed part of the window with a title; contents go into `body`, small tools into `header`."""

    def __init__(self, title: str, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.setProperty("role", "panel")
        outer = QVBoxLayout(self)
        outer.setContentsMargins(theme.MARGIN_PX, theme.SPACING_PX, theme.MARGIN_PX, theme.MARGIN_PX)
        outer.setSpacing(theme.SPACING_PX)
        self.header = QHBoxLayout()
        self.header.setSpacing(theme.SPACING_PX)
        self.header.addWidget(label(title.upper(), "title"))
        self.header.addStretch(1)
        outer.addLayout(self.header)
        self.body = QVBoxLayout()
        self.body.setSpacing(theme.SPACING_PX)
        outer.addLayout(self.body, 1)


class ElidedLabel(QLabel):
    """One line that is cut with an ellipsis instead of widening its layout; the whole text is its tooltip."""

    def __init__(self, role: str = "", mode: Qt.TextElideMode = Qt.TextElideMode.ElideRight) -> None:
        super().__init__()
        self._mode = mode
        if role:
            self.setProperty("role", role)
        self.setSizePolicy(QSizePolicy.Policy.Ignored, QSizePolicy.Policy.Preferred)

    def show_text(self, text: str) -> None:
        if text != self.text():
            self.setText(text)
            self.setToolTip(text)

    def minimumSizeHint(self) -> QSize:  # noqa: N802 - Qt's name
        return QSize(0, super().minimumSizeHint().height())

    def paintEvent(self, _event: QPaintEvent) -> None:  # noqa: N802 - Qt's name
        painter = QPainter(self)
        painter.setPen(self.palette().color(self.foregroundRole()))
        text = self.fontMetrics().elidedText(self.text(), self._mode, self.width())
        painter.drawText(self.rect(), int(self.alignment()), text)
        painter.end()


class Lamp(QWidget):
    """A round lamp of one colour."""

    def __init__(self, diameter_px: int = 12) -> None:
        super().__init__()
        self._colour = QColor(theme.DISABLED)
        self.setFixedSize(diameter_px, diameter_px)

    @property
    def colour(self) -> str:
        return self._colour.name()

    def show_colour(self, colour: str) -> None:
        if QColor(colour) != self._colour:
            self._colour = QColor(colour)
            self.update()

    def paintEvent(self, _event: QPaintEvent) -> None:  # noqa: N802 - Qt's name
        painter = QPainter(self)
        painter.setRenderHint(QPainter.RenderHint.Antialiasing)
        painter.setPen(self._colour.darker(160))
        painter.setBrush(self._colour)
        painter.drawEllipse(QRectF(self.rect()).adjusted(1, 1, -1, -1))
        painter.end()


def picture_of(widget: QWidget) -> QImage:
    """The widget as it looks, in full colour whatever the depth of the screen."""
    ratio = widget.devicePixelRatioF()
    image = QImage(widget.size() * ratio, QImage.Format.Format_RGB32)
    image.setDevicePixelRatio(ratio)
    QWidget.render(widget, image)  # a graphics view has another method of this name
    return image


class PlainEdit(QLineEdit):
    """A line edit that leaves the space bar to the window: there it is the emergency stop."""

    def event(self, event: QEvent) -> bool:
        if (
            event.type() == QEvent.Type.ShortcutOverride
            and isinstance(event, QKeyEvent)
            and event.key() == Qt.Key.Key_Space
        ):
            event.ignore()
            return False
        return super().event(event)
