"""The whole command: a terminal, emulated devices, a robot.toml."""

from __future__ import annotations

import os
import signal
import sys
import threading
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from robot_app import __main__ as command
from robot_app.calibrate.command import PROCEDURES, calibrate
from robot_app.calibrate.guide import CalibrationError, Terminal
from robot_app.config import DEFAULT_PATH, RobotConfig, load_any_config, load_config
from shared.runtime.clock import ManualClock, MonotonicClock
from tests.robot_app.calibrate.scripted import Operator
from tools.simulator.devices.robot import EmulatedRobot


class Keyboard:
    """What is typed, at the other end of a pipe; the test process's own stdin meanwhile."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        reading, self._writing = os.pipe()
        self._stdin = os.fdopen(reading)
        monkeypatch.setattr(sys, "stdin", self._stdin)

    def type(self, text: str) -> None:
        os.write(self._writing, text.encode())

    def leave(self) -> None:
        if self._writing >= 0:
            os.close(self._writing)
            self._writing = -1

    def close(self) -> None:
        self.leave()
        self._stdin.close()


@pytest.fixture
def keyboard(monkeypatch: pytest.MonkeyPatch) -> Iterator[Keyboard]:
    keys = Keyboard(monkeypatch)
    yield keys
    keys.close()


@pytest.fixture
def toml(robot: EmulatedRobot, tmp_path: Path) -> Path:
    path = tmp_path / "mine.toml"
    path.write_text(DEFAULT_PATH.read_text("utf-8"), "utf-8")
    return path


def call(monkeypatch: pytest.MonkeyPatch, *arguments: str | Path) -> int:
    monkeypatch.setattr(sys, "argv", ["robot-app", *map(str, arguments)])
    return command.main()


def test_the_power_monitor_is_calibrated_and_written(
    toml: Path, keyboard: Keyboard, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    keyboard.type("seven\n7.4\nyes\n")  # 2.4 V at the pin
    assert call(monkeypatch, "--config", toml, "calibrate", "power") == 0
    assert load_config(toml).devices.power.battery_divider == pytest.approx(7.4 / 2.4, rel=1e-3)
    out = capsys.readouterr().out
    assert "A number from 1 to 60, please." in out
    assert "devices.power.battery_divider" in out
    assert "what it was before is in" in out
    assert toml.with_name("mine.toml.before-calibration").read_text("utf-8") == DEFAULT_PATH.read_text("utf-8")


def test_nothing_is_written_without_a_yes(
    toml: Path, keyboard: Keyboard, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    keyboard.type("7.4\ny\n")
    assert call(monkeypatch, "--config", toml, "calibrate", "power") == 0
    assert toml.read_text("utf-8") == DEFAULT_PATH.read_text("utf-8")
    assert "Nothing was written." in capsys.readouterr().out


@pytest.mark.usefixtures("robot")
def test_the_file_that_comes_along_is_never_written(
    keyboard: Keyboard, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    before = DEFAULT_PATH.read_text("utf-8")
    keyboard.type("7.4\nyes\n")
    assert call(monkeypatch, "calibrate", "power") == 0
    assert DEFAULT_PATH.read_text("utf-8") == before
    assert "name your robot.toml with --config" in capsys.readouterr().out


class WheelsInTheAir:
    """Turns the encoders as the bridge's wires say, backwards where its motor is connected the other way round."""

    def __init__(self, robot: EmulatedRobot, way: int) -> None:
        self._robot, self._way = robot, way
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, name="wheels", daemon=True)

    def __enter__(self) -> WheelsInTheAir:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._stop.set()
        self._thread.join(5.0)

    def _run(self) -> None:
        robot, lines = self._robot, self._robot.gpio.levels
        while not self._stop.wait(0.01):
            duty = robot.pwm.value(1, "duty_cycle") / max(1, robot.pwm.value(1, "period"))
            edges = self._way * (lines.get(23, 0) - lines.get(24, 0)) * round(60 * duty)
            robot.gpio.turn(5, 6, edges)
            robot.gpio.turn(16, 26, -edges)


def test_a_motor_is_turned_and_judged_through_its_wires(
    robot: EmulatedRobot,
    toml: Path,
    keyboard: Keyboard,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    text = toml.read_text("utf-8").replace("[devices.drive] ", f'[devices.drive]\npwm_chip = "{robot.pwm.path}" ')
    toml.write_text(text, "utf-8")
    keyboard.type("yes\nyes\n")
    with WheelsInTheAir(robot, way=-1):
        assert call(monkeypatch, "--config", toml, "calibrate", "motor") == 0
    assert load_config(toml).devices.drive.motor_reversed
    assert "THE REAR WHEELS WILL TURN" in capsys.readouterr().out
    assert robot.is_released


def test_a_device_that_is_missing_is_one_line(
    robot: EmulatedRobot,
    toml: Path,
    keyboard: Keyboard,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    robot.remove("power")
    assert call(monkeypatch, "--config", toml, "calibrate", "power") == 1
    assert "does not answer" in capsys.readouterr().out


def test_a_word_that_is_none_is_one_line(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    assert call(monkeypatch, "calibrate") == 2
    assert "calibrate what? One of encoders, motor, imu" in capsys.readouterr().err
    assert call(monkeypatch, "check", "imu") == 2
    assert "check takes no imu" in capsys.readouterr().err


@pytest.mark.usefixtures("robot")
@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGHUP])
def test_a_terminal_that_goes_away_ends_it_in_order(config: RobotConfig, number: signal.Signals) -> None:
    before = signal.getsignal(number)

    def hung_up(_: Callable[[], None]) -> None:
        os.kill(os.getpid(), number)

    with pytest.raises(KeyboardInterrupt):
        calibrate("imu", config, None, Operator(hung_up), MonotonicClock())
    assert signal.getsignal(number) == before


def test_the_wheels_of_an_omnidirectional_robot_are_refused() -> None:
    omni = load_any_config(DEFAULT_PATH.with_name("omni.toml"))
    for what in ("encoders", "motor", "steering"):
        operator = Operator()
        assert not calibrate(what, omni, None, operator, ManualClock())
        assert "that is for a car" in operator.heard[-1]
    assert set(PROCEDURES) > {"imu", "camera", "power"}


def test_nobody_answering_ends_it(keyboard: Keyboard) -> None:
    clock = ManualClock()
    terminal = Terminal(clock)
    with pytest.raises(CalibrationError, match="nobody answered"):
        terminal.until_enter("Push", lambda: clock.advance(30.0))


def test_a_closed_terminal_ends_it(keyboard: Keyboard) -> None:
    keyboard.leave()
    with pytest.raises(CalibrationError, match="nobody at the terminal"):
        Terminal(ManualClock()).agree("May it move?")


def test_only_yes_is_yes(keyboard: Keyboard) -> None:
    terminal = Terminal(ManualClock())
    keyboard.type("YES\nyes please\n\nno\n")
    assert [terminal.agree("May it move?") for _ in range(4)] == [True, False, False, False]


def test_the_device_is_read_until_enter_is_pressed(keyboard: Keyboard) -> None:
    reads = []

    def read() -> None:
        reads.append(len(reads))
        if len(reads) == 5:
            threading.Thread(target=keyboard.type, args=("\n",)).start()

    Terminal(MonotonicClock()).until_enter("Push", read)
    assert len(reads) >= 5


def test_nothing_is_calibrated_while_the_robots_app_runs(
    robot: EmulatedRobot,
    keyboard: Keyboard,
    toml: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    robot.gpio.used.add(robot.config.drive.forward_line)
    assert call(monkeypatch, "--config", toml, "calibrate", "imu") == 1
    assert "another program uses them; is it the robot's service?" in capsys.readouterr().out
    robot.gpio.used.clear()
