"""`make demo`: the whole mission on the simulated robot, in the operator's window.

With a display the window opens on the running robot and is the operator's. Without one, or with HEADLESS=1, the
window runs on a virtual display and the mission is played with clicks on its buttons and its map. LINK=lora runs it
over emulated radios and the transceiver's firmware, LINK=switch over Wi-Fi that goes away now and then, with LoRa
beside it.
"""

from __future__ import annotations

import json
import logging
import os
import secrets
import shutil
import subprocess
import sys
import time
from argparse import RawDescriptionHelpFormatter
from dataclasses import dataclass, replace
from pathlib import Path

from shared.command_line import EXIT_FAILED, EXIT_OK, Parser, Refused, run, set_up_logging
from station_gui.config import StationConfig, load_config
from tools.demo_robot import LEFT_BEHIND, simulated_robot
from tools.simulator.links import LINK_NAMES, LinkName
from tools.simulator.scenario import Scenario, find_scenario
from tools.simulator.truth import SIMULATION_FILE, TRUTH_FILE, read_truth

OUT = Path("out/demo")
_SCENARIO, _SEED = "lab", 1
_SCREEN = "1600x1000x24"
_STEP_MS = 100
_LEFT_BEHIND = (
    "window.png", "map2d.png", "map3d.png", "mission.mcap", "summary.json", *LEFT_BEHIND,
    f"truth/{TRUTH_FILE}", f"truth/{SIMULATION_FILE}",
)  # fmt: skip


@dataclass(slots=True)
class _Say:
    """Progress, a line each, with the seconds since the beginning."""

    began_s: float

    def __call__(self, text: str) -> None:
        print(f"demo {time.monotonic() - self.began_s:5.1f} s  {text}", flush=True)


def _play(config: StationConfig, scenario: Scenario, link: LinkName, out: Path, say: _Say) -> int:
    """The mission by itself, with clicks; pictures and summary at the end."""
    from station_gui.app import run_window  # noqa: PLC0415 - Qt is loaded only once a display is there
    from station_gui.export.map_picture import draw_map  # noqa: PLC0415
    from tools.demo_hands import Performance  # noqa: PLC0415
    from tools.evaluate.summary import summarise  # noqa: PLC0415

    recording = out / "mission.mcap"
    with simulated_robot(out, link, _SCENARIO, _SEED) as meeting:
        say(f"the simulated robot is at {meeting.target}")
        config = replace(config, pairing=meeting.pairing)
        performance = Performance(scenario.goals_in_start_frame_m(), meeting.target, out, say, _STEP_MS)
        run_window(config, secrets.randbits(31), when_open=performance.begin, name_recording=lambda: recording)
    station, outcome = performance.result()
    snapshot = station.finish_mapping()
    if snapshot is not None:
        draw_map(
            snapshot.grid, snapshot.trajectory, snapshot.closures, out / "map2d.png", title=f"Demo: {scenario.name}"
        )
    goal = scenario.goals[-1].position_m if scenario.goals else None
    truth = read_truth(out / "truth") if (out / "truth" / TRUTH_FILE).exists() else None
    if truth is None:
        say(f"the simulator has left no truth to compare with; see {out / 'simulator.log'}")
    summary = summarise(truth, snapshot, station.figures, outcome, goal).as_json()
    (out / "summary.json").write_text(json.dumps(summary, indent=1) + "\n", "utf-8")
    for key, value in summary.items():
        print(f"  {key:22} {value}")
    print(f"in {out}/: " + ", ".join(sorted(p.name for p in out.iterdir() if p.is_file())))
    return EXIT_OK if outcome.failure == "" else EXIT_FAILED


def _show(config: StationConfig, link: LinkName, out: Path, say: _Say) -> int:
    """The window is the operator's."""
    from station_gui.app import run_window  # noqa: PLC0415 - Qt is loaded only once a display is there

    with simulated_robot(out, link, _SCENARIO, _SEED) as meeting:
        config = replace(config, pairing=meeting.pairing)
        say("the window opens: press Start observation; later choose Go to and click on the map")
        recording = out / "mission.mcap"
        code = run_window(config, secrets.randbits(31), meeting.target, name_recording=lambda: recording)
    print(f"the mission was recorded in {recording}")
    return code


def _on_virtual_display() -> int:
    if shutil.which("xvfb-run") is None:
        raise Refused("there is no display and no xvfb-run; install the packages xvfb and xauth, or run make setup")
    command = ["xvfb-run", "-a", "-s", f"-screen 0 {_SCREEN}", sys.executable, "-m", "tools.demo", "--virtual"]
    return subprocess.call(command)


def _work() -> int:
    parser = Parser(prog="demo", description=__doc__, formatter_class=RawDescriptionHelpFormatter)
    parser.add_argument("--virtual", action="store_true", help="the display is a virtual one: play the mission")
    is_virtual = parser.parse_args().virtual
    headless = os.environ.get("HEADLESS", "") not in {"", "0"}
    has_display = any(os.environ.get(name) for name in ("DISPLAY", "WAYLAND_DISPLAY"))
    say = _Say(time.monotonic())
    link = _link_name(os.environ.get("LINK", "") or "tcp")
    if is_virtual:
        _clear(OUT)
        logging.getLogger("station").setLevel(logging.INFO)
        return _play(load_config(None), find_scenario(_SCENARIO), link, OUT, say)
    if headless or not has_display:
        return _on_virtual_display()
    _clear(OUT)
    return _show(load_config(None), link, OUT, say)


def _link_name(text: str) -> LinkName:
    for name in LINK_NAMES:
        if text == name:
            return name
    raise Refused(f"LINK={text}: it is one of {', '.join(LINK_NAMES)}")


def _clear(out: Path) -> None:
    """What an earlier demo left must not be taken for this one's."""
    out.mkdir(parents=True, exist_ok=True)
    for name in _LEFT_BEHIND:
        (out / name).unlink(missing_ok=True)


def main() -> int:
    set_up_logging(verbose=False)
    return run("demo", _work)


if __name__ == "__main__":
    sys.exit(main())
