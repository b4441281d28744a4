"""`robot-app` as a whole, on emulated devices."""

from __future__ import annotations

import gc
import os
import resource
import signal
import socket
import sys
import threading
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest

from robot_app import __main__ as command
from robot_app.check import check_radios
from robot_app.config import DEFAULT_PATH, OMNI_PATH, load_any_config, load_config
from robot_app.drivers.base import DeviceError
from robot_app.drivers.config import DeviceConfig
from robot_app.service import ServiceManager
from shared.config import ConfigError
from shared.link.es920lr.settings import RadioSettings
from shared.link.pairing import read_pairing
from shared.link.radio_config import RadioConfig
from shared.link.tcp import TcpServerLink
from shared.runtime.clock import MonotonicClock
from tools.simulator.devices.es920lr import EmulatedEs920lr
from tools.simulator.devices.robot import EmulatedRobot
from tools.simulator.devices.scip_sensor import Mode
from tools.simulator.radio.channel import RadioChannel
from tools.simulator.radio.ports import PtyRadios
from tools.simulator.radio.timeline import Timeline

PATIENCE_S = 60.0


@pytest.fixture(autouse=True)
def _process_is_left_as_it_was() -> Iterator[None]:
    handlers = {n: signal.getsignal(n) for n in (signal.SIGINT, signal.SIGTERM)}
    interval_s = sys.getswitchinterval()
    priority, highest = resource.getrlimit(resource.RLIMIT_RTPRIO)
    memory, most = resource.getrlimit(resource.RLIMIT_MEMLOCK)
    resource.setrlimit(resource.RLIMIT_RTPRIO, (0, highest))
    resource.setrlimit(resource.RLIMIT_MEMLOCK, (65_536, most))
    yield
    resource.setrlimit(resource.RLIMIT_RTPRIO, (priority, highest))
    resource.setrlimit(resource.RLIMIT_MEMLOCK, (memory, most))
    gc.unfreeze()
    sys.setswitchinterval(interval_s)
    for number, handler in handlers.items():
        signal.signal(number, handler)


class Systemd:
    """Listens where systemd would; sends SIGTERM when `enough` of what it heard says so."""

    def __init__(self, folder: Path, enough: Callable[[list[str]], bool]) -> None:
        self.address = str(folder / "notify")
        self.heard: list[str] = []
        self._enough = enough
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        self._socket.bind(self.address)
        self._socket.settimeout(PATIENCE_S)
        self._thread = threading.Thread(target=self._listen, name="systemd", daemon=True)
        self._thread.start()

    def close(self) -> None:
        self._thread.join(PATIENCE_S)
        self._socket.close()

    def _listen(self) -> None:
        while "STOPPING=1" not in self.heard:
            self.heard.append(self._socket.recv(100).decode())
            if self._enough(self.heard):
                os.kill(os.getpid(), signal.SIGTERM)


def toml_of(robot: EmulatedRobot, folder: Path) -> Path:
    """The file that comes with the app, with the emulated ports in it."""
    config = robot.config
    text = DEFAULT_PATH.read_text("utf-8").replace("/dev/ttyACM0", config.scanner.port)
    text = text.replace("[devices.drive] ", f'[devices.drive]\npwm_chip = "{config.drive.pwm_chip}" ')
    text += f'[devices.thermometer]\nzone = "{config.thermometer.zone}"\n'
    path = folder / "robot.toml"
    path.write_text(text, "utf-8")
    return path


def omni_toml_of(robot: EmulatedRobot, folder: Path) -> Path:
    """The same of the omnidirectional robot."""
    config = robot.config
    text = OMNI_PATH.read_text("utf-8").replace("/dev/ttyACM0", config.scanner.port)
    text = text.replace("/sys/class/pwm/pwmchip2", config.drive.pwm_chip)
    text += f'[devices.thermometer]\nzone = "{config.thermometer.zone}"\n'
    path = folder / "omni.toml"
    path.write_text(text, "utf-8")
    return path


def call(monkeypatch: pytest.MonkeyPatch, *arguments: str | Path) -> int:
    monkeypatch.setattr(sys, "argv", ["robot-app", *map(str, arguments)])
    return command.main()


@pytest.mark.parametrize("file_of", [toml_of, omni_toml_of])
def test_the_robot_runs_until_it_is_told_to_end(
    robot: EmulatedRobot,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    caplog: pytest.LogCaptureFixture,
    file_of: Callable[[EmulatedRobot, Path], Path],
) -> None:
    robot.keeps_measuring = True
    systemd = Systemd(tmp_path, enough=lambda heard: heard.count("WATCHDOG=1") == 2)
    monkeypatch.setenv("NOTIFY_SOCKET", systemd.address)
    code = call(monkeypatch, "--config", file_of(robot, tmp_path), "--bind", "127.0.0.1", "--port", "0")
    systemd.close()
    assert code == 0
    assert systemd.heard[0] == "READY=1"
    assert systemd.heard[-1] == "STOPPING=1"
    assert robot.is_released
    robot.close()
    assert robot.sensor.mode is Mode.IDLE
    assert [r.getMessage() for r in caplog.records if r.levelname == "ERROR"] == []


def test_a_drive_that_fails_for_ever_is_told_and_not_ended_by_the_watchdog(
    robot: EmulatedRobot, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    robot.keeps_measuring = True
    systemd = Systemd(tmp_path, enough=lambda heard: heard.count("WATCHDOG=1") == 2)
    monkeypatch.setenv("NOTIFY_SOCKET", systemd.address)

    def gone(*_: object) -> None:
        raise DeviceError("drive: is gone")

    monkeypatch.setattr("robot_app.drivers.ackermann_drive.AckermannDrive.set", gone)
    path = toml_of(robot, tmp_path)
    assert call(monkeypatch, "--config", path, "--bind", "127.0.0.1", "--port", "0") == 0
    systemd.close()
    assert systemd.heard.count("WATCHDOG=1") == 2


def test_the_check_prints_a_table(
    robot: EmulatedRobot, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    robot.keeps_measuring = True
    path = toml_of(robot, tmp_path)
    monkeypatch.setattr("robot_app.check_system.highest_priority", lambda: 80)
    assert call(monkeypatch, "--config", path, "check") == 0
    robot.remove("imu")
    assert call(monkeypatch, "--config", path, "check") == 1
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) == 2 * 13
    assert lines[0].split()[:3] == ["device", "where", "found"]
    assert [line.split()[0] for line in lines[9:13]] == ["real", "card", "clock", "pairing"]
    assert " yes " in lines[4]
    assert " NO " in lines[17]


def test_the_check_leaves_the_chips_alone_that_a_running_app_reads(
    robot: EmulatedRobot, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    robot.keeps_measuring = True
    drive = robot.config.drive
    robot.gpio.used |= {drive.forward_line, drive.reverse_line}
    assert call(monkeypatch, "--config", toml_of(robot, tmp_path), "check") == 1
    lines = capsys.readouterr().out.splitlines()
    assert "another program uses them" in lines[1]
    assert [line.split()[0] for line in lines if "using it; sudo systemctl stop" in line] == [
        "power",
        "imu",
        "magnetometer",
    ]
    robot.gpio.used.clear()


def test_the_wheels_of_the_omnidirectional_robot_are_checked(
    robot: EmulatedRobot, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    robot.keeps_measuring = True
    monkeypatch.setattr("robot_app.check_system.highest_priority", lambda: 80)
    assert call(monkeypatch, "--config", omni_toml_of(robot, tmp_path), "check") == 0
    assert "the three motors are free" in capsys.readouterr().out
    assert robot.is_released


def test_a_missing_device_is_one_line_and_a_failure_after_which_the_service_tries_again(
    robot: EmulatedRobot, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    robot.remove("imu")
    assert call(monkeypatch, "--config", toml_of(robot, tmp_path), "--port", "0") == 1
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("robot-app: imu LSM9DS1 at I2C bus 1, address 0x6b: does not answer")
    assert robot.is_released


def test_a_port_in_use_is_one_line_and_a_failure(
    robot: EmulatedRobot, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    other = TcpServerLink("127.0.0.1", 0, MonotonicClock())
    port = str(other.port)
    assert call(monkeypatch, "--config", toml_of(robot, tmp_path), "--bind", "127.0.0.1", "--port", port) == 1
    other.close()
    (line,) = capsys.readouterr().err.splitlines()
    assert port in line


def test_a_misspelt_key_is_one_line_and_exit_code_2(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "robot.toml"
    path.write_text(DEFAULT_PATH.read_text("utf-8").replace("forward_line", "foward_line"), "utf-8")
    assert call(monkeypatch, "--config", path) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert "devices.drive.foward_line, did you mean devices.drive.forward_line?" in line


@pytest.mark.parametrize("path", [DEFAULT_PATH, OMNI_PATH])
@pytest.mark.parametrize(
    ("table", "key", "words"),
    [
        ("control", "max_speed_mps = -0.3", "max_speed_mps must be above 0"),
        ("control", "max_speed_mps = 0.5", "at most 0.46"),
        ("control.speed", "acceleration_mps2 = -0.8", "control.speed.acceleration_mps2 must not be negative"),
        ("odometry", "standing_s = -1.0", "odometry.standing_s must not be negative"),
        ("mission", "max_path_m = -1.0", "mission.max_path_m must not be negative"),
        ("safety.wheels", "pushing_duty = -0.1", "safety.wheels.pushing_duty must not be negative"),
    ],
)
def test_a_number_that_could_only_do_harm_is_refused_by_its_key(
    path: Path, table: str, key: str, words: str, tmp_path: Path
) -> None:
    name = key.partition(" = ")[0]
    kept = [line for line in path.read_text(encoding="utf-8").splitlines() if not line.startswith(f"{name} =")]
    here = kept.index(f"[{table}]") + 1 if f"[{table}]" in kept else None
    lines = [*kept, f"[{table}]", key] if here is None else [*kept[:here], key, *kept[here:]]
    (tmp_path / "robot.toml").write_text("\n".join(lines), encoding="utf-8")
    with pytest.raises(ConfigError, match=words):
        load_any_config(tmp_path / "robot.toml")


def test_a_new_pairing_file_can_be_read_and_is_not_written_over(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "keys" / "pairing.pem"
    assert call(monkeypatch, "--new-pairing", path) == 0
    assert capsys.readouterr().out.strip() == f"{path}: {read_pairing(path).fingerprint}"
    assert call(monkeypatch, "--new-pairing", path) == 2
    assert "is there already" in capsys.readouterr().err


def test_the_radios_are_checked_one_by_one() -> None:
    clock = MonotonicClock()
    timeline = Timeline(clock)
    air = RadioChannel(timeline, np.random.default_rng(1))
    with PtyRadios(clock, timeline, [EmulatedEs920lr(timeline, air, "module", RadioSettings(), (0.0, 0.0))]) as radios:
        ports = (radios.paths[0], "/dev/no-such-port")
        good, bad = check_radios(RadioConfig(ports), clock)
    assert (good.device, good.found, good.words) == ("radio A", True, "operates at 500 kHz, SF7, channel 1")
    (off,) = check_radios(RadioConfig(("/dev/ttyAMA77",)), clock)
    assert "dtoverlay=uart2" in off.words
    assert (bad.device, bad.found) == ("radio B", False)
    assert "there is no such port" in bad.words


def test_the_file_that_comes_along_holds_the_defaults() -> None:
    assert load_config(None).devices == DeviceConfig()


def test_systemd_hears_an_abstract_address() -> None:
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as listener:
        listener.bind(f"\0robot-app-{os.getpid()}")
        listener.settimeout(PATIENCE_S)
        ServiceManager(f"@robot-app-{os.getpid()}").ready()
        assert listener.recv(100) == b"READY=1"


def test_without_systemd_nothing_is_said_and_nothing_fails(caplog: pytest.LogCaptureFixture) -> None:
    ServiceManager(None).ready()
    deaf = ServiceManager("/nonexistent/notify")
    deaf.ready()
    deaf.alive()
    assert [r.getMessage() for r in caplog.records] == ["systemd does not listen: [Errno 2] No such file or directory"]
