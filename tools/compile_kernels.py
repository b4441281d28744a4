"""Compiles every kernel into its cache by running a few seconds of a mission; `make` calls it when one has changed."""

from __future__ import annotations

import logging
import sys
import tempfile
import time
from pathlib import Path

from robot_app.config import load_config as load_robot
from shared.protocol.compact.warm_up import warm_up
from station_gui.config import load_config as load_station
from station_gui.planning.rehearsal import rehearse
from tools.simulator.lockstep import Lockstep
from tools.simulator.scenario import find_scenario

_STAND_S, _DRIVE_S = 0.5, 2.0


def main() -> int:
    """Quiet but for one line."""
    print("compiling kernels (half a minute or so, once) ...", flush=True)
    logging.disable(logging.WARNING)
    began_s = time.monotonic()
    warm_up()
    station = load_station(None)
    system = Lockstep(find_scenario("lab"), 1, load_robot(None), station)
    system.station.connect("loopback", 0)
    system.run(_STAND_S)
    system.station.start()
    system.run(_DRIVE_S)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "compile.labmap"
        system.station.save_map(path)
        system.station.open_map(path, localise=False)
        system.run(_DRIVE_S)
    system.close()
    system.station.finish_mapping()
    rehearse()
    print(f"compiled in {time.monotonic() - began_s:.0f} s")
    return 0


if __name__ == "__main__":
    sys.exit(main())
