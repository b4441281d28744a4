"""The connection menu: where the robot is, whether it is heard, and how well."""

from __future__ import annotations

from pathlib import PurePath

from PySide6.QtCore import Qt, Signal
from PySide6.QtGui import QIntValidator
from PySide6.QtWidgets import QGridLayout, QHBoxLayout, QPushButton

from station_gui.model.view import LinkState, OperatorView
from station_gui.qt import theme
from station_gui.qt.widgets import ElidedLabel, Lamp, Panel, PlainEdit, label, set_property
from station_gui.views import words

_LAMP = {
    LinkState.DISCONNECTED: theme.DISABLED,
    LinkState.CONNECTING: theme.WARNING,
    LinkState.CONNECTED: theme.GOOD,
    LinkState.LOST: theme.BAD,
}
_FIGURES = ("Map updates", "Observations", "Observation size", "Received", "Round trip")


class ConnectionPanel(Panel):
    """Emits `connect_asked` with host and port, or `disconnect_asked`."""

    connect_asked = Signal(str, int)
    disconnect_asked = Signal()

    def __init__(self, host: str, port: int) -> None:
        super().__init__("Connection")
        self.host = PlainEdit(host)
        self.host.setPlaceholderText("robot's host name or address")
        self.host.setMaxLength(253)
        self.port = PlainEdit(str(port))
        self.port.setValidator(QIntValidator(1, 65535, self.port))
        self.port.setFixedWidth(64)
        self.button = QPushButton("Connect")
        self.button.setProperty("role", "primary")
        self.lamp = Lamp()
        self.state = ElidedLabel()
        self.recording = ElidedLabel("muted", Qt.TextElideMode.ElideLeft)
        self.figures = {name: label(words.NO_VALUE, align=Qt.AlignmentFlag.AlignRight) for name in _FIGURES}
        self._link_state = LinkState.DISCONNECTED
        self._lay_out()
        self.button.clicked.connect(self._on_button)
        for edit in (self.host, self.port):
            edit.returnPressed.connect(self._on_return)
            edit.textChanged.connect(self._enable)
        self._enable()

    def show_view(self, view: OperatorView) -> None:
        self._link_state = view.link_state
        self.lamp.show_colour(_LAMP[view.link_state])
        self.state.show_text(words.link_sentence(view))
        free = view.link_state is LinkState.DISCONNECTED
        self.button.setText("Connect" if free else "Disconnect")
        set_property(self.button, "role", "primary" if free else "plain")
        self._show_address(view.address if not free else "")
        self._enable()
        for name, text in figure_texts(view).items():
            self.figures[name].setText(text)
        self.recording.show_text(PurePath(view.recording).as_posix() if view.recording else "not recording")

    def _show_address(self, address: str) -> None:
        """Somebody else may have chosen where to connect to."""
        host, _, port = address.rpartition(":")
        if host and (host, port) != (self.host.text().strip(), self.port.text()):
            self.host.setText(host)
            self.port.setText(port)

    def _lay_out(self) -> None:
        address = QHBoxLayout()
        address.setSpacing(6)
        address.addWidget(self.host, 1)
        address.addWidget(self.port)
        self.body.addLayout(address)
        self.body.addWidget(self.button)
        state = QHBoxLayout()
        state.addWidget(self.lamp)
        state.addWidget(self.state, 1)
        self.body.addLayout(state)
        grid = QGridLayout()
        grid.setVerticalSpacing(3)
        for row, (name, value) in enumerate(self.figures.items()):
            grid.addWidget(label(name, "muted"), row, 0)
            grid.addWidget(value, row, 1)
        grid.addWidget(label("Recording", "muted"), len(self.figures), 0)
        self.recording.setAlignment(Qt.AlignmentFlag.AlignRight | Qt.AlignmentFlag.AlignVCenter)
        grid.addWidget(self.recording, len(self.figures), 1)
        grid.setColumnStretch(1, 1)
        self.body.addLayout(grid)

    def _enable(self) -> None:
        free = self._link_state is LinkState.DISCONNECTED
        self.host.setEnabled(free)
        self.port.setEnabled(free)
        self.button.setEnabled(not free or self._address_is_complete())

    def _address_is_complete(self) -> bool:
        return bool(self.host.text().strip()) and self.port.hasAcceptableInput()

    def _on_return(self) -> None:
        if self._link_state is LinkState.DISCONNECTED:
            self._on_button()

    def _on_button(self) -> None:
        if self._link_state is not LinkState.DISCONNECTED:
            self.disconnect_asked.emit()
        elif self._address_is_complete():
            self.connect_asked.emit(self.host.text().strip(), int(self.port.text()))


def figure_texts(view: OperatorView) -> dict[str, str]:
    """How the link does, a text for each name in the panel; dashes while there is no link."""
    if view.link_state is LinkState.DISCONNECTED:
        return dict.fromkeys(_FIGURES, words.NO_VALUE)
    link = view.link
    values = (
        words.number(link.refresh_hz, 1, "/s"),
        words.number(link.observations_hz, 1, "/s"),
        words.number(link.bytes_per_observation, 0, "B"),
        words.bits_per_second(link.received_bps),
        words.number(link.round_trip_s * 1e3, 0, "ms"),
    )
    return dict(zip(_FIGURES, values, strict=True))
