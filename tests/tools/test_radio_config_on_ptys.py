"""`radio-config` as a user runs it: a process of its own, modules at pseudo-terminals, real time."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
import threading
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from shared.link.es920lr.settings import RadioSettings
from shared.runtime.clock import MonotonicClock
from tests.shared.link.radio_rig import ROBOT, STATION, operating
from tools.simulator.devices.es920lr import EmulatedEs920lr, State
from tools.simulator.radio.channel import RadioChannel
from tools.simulator.radio.ports import PtyRadios
from tools.simulator.radio.timeline import Timeline

ROOT = Path(__file__).resolve().parents[2]


class Desk:
    """One module that operates and one from the factory, and a user who does as he is told."""

    def __init__(self) -> None:
        clock = MonotonicClock()
        timeline = Timeline(clock)
        channel = RadioChannel(timeline, np.random.default_rng(1))
        self.modules = [
            EmulatedEs920lr(timeline, channel, "robot", operating(ROBOT)),
            EmulatedEs920lr(timeline, channel, "station", RadioSettings(), (10.0, 0.0)),
        ]
        self.radios = PtyRadios(clock, timeline, self.modules)
        self.ports = self.radios.paths

    def run(self, *arguments: str) -> subprocess.CompletedProcess[str]:
        command = [sys.executable, "-m", "tools.radio_config", *arguments]
        with subprocess.Popen(command, cwd=ROOT, text=True, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as process:
            said: list[str] = []
            user = threading.Thread(target=self._read, args=(process, said))
            user.start()
            assert process.stdout is not None
            out = process.stdout.read()
            user.join(30.0)
        return subprocess.CompletedProcess(command, process.returncode, out, "".join(said))

    def _read(self, process: subprocess.Popen[str], said: list[str]) -> None:
        assert process.stderr is not None
        for line in process.stderr:
            said.append(line)
            if "Switch its power off and on now" in line:
                module = self.modules[self.ports.index(line.partition(":")[0])]
                self.radios.do(module.reset)


@pytest.fixture
def desk() -> Iterator[Desk]:
    made = Desk()
    with made.radios:
        yield made


def test_a_module_is_copied_to_its_partner(desk: Desk) -> None:
    done = desk.run("copy", *desk.ports, "--save", "--json")
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout)["copied"][0]["changed"]["own_id"] == {"from": "1", "to": "2"}
    assert desk.modules[0].state is State.OPERATION
    held = desk.modules[1].flash
    assert (held.own_id, held.destination_id, held.bandwidth_hz, held.baud_rate) == (2, 1, 500_000, 115_200)
    assert STATION.pan_id == held.pan_id


def test_a_plug_that_is_pulled_is_told_in_one_line(desk: Desk) -> None:
    desk.radios.do(desk.modules[1].power_off)
    timer = threading.Timer(1.0, desk.radios.unplug, (1,))
    timer.start()
    done = desk.run("show", desk.ports[1])
    timer.join()
    assert done.returncode == 2
    assert len(done.stderr.splitlines()) == 1
    assert f"{desk.ports[1]}: lost" in done.stderr
    assert "Is the cable still plugged in?" in done.stderr


def test_the_far_end_answers_the_range_test_until_ctrl_c(desk: Desk) -> None:
    air = ("--sf", "7", "--bandwidth-hz", "500000")
    desk.radios.do(lambda: setattr(desk.modules[0], "flash", RadioSettings()))
    desk.radios.do(desk.modules[0].reset)
    command = [sys.executable, "-m", "tools.radio_config", "echo", desk.ports[1], *air]
    with subprocess.Popen(command, cwd=ROOT, text=True, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as far:
        assert far.stderr is not None
        assert "answers test packets, SF7 at 500 kHz, channel 1" in far.stderr.readline()
        done = desk.run("range-test", desk.ports[0], *air, "--count", "5", "--json")
        far.send_signal(signal.SIGINT)
        answered, said = far.communicate(timeout=30.0)
    assert done.returncode == 0, done.stderr
    there, back = json.loads(done.stdout)["results"]
    assert (there["sent"], there["received"], back["received"]) == (5, 5, 5)
    assert there["median_dbm"] == back["median_dbm"] == -46
    assert "until you switch its power off and on" in done.stderr
    assert answered.splitlines() == [f"packet {number}: -46 dBm" for number in range(5)]
    assert far.returncode == 130
    assert said.endswith("radio-config: interrupted\n")
