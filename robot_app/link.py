"""Makes the robot's end of the link that `[link]` names."""

from __future__ import annotations

import logging
import secrets
from dataclasses import dataclass
from pathlib import Path

from robot_app.config import CommonConfig
from robot_app.uplink import BUSY
from shared.link.base import Link
from shared.link.failover.link import Failover
from shared.link.failover.watch import FailoverConfig
from shared.link.failover.wifi_ends import serve
from shared.link.pairing import Pairing, read_pairing
from shared.link.radio_pair.link import RadioPair
from shared.link.radios import open_pair
from shared.link.tcp import TcpServerLink
from shared.runtime.clock import Clock

_log = logging.getLogger(__name__)
_ONLY_THIS_MACHINE = ("127.0.0.1", "::1", "localhost")
_LISTEN_EVERY_S = 0.02  # newcomers come in when the server is asked


@dataclass(frozen=True, slots=True)
class OpenLink:
    link: Link
    port: int | None  # it listens here; None without Wi-Fi
    where: str  # for the log


def open_link(config: CommonConfig, clock: Clock) -> OpenLink:
    """Raises `LinkError`: a port in use, no pairing file."""
    c = config.link
    pairing = read_pairing(Path(c.pairing).expanduser()) if c.pairing else None
    at = f"LoRa at {' and '.join(config.radio.ports)}"
    if c.use == "tcp":
        if pairing is None and c.bind not in _ONLY_THIS_MACHINE:
            _log.warning(
                "link.pairing is empty: whoever is in this network can drive the robot, and read what it sees; "
                "make a pairing file with `robot-app --new-pairing`"
            )
        server = TcpServerLink(c.bind, c.port, clock, BUSY, pairing)
        return OpenLink(server, server.port, f"{c.bind}:{server.port}")
    assert pairing is not None  # the configuration has been checked
    if c.use == "radio":
        return OpenLink(_open_pair(config, pairing, clock), None, at)
    server = TcpServerLink(c.bind, c.port, clock, BUSY, pairing)
    pair = _open_pair(config, pairing, clock)
    link = Failover(
        serve(server), pair, clock, secrets.token_bytes, FailoverConfig(reconnect_s=_LISTEN_EVERY_S), server.close
    )
    return OpenLink(link, server.port, f"{c.bind}:{server.port} and {at}")


def _open_pair(config: CommonConfig, pairing: Pairing, clock: Clock) -> RadioPair:
    return open_pair(config.radio, pairing, clock, is_robot=True, has_wifi=config.link.use == "both")
