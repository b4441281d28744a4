"""The connection menu: where the robot is, over what it is heard, and how well."""

from __future__ import annotations

import re
from collections.abc import Callable
from functools import partial
from pathlib import PurePath

from PySide6.QtCore import Qt, Signal
from PySide6.QtGui import QIntValidator
from PySide6.QtWidgets import QButtonGroup, QGridLayout, QHBoxLayout, QMenu, QPushButton, QWidget

from shared.link.base import LinkPath
from station_gui.model.view import LinkState, OperatorView, Target
from station_gui.qt import theme
from station_gui.qt.widgets import ElidedLabel, Lamp, Panel, PlainEdit, label, set_property, tool_button
from station_gui.views import words
from station_gui.views.config import WindowConfig

_LAMP = {
    LinkState.DISCONNECTED: theme.DISABLED,
    LinkState.CONNECTING: theme.WARNING,
    LinkState.CONNECTED: theme.GOOD,
    LinkState.LOST: theme.BAD,
}
_USES = {"tcp": ("Wi-Fi", "Over the network"), "radio": ("LoRa", "Over the radio modules"), "both": ("Both", "")}
_FIGURES = ("Map updates", "Observations", "Observation size", "Received", "Round trip")
_LORA_FIGURES = ("LoRa carries", "Signal")
_BOTH_TIP = "Wi-Fi as long as it is there; LoRa takes over without a break when it fails"
ListPorts = Callable[[], list[str]]


class ConnectionPanel(Panel):
    """Emits `connect_asked` with host, port and radio ports (empty where not wanted), or `disconnect_asked`."""

    connect_asked = Signal(str, int, tuple)
    disconnect_asked = Signal()

    def __init__(self, config: WindowConfig, radio_ports: tuple[str, ...], list_ports: ListPorts) -> None:
        super().__init__("Connection")
        self._list_ports = list_ports
        self.host = PlainEdit(config.host)
        self.host.setPlaceholderText("robot's host name or address")
        self.host.setMaxLength(253)
        self.port = PlainEdit(str(config.port))
        self.port.setValidator(QIntValidator(1, 65535, self.port))
        self.port.setFixedWidth(64)
        self.radio = PlainEdit(" ".join(radio_ports))
        self.radio.setPlaceholderText("/dev/ttyACM0:A /dev/ttyACM0:B")
        self.radio.setToolTip("Ports of one or two modules; with :A and :B those of a transceiver")
        self.pick = tool_button("▾", "Choose one of the serial ports there are")
        self.uses = {use: _use_button(use) for use in _USES}
        self._use_group = QButtonGroup(self)
        for button in self.uses.values():
            self._use_group.addButton(button)
        self.uses[config.link].setChecked(True)
        self.button = QPushButton("Connect")
        self.button.setProperty("role", "primary")
        self.lamp = Lamp()
        self.state = ElidedLabel()
        self.recording = ElidedLabel("muted", Qt.TextElideMode.ElideLeft)
        names = (*_FIGURES, "Path", *_LORA_FIGURES)
        self.figures = {name: label(words.NO_VALUE, align=Qt.AlignmentFlag.AlignRight) for name in names}
        self.names = {name: label(name, "muted") for name in names}
        self._link_state = LinkState.DISCONNECTED
        self._is_short = False
        self._grid = QWidget()
        self._lay_out()
        self.button.clicked.connect(self._on_button)
        self.pick.clicked.connect(self._on_pick)
        self._use_group.buttonClicked.connect(lambda _: self._enable())
        for edit in (self.host, self.port, self.radio):
            edit.returnPressed.connect(self._on_return)
            edit.textChanged.connect(self._enable)
        self._enable()

    @property
    def use(self) -> str:
        """Which of `uses` is chosen."""
        return next(use for use, button in self.uses.items() if button.isChecked())

    def set_short(self, is_short: bool) -> None:
        """Where there is little room: the address until it is connected, the figures from then on."""
        self._is_short = is_short
        self._enable()

    def show_view(self, view: OperatorView) -> None:
        self._link_state = view.link_state
        self.lamp.show_colour(_LAMP[view.link_state])
        self.state.show_text(words.link_sentence(view))
        free = view.link_state is LinkState.DISCONNECTED
        self.button.setText("Connect" if free else "Disconnect")
        set_property(self.button, "role", "primary" if free else "plain")
        if not free:
            self._show_target(view.target)
        self._enable()
        for name, text in figure_texts(view).items():
            self.figures[name].setText(text)
        set_property(self.figures["Path"], "tone", path_tone(view))
        has_lora = not free and view.link.health.lora is not None
        for name in _LORA_FIGURES:
            self.figures[name].setVisible(has_lora)
            self.names[name].setVisible(has_lora)
        self.recording.show_text(PurePath(view.recording).as_posix() if view.recording else "not recording")

    def _show_target(self, target: Target) -> None:
        """Somebody else may have chosen where to connect to."""
        radio = " ".join(target.radio_ports)
        if target.host and (target.host, str(target.port)) != (self.host.text().strip(), self.port.text()):
            self.host.setText(target.host)
            self.port.setText(str(target.port))
        if radio and target.radio_ports != self._radio_ports():
            self.radio.setText(radio)
        self.uses["both" if target.host and radio else "radio" if radio else "tcp"].setChecked(True)

    def _lay_out(self) -> None:
        uses = QHBoxLayout()
        uses.setSpacing(6)
        for button in self.uses.values():
            uses.addWidget(button, 1)
        self.body.addLayout(uses)
        address = QHBoxLayout()
        address.setSpacing(6)
        address.addWidget(self.host, 1)
        address.addWidget(self.port)
        self.body.addLayout(address)
        radio = QHBoxLayout()
        radio.setSpacing(6)
        radio.addWidget(self.radio, 1)
        radio.addWidget(self.pick)
        self.body.addLayout(radio)
        self.body.addWidget(self.button)
        state = QHBoxLayout()
        state.addWidget(self.lamp)
        state.addWidget(self.state, 1)
        self.body.addLayout(state)
        self.body.addWidget(self._grid)
        self._lay_out_figures()

    def _lay_out_figures(self) -> None:
        grid = QGridLayout(self._grid)
        grid.setContentsMargins(0, 0, 0, 0)
        grid.setVerticalSpacing(2)
        for row, (name, value) in enumerate(self.figures.items()):
            grid.addWidget(self.names[name], row, 0)
            grid.addWidget(value, row, 1)
        grid.addWidget(label("Recording", "muted"), len(self.figures), 0)
        self.recording.setAlignment(Qt.AlignmentFlag.AlignRight | Qt.AlignmentFlag.AlignVCenter)
        grid.addWidget(self.recording, len(self.figures), 1)
        grid.setColumnStretch(1, 1)

    def _enable(self) -> None:
        free = self._link_state is LinkState.DISCONNECTED
        shown = free or not self._is_short
        wifi, lora = shown and self.use != "radio", shown and self.use != "tcp"
        self._grid.setVisible(not (free and self._is_short))
        for edit in (self.host, self.port):
            edit.setEnabled(free)
            edit.setVisible(wifi)
        for widget in (self.radio, self.pick):
            widget.setEnabled(free)
            widget.setVisible(lora)
        for button in self.uses.values():
            button.setEnabled(free)
            button.setVisible(shown)
        self.button.setEnabled(not free or self._is_complete())

    def _is_complete(self) -> bool:
        wifi = self.use == "radio" or (bool(self.host.text().strip()) and self.port.hasAcceptableInput())
        return wifi and (self.use == "tcp" or bool(self._radio_ports()))

    def _radio_ports(self) -> tuple[str, ...]:
        return tuple(name for name in re.split(r"[\s,]+", self.radio.text()) if name)

    def _on_return(self) -> None:
        if self._link_state is LinkState.DISCONNECTED:
            self._on_button()

    def _on_pick(self) -> None:
        menu = self.port_menu()
        menu.exec(self.pick.mapToGlobal(self.pick.rect().bottomLeft()))
        menu.deleteLater()

    def port_menu(self) -> QMenu:
        """The serial ports there are, each as a transceiver and as a module of its own."""
        menu = QMenu(self)
        ports = self._list_ports()
        for port in ports:
            menu.addAction(f"{port}: transceiver", partial(self.radio.setText, f"{port}:A {port}:B"))
        for port in ports:
            menu.addAction(f"{port}: module", partial(self._add_module, port))
        if not ports:
            menu.addAction("no serial port is plugged in").setEnabled(False)
        return menu

    def _add_module(self, port: str) -> None:
        """Beside the other module, if there is one already."""
        others = [name for name in self._radio_ports() if ":" not in name and name != port]
        self.radio.setText(" ".join([*others[-1:], port]))

    def _on_button(self) -> None:
        if self._link_state is not LinkState.DISCONNECTED:
            self.disconnect_asked.emit()
        elif self._is_complete():
            wifi = self.use != "radio"
            host, port = (self.host.text().strip(), int(self.port.text())) if wifi else ("", 0)
            self.connect_asked.emit(host, port, self._radio_ports() if self.use != "tcp" else ())


def _use_button(use: str) -> QPushButton:
    text, tip = _USES[use]
    button = QPushButton(text)
    button.setCheckable(True)
    button.setToolTip(tip or _BOTH_TIP)
    button.setFocusPolicy(Qt.FocusPolicy.TabFocus)
    return button


def figure_texts(view: OperatorView) -> dict[str, str]:
    """How the link does, a text for each name in the panel; dashes while there is no link."""
    names = (*_FIGURES, "Path", *_LORA_FIGURES)
    if view.link_state is LinkState.DISCONNECTED:
        return dict.fromkeys(names, words.NO_VALUE)
    link, health = view.link, view.link.health
    signals = (words.number(r.rssi_dbm, 0) if r.operates and not r.fault else "off" for r in health.radios)
    values = (
        words.number(link.refresh_hz, 1, "/s"),
        words.number(link.observations_hz, 1, "/s"),
        words.number(link.bytes_per_observation, 0, "B"),
        words.bits_per_second(link.received_bps),
        words.number(link.round_trip_s * 1e3, 0, "ms"),
        words.path_text(view),
        words.NO_VALUE if health.goodput_bps is None else words.bits_per_second(health.goodput_bps),
        f"{' / '.join(signals)} dBm" if health.radios else words.NO_VALUE,
    )
    return dict(zip(names, values, strict=True))


def path_tone(view: OperatorView) -> str:
    """Amber where LoRa has to stand in for Wi-Fi."""
    stands_in = view.link.path is LinkPath.RADIO and view.link.health.wifi is not None
    return "warning" if stands_in else ""
