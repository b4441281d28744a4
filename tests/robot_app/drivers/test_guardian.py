"""The guardian is a real process here: what it must survive is the death of another."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from robot_app.drivers.base import DeviceError
from robot_app.drivers.guardian import program
from robot_app.drivers.guardian.guardian import Guardian, Will

_PATIENCE_S = 10.0
_APP = """
import sys, time
from pathlib import Path
from robot_app.drivers.guardian.guardian import Guardian
guardian = Guardian([Path(name) for name in sys.argv[1:]])
for name in sys.argv[1:]:
    Path(name).write_text("25000")
print("drives", flush=True)
while True:
    guardian.alive()
    time.sleep(0.01)
"""


@pytest.fixture
def duties(tmp_path: Path) -> list[Path]:
    files = [tmp_path / "left", tmp_path / "right"]
    for file in files:
        file.write_text("0\n")
    return files


def wait_for(condition: Callable[[], bool]) -> None:
    until_s = time.monotonic() + _PATIENCE_S
    while not condition():
        assert time.monotonic() < until_s
        time.sleep(0.002)


def are_cut(files: list[Path]) -> bool:
    return all(file.read_text().split("\n")[0] == "0" for file in files)


@pytest.mark.parametrize("how", [signal.SIGKILL, signal.SIGSTOP])
def test_an_app_that_is_killed_or_stopped_leaves_no_motor_running(duties: list[Path], how: signal.Signals) -> None:
    with subprocess.Popen([sys.executable, "-c", _APP, *map(str, duties)], stdout=subprocess.PIPE) as app:
        try:
            assert app.stdout is not None
            app.stdout.readline()
            assert not are_cut(duties)
            os.kill(app.pid, how)
            wait_for(lambda: are_cut(duties))
        finally:
            app.kill()


def test_an_app_that_ends_in_order_takes_its_guardian_along(duties: list[Path]) -> None:
    guardian = Guardian(duties)
    guardian.alive()
    duties[0].write_text("9\n")
    guardian.close()
    guardian.close()
    assert are_cut(duties)
    with pytest.raises(DeviceError, match="closed"):
        guardian.alive()


def test_the_orders_that_end_an_app_do_not_end_its_guardian(duties: list[Path]) -> None:
    guardian = Guardian(duties)
    for number in (signal.SIGTERM, signal.SIGINT, signal.SIGHUP):
        os.kill(guardian.process_id, number)
    guardian.alive()
    assert Path(f"/proc/{guardian.process_id}").exists()
    guardian.close()


def test_nothing_moves_without_a_guardian(duties: list[Path]) -> None:
    guardian = Guardian(duties)
    os.kill(guardian.process_id, signal.SIGKILL)
    os.waitpid(guardian.process_id, 0)
    with pytest.raises(DeviceError, match="has ended"):
        guardian.alive()
    guardian.close()


def test_a_motor_that_cannot_be_guarded_is_not_opened(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(DeviceError, match="does not start"):
        Guardian([tmp_path / "none"])


class Bridge:
    """The wires of an H-bridge: what was written to its duty file and to its lines, in this order."""

    def __init__(self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        duty = tmp_path / "duty"
        duty.write_text("25000\n")
        self.app, self._app_end = os.pipe()
        self.story: list[str] = []
        self.has_lines = True
        self.after_pushes: Callable[[], None] = lambda: None
        monkeypatch.setattr("fcntl.ioctl", self._ioctl)
        monkeypatch.setattr("os.pwrite", self._pwrite)
        self._file = os.open(duty, os.O_WRONLY)
        self.motors = program.Motors([self._file], lines=7)

    def say(self, push_ns: int) -> None:
        os.write(self._app_end, program.WILL.pack(push_ns, 0b10))

    def hang_up(self) -> None:
        os.close(self._app_end)

    def close(self) -> None:
        os.close(self.app)
        os.close(self._file)

    @property
    def pushes_ns(self) -> list[int]:
        return [int(entry) for entry in self.story if entry.isdigit() and entry != "0"]

    def _ioctl(self, lines: int, request: int, values: bytes) -> None:
        assert (lines, request, len(values)) == (7, 0xC010B40F, 16)
        if not self.has_lines:
            raise OSError(5, "Input/output error")
        bits, mask = program.LINE_VALUES.unpack(values)
        assert mask == 0b11
        self.story.append(f"lines {bits:02b}")

    def _pwrite(self, file: int, data: bytes, _: int) -> int:
        assert file == self._file
        self.story.append(data.decode().strip())
        if data != b"0\n":
            self.after_pushes()
        return len(data)


@pytest.fixture
def bridge(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Bridge]:
    bridge = Bridge(tmp_path, monkeypatch)
    yield bridge
    bridge.close()


def test_a_car_whose_app_is_gone_is_braked_with_its_bridge_turned_round_without_current(bridge: Bridge) -> None:
    bridge.say(10_000)
    bridge.say(30_000)  # the newest counts
    bridge.hang_up()
    program.guard(bridge.app, 60.0, bridge.motors)
    assert bridge.story[:2] == ["0", "lines 10"]
    assert bridge.story[-2:] == ["0", "lines 00"]
    assert 25_000 < bridge.pushes_ns[0] <= 30_000
    assert bridge.pushes_ns == sorted(bridge.pushes_ns, reverse=True)
    assert bridge.pushes_ns[-1] < 5_000


def test_an_app_that_is_there_again_ends_the_braking_at_once_and_a_will_is_carried_out_once(bridge: Bridge) -> None:
    bridge.say(30_000)
    waking = [lambda: bridge.say(20_000), bridge.hang_up]
    bridge.after_pushes = lambda: waking.pop(0)() if waking else None
    program.guard(bridge.app, 0.01, bridge.motors)
    assert bridge.story[:5] == ["0", "lines 10", bridge.story[2], "0", "lines 00"]  # the first push is the last one
    assert bridge.pushes_ns[1] <= 20_000
    assert bridge.story.count("lines 10") == 2


def test_a_car_that_was_cut_on_purpose_or_has_no_lines_is_only_cut(bridge: Bridge) -> None:
    bridge.say(30_000)
    bridge.say(0)
    bridge.hang_up()
    program.guard(bridge.app, 60.0, bridge.motors)
    assert bridge.story == ["0"]
    bridge.has_lines = False
    bridge.motors.brake(30_000, 0b10, bridge.app, app_is_gone=True)
    assert bridge.pushes_ns == []
    assert bridge.story[-1] == "0"


def test_a_will_reaches_the_guardian_as_the_lines_levels_bit_by_bit(duties: list[Path]) -> None:
    guardian = Guardian(duties)
    guardian.alive(Will(12_000, (False, True)))
    guardian.close()  # it has no lines: the motors are cut and nothing is pushed
    assert are_cut(duties)
