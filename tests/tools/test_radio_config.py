"""`radio-config` on emulated modules whose time passes as fast as it can."""

from __future__ import annotations

import dataclasses
import io
import json
import subprocess
import sys
import tomllib
from contextlib import redirect_stderr, redirect_stdout
from pathlib import Path

import pytest

from shared.link.base import LinkError
from shared.link.es920lr.settings import BootMode, Format, RadioSettings
from shared.link.serial_port import SerialPort
from tests.shared.link.radio_rig import ROBOT, STATION, Rig, operating
from tools.radio_config import commands, session
from tools.radio_config.__main__ import main
from tools.simulator.devices.es920lr import State
from tools.simulator.radio.ports import EmulatedPort

ROOT = Path(__file__).resolve().parents[2]
SECOND = {"own_id": 3, "destination_id": 4, "channel": 5}


class Bench:
    """Modules on ports that are opened by name, and a user who switches power off and on when he is told to."""

    def __init__(self, *flash: RadioSettings) -> None:
        self.rig = Rig()
        self.ports = [f"/dev/tty{i}" for i in range(len(flash))]
        self.modules = [
            self.rig.module(name, settings, (10.0 * i, 0.0))
            for i, (name, settings) in enumerate(zip(self.ports, flash, strict=True))
        ]
        self.power_cycles = 0

    def open(self, name: str, baud_rate: int) -> EmulatedPort:
        port = self.rig.port(self.modules[self.ports.index(name)])
        port.baud_rate = baud_rate
        return port

    def run(self, *arguments: str) -> subprocess.CompletedProcess[str]:
        return run(self, *arguments)

    def write(self, text: str) -> None:
        """The user reads what is said to him."""
        if "Switch its power off and on now" in text:
            self.power_cycles += 1
            self.modules[self.ports.index(text.partition(":")[0])].reset()


class _Read(io.StringIO):
    def __init__(self, bench: Bench) -> None:
        super().__init__()
        self._bench = bench

    def write(self, text: str) -> int:
        self._bench.write(text)
        return super().write(text)


def run(bench: Bench, *arguments: str) -> subprocess.CompletedProcess[str]:
    out, err = io.StringIO(), _Read(bench)
    with pytest.MonkeyPatch.context() as patch, redirect_stdout(out), redirect_stderr(err):
        patch.setattr(session, "SerialPort", bench.open if bench.ports else SerialPort)
        patch.setattr(commands, "MonotonicClock", lambda: bench.rig.clock)
        patch.setattr(sys, "argv", ["radio-config", *arguments])
        try:
            code = main()
        except SystemExit as end:
            code = int(end.code or 0)
    return subprocess.CompletedProcess(arguments, code, out.getvalue(), err.getvalue())


@pytest.fixture
def bench(request: pytest.FixtureRequest) -> Bench:
    return Bench(*getattr(request, "param", (RadioSettings(),)))


def refusal(done: subprocess.CompletedProcess[str]) -> str:
    assert done.returncode == 2, (done.stdout, done.stderr)
    assert "Traceback" not in done.stderr
    return done.stderr.strip()


def test_a_module_is_shown(bench: Bench) -> None:
    done = bench.run("show", bench.ports[0])
    assert done.returncode == 0, done.stderr
    lines = done.stdout.splitlines()
    assert lines[0] == f"# {bench.ports[0]}: VER 1.12, 920.6 MHz"
    assert {"bandwidth_hz = 125000", "own_id = 0x0001", "acknowledge = true", "format = ascii"} <= set(lines)


@pytest.mark.parametrize("bench", [(operating(ROBOT),)], indirect=True)
def test_a_module_that_operates_is_asked_and_goes_on_operating(bench: Bench) -> None:
    done = bench.run("show", bench.ports[0], "--json")
    assert json.loads(done.stdout)["settings"]["boot_mode"] == "operation"
    assert bench.power_cycles == 1
    module = bench.modules[0]
    assert (module.state, module.flash, module.settings) == (State.OPERATION, operating(ROBOT), operating(ROBOT))


def test_settings_are_changed_saved_and_reported(bench: Bench) -> None:
    arguments = ("set", bench.ports[0], "--profile", "fastest", "own_id=2", "destination_id=0x0001", "power_dbm=-4")
    dry = bench.run(*arguments, "--dry-run")
    assert "nothing was changed" in dry.stdout
    assert bench.modules[0].settings == RadioSettings()
    done = bench.run(*arguments, "--save", "--json")
    assert done.returncode == 0, done.stderr
    wanted = dataclasses.replace(operating(STATION), power_dbm=-4)
    assert bench.modules[0].flash == bench.modules[0].settings == wanted
    assert json.loads(done.stdout)["changed"]["bandwidth_hz"] == {"from": "125000", "to": "500000"}
    again = bench.run(*arguments)
    assert "is so already" in again.stdout


def test_what_is_not_saved_is_said_to_be_lost(bench: Bench) -> None:
    done = bench.run("set", bench.ports[0], "spreading_factor=9", "baud_rate=230400")
    assert "not saved" in done.stderr
    assert (bench.modules[0].settings.baud_rate, bench.modules[0].flash) == (230_400, RadioSettings())
    assert bench.run("save", bench.ports[0]).returncode == 0
    assert bench.modules[0].flash.spreading_factor == 9
    assert bench.run("load", bench.ports[0], "--save").returncode == 0
    assert bench.modules[0].flash == RadioSettings()


@pytest.mark.parametrize("bench", [(operating(ROBOT), *([RadioSettings()] * 3))], indirect=True)
def test_one_module_is_copied_to_the_three_others_and_then_all_agree(bench: Bench) -> None:
    before = bench.run("check", *bench.ports)
    assert before.returncode == 1
    assert "bandwidth_hz must be the same everywhere" in before.stdout
    done = bench.run("copy", *bench.ports, "--save")
    assert done.returncode == 0, done.stderr
    second = dataclasses.replace(operating(ROBOT), **SECOND)
    wanted = [operating(STATION), second, dataclasses.replace(second, own_id=4, destination_id=3)]
    assert [module.flash for module in bench.modules[1:]] == wanted
    after = bench.run("check", *bench.ports)
    assert (after.returncode, after.stdout) == (0, "the 4 modules agree\n")


@pytest.mark.parametrize("bench", [(ROBOT, operating(STATION))], indirect=True)
def test_a_module_that_does_not_operate_by_itself_is_warned_of(bench: Bench) -> None:
    done = bench.run("check", *bench.ports)
    assert done.returncode == 0
    agree, warning = done.stdout.splitlines()
    assert agree == "the 2 modules agree"
    assert f"{bench.ports[0]} starts in configuration, and the link needs boot_mode=operation" in warning


@pytest.mark.parametrize("bench", [(operating(ROBOT), operating(STATION))], indirect=True)
def test_the_range_test_counts_what_comes_and_how_strong_and_leaves_all_as_it_was(bench: Bench) -> None:
    done = bench.run("range-test", *bench.ports, "--sf", "7,8", "--json")
    assert done.returncode == 0, done.stderr
    results = json.loads(done.stdout)["results"]
    assert [(r["spreading_factor"], r["sent"], r["received"], r["refused"]) for r in results] == [
        (7, 20, 20, 0),
        (7, 20, 20, 0),
        (8, 20, 20, 0),
        (8, 20, 20, 0),
    ]
    assert {r["median_dbm"] for r in results} == {-46}
    assert [m.flash for m in bench.modules] == [operating(ROBOT), operating(STATION)]
    assert [m.state for m in bench.modules] == [State.OPERATION] * 2


@pytest.mark.parametrize(
    ("assignment", "told"),
    [
        (("spreading_factor=13",), "spreading_factor is 7 to 12, not 13"),
        (("spreding_factor=9",), "did you mean spreading_factor"),
        (("format=utf8",), "format must be one of ascii, binary"),
        (("channel=8", "bandwidth_hz=250000"), "channel is 1 to 7 at 250 kHz"),
        (("sf",), "write KEY=VALUE"),
        ((), "nothing to set"),
        (("--profile", "turbo"), "it is one of fastest, long-range, paper"),
        (("node=coordinator", "sleep=timer"), "only an end_device sleeps"),
        (("destination_id=1",), "talk to itself"),
        (("bandwidth_hz=62500", "spreading_factor=12"), "the band allows 4 s"),
        (("spreading_factor=9", "--carrier-sense", "short"), "the band allows 0.4 s"),
        (("spreading_factor=9", "--payload", "51"), "1 to 50 bytes"),
        (("spreading_factor=9", "--turbo"), "unrecognized arguments: --turbo"),
    ],
)
def test_what_cannot_be_is_refused_in_one_line(bench: Bench, assignment: tuple[str, ...], told: str) -> None:
    told_line = refusal(bench.run("set", bench.ports[0], *assignment))
    assert told in told_line
    assert bench.modules[0].settings == RadioSettings()


def test_a_port_that_is_not_there_is_named() -> None:
    done = Bench().run("show", "/dev/ttyNOPE")
    assert "/dev/ttyNOPE: there is no such port. `radio-config list`" in refusal(done)


def test_a_module_that_says_nothing_is_named(bench: Bench) -> None:
    bench.modules[0].power_off()
    told = refusal(bench.run("show", bench.ports[0]))
    assert f"{bench.ports[0]}: no answer at any baud rate. Is the module powered" in told


def test_flash_memory_that_fails_is_told(bench: Bench) -> None:
    bench.modules[0].flash_refusal = 3
    assert "cannot be erased" in refusal(bench.run("save", bench.ports[0]))


def test_airtime_needs_no_module() -> None:
    done = Bench().run("airtime", "--profile", "paper", "--json")
    figures = json.loads(done.stdout)
    assert figures["goodput_two_modules_bps"] == pytest.approx(6_010, rel=0.003)  # what the paper measured
    assert done.returncode == 0
    forbidden = Bench().run("airtime", "bandwidth_hz=62500", "spreading_factor=12")
    assert forbidden.returncode == 1
    assert "forbidden: 50 bytes at SF12" in forbidden.stdout


def test_ports_and_profiles_are_listed() -> None:
    assert Bench().run("list").returncode == 0
    assert set(json.loads(Bench().run("list", "--profiles", "--json").stdout)["profiles"]) == {
        "fastest",
        "long-range",
        "paper",
    }


def test_a_profile_of_ones_own_is_read(bench: Bench, tmp_path: Path) -> None:
    path = tmp_path / "mine.toml"
    path.write_text('carrier_sense = "short"\npayload_bytes = 20\n[settings]\nspreading_factor = 8\nformat = "ascii"\n')
    assert bench.run("set", bench.ports[0], "--profile", str(path)).returncode == 0
    held = bench.modules[0].settings
    assert (held.spreading_factor, held.format, held.boot_mode) == (8, Format.ASCII, BootMode.OPERATION)
    path.write_text("[settings]\nspreading = 8\n")
    assert f"{path}: unknown key settings.spreading" in refusal(
        bench.run("set", bench.ports[0], "--profile", str(path))
    )


@pytest.mark.parametrize("bench", [(operating(ROBOT), operating(STATION))], indirect=True)
def test_the_range_test_finds_how_far_each_spreading_factor_reaches(bench: Bench) -> None:
    """At SF7 and 500 kHz a packet is heard at -118.5 dBm, at SF12 12.5 dB weaker."""
    bench.modules[1].antenna.position_m = (7_000.0, 0.0)
    done = bench.run("range-test", *bench.ports, "--sf", "7,12", "--count", "5")
    assert done.returncode == 0, done.stderr
    assert [line.split()[6] for line in done.stdout.splitlines()[1:]] == ["100%", "100%", "0%", "0%"]
    assert "nothing came" in done.stdout


@pytest.mark.parametrize(
    ("change", "told"),
    [
        ({"pan_id": 9}, "pan_id must be the same everywhere: it is 1 at /dev/tty0, 9 at /dev/tty1"),
        ({"channel": 2}, "/dev/tty0 is on channel 1, its partner /dev/tty1 on 2"),
        ({"own_id": 1}, "both have own_id 0x0001"),
        ({"own_id": 7}, "/dev/tty0: nobody here has its destination_id 0x0002"),
        ({"destination_id": 9}, "/dev/tty0 sends to /dev/tty1, which sends to 0x0009"),
        ({"format": Format.ASCII}, "/dev/tty1: the link needs format=binary"),
    ],
)
def test_what_does_not_agree_is_named(change: dict[str, int], told: str) -> None:
    bench = Bench(operating(ROBOT), operating(dataclasses.replace(STATION, **change)))  # type: ignore[arg-type]
    done = bench.run("check", *bench.ports)
    assert done.returncode == 1
    assert told in done.stdout


def test_two_pairs_on_one_channel_are_named() -> None:
    second = dataclasses.replace(ROBOT, own_id=3, destination_id=4)
    bench = Bench(*map(operating, (ROBOT, STATION, second, dataclasses.replace(second, own_id=4, destination_id=3))))
    assert "channel 1 is that of the other pair" in bench.run("check", *bench.ports).stdout
    assert "destroy each other" in refusal(bench.run("copy", *bench.ports, "--second-channel", "1"))


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (("copy", "/dev/tty0", "/dev/tty0"), "the same port is given twice"),
        (("copy", "/dev/tty0", "/dev/tty1", "/dev/tty2"), "to one port (the partner) or to three"),
        (("show", "/dev/tty0:C"), "a transceiver has two radios, /dev/tty0:A and /dev/tty0:B"),
        (("check", "/dev/tty0"), "check two modules or four, not 1"),
        (("range-test", "/dev/tty0", "/dev/tty1", "--sf", "7,13"), "write spreading factors from 7 to 12"),
        (("range-test", "/dev/tty0", "/dev/tty1", "--payload", "3"), "no whole number from 10 to 50"),
        (("show", "/dev/tty0", "--wait", "nan"), "no number from 0 to 3600"),
        (("range-test", "/dev/tty0", "/dev/tty1", "/dev/tty2"), "give one port, with `radio-config echo`"),
        (("range-test", "/dev/tty0", "--sf", "7,8"), "both ends must have the same spreading factor"),
        (("copy", "/dev/tty0", "/dev/tty1"), "set them to two different modules first"),
    ],
)
def test_what_cannot_be_asked_is_refused(arguments: tuple[str, ...], told: str) -> None:
    alone = dataclasses.replace(ROBOT, destination_id=1)
    assert told in refusal(Bench(alone, STATION).run(*arguments))


def test_a_module_that_is_not_switched_off_and_on_is_told() -> None:
    bench = Bench(operating(ROBOT))
    bench.write = lambda text: None  # type: ignore[method-assign, assignment, misc]
    told = refusal(bench.run("show", bench.ports[0], "--wait", "5"))
    assert told.endswith(f"{bench.ports[0]}: the module has not been reset within 5 s")


def test_ports_are_opened_by_the_operating_systems_name(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(name: str, baud_rate: int) -> SerialPort:
        raise LinkError(f"{name}: in use by another program")

    bench = Bench(RadioSettings())
    monkeypatch.setattr(bench, "open", refuse)
    assert "in use by another program" in refusal(bench.run("show", "/dev/tty0"))


def test_it_explains_itself_and_every_command_of_it() -> None:
    whole = Bench().run("--help")
    assert whole.returncode == 0
    for command in ("list", "show", "set", "save", "load", "copy", "check", "range-test", "echo", "airtime"):
        assert command in whole.stdout
        done = Bench().run(command, "--help")
        assert done.returncode == 0
        assert "--json" in done.stdout
    with (ROOT / "pyproject.toml").open("rb") as file:
        scripts = tomllib.load(file)["project"]["scripts"]
    assert scripts["radio-config"] == "tools.radio_config.__main__:main"


def test_what_the_band_forbids_anyway_is_refused_before_a_port_is_touched() -> None:
    assert "the band allows 4 s" in refusal(
        Bench().run("set", "/dev/ttyNOPE", "bandwidth_hz=62500", "spreading_factor=12")
    )
    assert "no such port" in refusal(Bench().run("set", "/dev/ttyNOPE", "destination_id=1"))


@pytest.mark.parametrize("bench", [(STATION,)], indirect=True)
def test_one_setting_is_judged_with_those_that_the_module_has(bench: Bench) -> None:
    assert bench.run("set", bench.ports[0], "destination_id=1", "power_dbm=3").returncode == 0
    assert "talk to itself" in refusal(bench.run("set", bench.ports[0], "destination_id=2"))
    assert "channel is 1 to 5" in refusal(bench.run("set", bench.ports[0], "channel=9"))
