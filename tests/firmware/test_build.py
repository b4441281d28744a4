"""The commands that build and upload the firmware, and what they say when they cannot."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

import pytest

from shared.link.transceiver import Transceiver
from shared.runtime.clock import MonotonicClock
from tools import gen_protocol
from tools.simulator.devices.mega import LiveMega
from tools.simulator.devices.mega_build import ROOT, MegaFiles

FOLDER = ROOT / "arduino" / "transceiver"
TIMEOUT_S = 60.0


def shell(script: str, path: Path | None = None, **environment: str) -> subprocess.CompletedProcess[str]:
    """Run one of the firmware's scripts; `path`: the only folder in which it finds programs."""
    environment = {"PATH": "/usr/local/bin:/usr/bin:/bin" if path is None else str(path), **environment}
    return subprocess.run(
        ["/bin/sh", str(FOLDER / script)],
        env=environment,
        capture_output=True,
        text=True,
        timeout=TIMEOUT_S,
        check=False,
    )


@pytest.fixture
def bare_path(tmp_path: Path) -> Path:
    for program in ("dirname",):
        found = shutil.which(program)
        assert found is not None
        (tmp_path / program).symlink_to(found)
    return tmp_path


def test_the_header_is_that_of_the_tables() -> None:
    assert gen_protocol.HEADER.read_text("utf-8") == gen_protocol.header(), "run: make firmware"


def test_a_build_prints_what_it_takes_of_the_mega(mega_files: MegaFiles) -> None:
    done = shell("build.sh")
    assert done.returncode == 0, done.stderr
    assert "transceiver.hex" in done.stdout
    assert "RAM" in done.stdout
    assert mega_files.firmware.is_file()


@pytest.mark.parametrize(("script", "tool"), [("build.sh", "avr-gcc"), ("flash.sh", "avrdude")])
def test_a_missing_tool_is_named_in_one_line(script: str, tool: str, bare_path: Path) -> None:
    done = shell(script, bare_path)
    assert done.returncode == 1
    assert done.stderr.count("\n") == 1
    assert f"{tool} is missing; install it: sudo apt-get install" in done.stderr


@pytest.mark.parametrize(
    ("port", "complaint"), [("", "PORT=/dev/ttyACM0"), ("/dev/ttyACM77", "is the Mega plugged in")]
)
def test_a_missing_port_is_named_in_one_line(port: str, complaint: str) -> None:
    if shutil.which("avrdude") is None:
        pytest.skip("avrdude is not installed")
    done = shell("flash.sh", PORT=port)
    assert done.returncode == 1
    assert done.stderr.count("\n") == 1
    assert complaint in done.stderr


def test_the_firmware_is_uploaded_through_the_real_boot_loader_and_runs(
    mega_files: MegaFiles, boot_loader: Path
) -> None:
    if shutil.which("avrdude") is None:
        pytest.skip("avrdude is not installed")
    empty = MegaFiles(mega_files.host, boot_loader)
    with LiveMega(empty) as mega:
        done = shell("flash.sh", PORT=mega.usb, HEX=str(mega_files.firmware))
        assert done.returncode == 0, done.stderr
        transceiver = Transceiver(mega.usb, MonotonicClock(), 30.0)
        assert transceiver.health.firmware == (1, 0)
        transceiver.close()
