"""The demo's robot: the simulator, and the network between it and the station, each a program of its own."""

from __future__ import annotations

import json
import re
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from robot_app.config import DEFAULT_PATH
from shared.command_line import Refused
from shared.link.pairing import write_new_pairing
from station_gui.comms.target import Target
from tools.simulator.links import LinkName
from tools.simulator.relay import Relay

_HOST = "127.0.0.1"
_BANDWIDTH_HZ = 500_000
_READY_TIMEOUT_S = 120.0  # compiling takes a while the first time
_END_TIMEOUT_S = 15.0
LEFT_BEHIND = ("simulator.log", "network.log", "port.txt", "ports.json", "robot.toml", "pairing.pem")


@dataclass(frozen=True, slots=True)
class Meeting:
    """Where and how the station finds the robot."""

    target: Target
    pairing: str


@contextmanager
def simulated_robot(out: Path, link: LinkName, scenario: str, seed: int) -> Iterator[Meeting]:
    """Gives where to find it; at the end it writes its truth."""
    arguments = ["--scenario", scenario, "--seed", str(seed), "--port", "0", "--out", str(out / "truth"), "--until-eof"]
    with ExitStack() as stack:
        station_ports: tuple[str, ...] = ()
        if link != "tcp":
            text = stack.enter_context(program("tools.simulator.radio.network", [], out / "ports.json", out))
            ports = json.loads(text)
            station_ports = tuple(ports["station"])
            arguments += ["--config", str(configure(out, "radio" if link == "lora" else "both", ports["robot"]))]
        arguments.append("--port-file")
        port = int(stack.enter_context(program("tools.simulator", arguments, out / "port.txt", out)))
        pairing = str(out / "pairing.pem") if station_ports else ""
        if link == "switch":
            relay = Relay((_HOST, 0), (_HOST, port), np.random.default_rng(seed + 1_000))
            stack.callback(relay.close)
            port = relay.port
        yield Meeting(Target(_HOST if port else "", port, station_ports), pairing)


def configure(out: Path, use: str, ports: list[str], bandwidth_hz: int = _BANDWIDTH_HZ) -> Path:
    """The robot's configuration as it comes, with another link and a pairing file of its own."""
    pairing = out / "pairing.pem"
    write_new_pairing(pairing)
    text = DEFAULT_PATH.read_text("utf-8")
    values = {"use": use, "pairing": str(pairing), "ports": ports, "bandwidth_hz": bandwidth_hz}
    for key, value in values.items():
        line = re.search(rf"(?m)^{key} = .*$", text)
        assert line is not None, key
        text = text[: line.start()] + f"{key} = {json.dumps(value)}" + text[line.end() :]
    path = out / "robot.toml"
    path.write_text(text, "utf-8")
    return path


@contextmanager
def program(module: str, arguments: list[str], says: Path, out: Path) -> Iterator[str]:
    """Runs until the end of the context; `says` is its last argument: what it writes there once it is ready."""
    says.unlink(missing_ok=True)
    log = out / f"{module.rpartition('.')[2]}.log"
    with log.open("wb") as stream:
        process = subprocess.Popen(  # it ends with us, however we end: its standard input ends then
            [sys.executable, "-m", module, *arguments, str(says)],
            stdin=subprocess.PIPE,
            stdout=stream,
            stderr=subprocess.STDOUT,
        )
    try:
        yield _wait_for(process, says, log)
    finally:
        if process.stdin is not None:
            process.stdin.close()
        try:
            process.wait(_END_TIMEOUT_S)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()
        says.unlink(missing_ok=True)


def _wait_for(process: subprocess.Popen[bytes], says: Path, log: Path) -> str:
    name = log.stem
    until_s = time.monotonic() + _READY_TIMEOUT_S
    while time.monotonic() < until_s:
        if process.poll() is not None:
            last = (log.read_text("utf-8", "replace").strip().splitlines() or ["it said nothing"])[-1]
            raise Refused(f"the {name} ended with code {process.returncode}: {last}; see {log}")
        if says.exists() and (text := says.read_text("utf-8")).endswith("\n"):
            return text
        time.sleep(0.1)
    raise Refused(f"the {name} was not ready after {_READY_TIMEOUT_S:.0f} s; see {log}")
