"""`radio-config` on the radios of a transceiver: a process of its own, the real hex, emulated modules, real time."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import numpy as np

from shared.link.es920lr.settings import RadioSettings
from shared.runtime.clock import MonotonicClock
from tests.shared.link.radio_rig import STATION, operating
from tools.simulator.devices.es920lr import EmulatedEs920lr, State
from tools.simulator.devices.mega_build import MegaFiles
from tools.simulator.devices.mega_radios import MegaRadios
from tools.simulator.radio.channel import RadioChannel
from tools.simulator.radio.ports import PtyRadios
from tools.simulator.radio.timeline import Timeline

ROOT = Path(__file__).resolve().parents[2]


def radio_config(*arguments: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "tools.radio_config", *arguments]
    return subprocess.run(command, cwd=ROOT, text=True, capture_output=True, timeout=120, check=False)


def test_the_transceiver_resets_the_module_that_is_to_be_asked(mega_files: MegaFiles) -> None:
    """Nobody has to switch any power off; afterwards both modules do what they did before."""
    clock = MonotonicClock()
    timeline = Timeline(clock)
    channel = RadioChannel(timeline, np.random.default_rng(1))
    first = EmulatedEs920lr(timeline, channel, "A", operating(STATION))
    second = EmulatedEs920lr(timeline, channel, "B", RadioSettings())
    with MegaRadios(mega_files, (first, second)) as mega, PtyRadios(clock, timeline, [], mega.wires) as air:
        mega.on_air = air.do
        usb = mega.mega.usb
        done = radio_config("copy", f"{usb}:A", f"{usb}:B", "--save", "--json")
        assert done.returncode == 0, done.stderr
        assert "Switch its power" not in done.stderr
        assert json.loads(done.stdout)["copied"][0]["saved"]
    assert (first.state, first.flash) == (State.OPERATION, operating(STATION))
    assert (second.flash.own_id, second.flash.destination_id, second.flash.bandwidth_hz) == (1, 2, 500_000)
