from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from shared.runtime.clock import MonotonicClock
from tools.simulator.devices.pty_server import PtyServer
from tools.simulator.devices.scip_sensor import ScipSensor

SCIP_DATA = Path(__file__).resolve().parents[3] / ".." / "shared" / "data" / "scip"
BEAMS = 682
Plug = Callable[[ScipSensor], PtyServer]


@pytest.fixture
def scip_data() -> Path:
    if not SCIP_DATA.is_dir():
        pytest.skip("the captured SCIP sessions are not there: ../shared/data/scip")
    return SCIP_DATA


@pytest.fixture
def values_mm() -> NDArray[np.int_]:
    """A scan with every code below 20 and every range up to the longest that two characters hold."""
    values = np.linspace(20, 4095, BEAMS).astype(np.int_)
    values[:20] = np.arange(20)
    return values


@pytest.fixture
def clock() -> MonotonicClock:
    return MonotonicClock()


@pytest.fixture
def plug() -> Iterator[Plug]:
    """Puts a sensor on a pseudo-terminal."""
    servers: list[PtyServer] = []

    def plug_in(sensor: ScipSensor, baud_rate: Callable[[], int] | None = None) -> PtyServer:
        servers.append(PtyServer(sensor.receive, baud_rate))
        return servers[-1]

    yield plug_in
    for server in servers:
        server.close()
