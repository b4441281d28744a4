"""`evaluate`: measures the shipped pipeline, against the truth or against public benchmarks."""

from __future__ import annotations

import argparse
import sys

from shared.command_line import Parser, run, set_up_logging
from tools.evaluate import kidnap, mission, slam, sweep
from tools.evaluate.control import surfaces
from tools.evaluate.depth import drawing, extraction, lateness, learners, tables, variations
from tools.evaluate.endurance import command as endurance
from tools.evaluate.faults import command as faults
from tools.evaluate.goals import command as goals
from tools.evaluate.link import air, codec, cut_missions, radio_mission
from tools.evaluate.mapping import command as mapping
from tools.evaluate.missions import command as missions
from tools.evaluate.urg import command as urg
from tools.logs.base import LogError

_COMMANDS = {
    "mission": (mission, "the demo's mission in lock-step, no window"),
    "missions": (missions, "many observations in rooms re-arranged at random: contacts, floor seen, speeds"),
    "surfaces": (surfaces, "draws what the fuzzy controllers answer"),
    "map": (mapping, "missions with different seeds, their 2D and 3D maps against the truth"),
    "goals": (goals, "random goals: what can be reached is, what cannot is refused"),
    "slam": (slam, "2D SLAM on a recorded log, against hand-made relations"),
    "sweep": (sweep, "how 2D SLAM stands changes of a recorded log: late starts, fewer beams, noise, backwards"),
    "urg": (urg, "walls and revisits of the map of a log without a ground truth"),
    "kidnap": (kidnap, "finding a robot that was put down anywhere in a saved map"),
    "extraction": (extraction, "3D object extraction on depth images"),
    "tables": (tables, "writes tables 2 and 4, measured, into docs/extraction.md"),
    "drawing": (drawing, "how much of all that is in sight in the simulated rooms is drawn"),
    "variations": (variations, "labelled clouds mirrored, cropped, noisier, through other lenses"),
    "learners": (learners, "the three learners side by side (table 2)"),
    "codec": (codec, "what observations cost in profile COMPACT, and in other packings"),
    "cuts": (cut_missions, "missions while Wi-Fi is cut again and again, against one without a cut"),
    "radio-mission": (radio_mission, "a mission over LoRa alone, in real time, through the real firmware"),
    "link": (air, "what Wi-Fi and LoRa carry, with losses, failures and cuts"),
    "endurance": (endurance, "the robot app for minutes at real time: schedule, memory, processor"),
    "faults": (faults, "each fault in the middle of a mission: what the robot does, what the operator sees"),
    "lateness": (lateness, "by how much the extraction delays the robot's 100 Hz task"),
}


def _parser() -> argparse.ArgumentParser:
    parser = Parser(prog="evaluate", description=__doc__)
    parser.add_argument("--verbose", action="store_true", help="log everything")
    commands = parser.add_subparsers(dest="command", required=True, metavar="COMMAND")
    for name, (module, text) in _COMMANDS.items():
        module.add_arguments(commands.add_parser(name, help=text, description=text))
    return parser


def main() -> int:
    args = _parser().parse_args()
    set_up_logging(args.verbose)
    return run("evaluate", lambda: _COMMANDS[args.command][0].run(args), also=(LogError,))


if __name__ == "__main__":
    sys.exit(main())
