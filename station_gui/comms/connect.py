"""Makes the link that the operator asked for."""

from __future__ import annotations

import secrets
from dataclasses import replace
from pathlib import Path

from shared.link.base import Link, LinkError
from shared.link.failover.base import SpeaksPlainly
from shared.link.failover.link import Failover, is_greeting
from shared.link.failover.wifi_ends import Dialler, NoRadio
from shared.link.pairing import Pairing, PairingError, read_pairing
from shared.link.radio_config import RadioConfig
from shared.link.radios import open_pair
from shared.link.tcp import TcpClientLink
from shared.runtime.clock import Clock
from station_gui.comms.target import Target

_FIRST_WORD_S = 1.0  # a robot greets at once
_WIFI_ALONE = "the robot speaks over Wi-Fi alone (link.use of its robot.toml is not both): going on without LoRa"


class Connector:
    """`pairing_file`: empty where anybody's robot is spoken with; LoRa needs one."""

    def __init__(self, clock: Clock, timeout_s: float, pairing_file: str, radio: RadioConfig) -> None:
        self._clock = clock
        self._timeout_s = timeout_s
        self._pairing_file = pairing_file
        self._radio = radio
        self._without_radio: Target | None = None  # whose robot has just said that it has none

    def __call__(self, target: Target) -> Link:
        """Raises `LinkError`."""
        pairing = self._pairing(needed=bool(target.radio_ports))
        has_no_radio, self._without_radio = self._without_radio == target, None
        if not target.radio_ports or has_no_radio:
            link = self._dial(target, pairing)
            return link if pairing is None else self._as_the_robot_speaks(link, target, pairing)
        assert pairing is not None
        try:
            config = replace(self._radio, ports=target.radio_ports)
        except ValueError as error:
            raise LinkError(f"radio: {error}") from error
        has_wifi = bool(target.host)
        pair = open_pair(config, pairing, self._clock, is_robot=False, has_wifi=has_wifi)
        if not has_wifi:
            return pair
        dialler = Dialler(lambda: self._dial_failover(target, pairing))
        return Failover(dialler, pair, self._clock, secrets.token_bytes, when_closed=dialler.close)

    def _dial(self, target: Target, pairing: Pairing | None) -> TcpClientLink:
        return TcpClientLink(target.host, target.port, self._timeout_s, pairing)

    def _dial_failover(self, target: Target, pairing: Pairing | None) -> TcpClientLink:
        """Raises `SpeaksPlainly` where the robot has no radios; the next link to it is one of Wi-Fi alone."""
        link = self._dial(target, pairing)
        try:
            first = link.peek(_FIRST_WORD_S)
        except LinkError:
            link.close()
            raise
        if first is not None and not is_greeting(first):
            link.close()
            self._without_radio = target
            raise SpeaksPlainly(_WIFI_ALONE)
        return link

    def _as_the_robot_speaks(self, link: TcpClientLink, target: Target, pairing: Pairing) -> Link:
        """A robot that has radios too greets as a failover does; without radios of ours Wi-Fi is all there is."""
        try:
            first = link.peek(_FIRST_WORD_S)
        except LinkError:
            link.close()
            raise
        if first is None or not is_greeting(first):
            return link
        dialler = Dialler(lambda: self._dial(target, pairing), link)
        return Failover(dialler, NoRadio(), self._clock, secrets.token_bytes, when_closed=dialler.close)

    def _pairing(self, needed: bool) -> Pairing | None:
        if self._pairing_file:
            return read_pairing(Path(self._pairing_file).expanduser())
        if needed:
            raise PairingError(
                "LoRa needs a pairing file: make one with `radio-config key new`, copy it to the robot, and name it in "
                "pairing of station.toml"
            )
        return None
