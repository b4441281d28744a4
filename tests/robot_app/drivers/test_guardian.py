"""The guardian is a real process here: what it must survive is the death of another."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from robot_app.drivers.base import DeviceError
from robot_app.drivers.guardian.guardian import Guardian

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
