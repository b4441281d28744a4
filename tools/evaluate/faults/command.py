"""`evaluate faults`: each fault in the middle of a mission: what the robot does, and what the operator sees.

Most run in lock-step, where time is simulated. Those that need processes, signals and threads of their own run by the
wall's time (`live`).
"""

from __future__ import annotations

import argparse
import json
import logging
import math
import sys
from collections.abc import Iterator
from dataclasses import asdict
from pathlib import Path

import numpy as np

from shared.command_line import EXIT_FAILED, EXIT_OK, Refused, seed
from tools.evaluate.depth.tables import replace_between
from tools.evaluate.faults.cases import LIMIT_S, Case, cases
from tools.evaluate.faults.live import LIVE_CASES, LiveOutcome, try_live
from tools.evaluate.faults.trial import Outcome, try_case


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--only", nargs="+", metavar="NAME", help="these faults; `evaluate faults --list` names them")
    parser.add_argument("--list", action="store_true", help="name the faults and end")
    parser.add_argument("--seed", type=seed, default=1, help="of all noise (default: 1)")
    parser.add_argument(
        "--table", type=Path, metavar="FILE", help="write the tables into this document, as docs/safety.md"
    )
    parser.add_argument("--json", action="store_true", help="print one JSON object as the last line")


def run(args: argparse.Namespace) -> int:
    known = cases(np.random.default_rng(args.seed))
    texts = {case.name: case.text for case in known} | {name: case.text for name, case in LIVE_CASES.items()}
    names = list(texts)
    if args.list:
        print("\n".join(f"{name:24} {text}" for name, text in texts.items()))
        return EXIT_OK
    wanted = set(args.only or names)
    if wanted - set(names):
        raise Refused(f"no such fault: {', '.join(sorted(wanted - set(names)))}; they are {', '.join(names)}")
    logging.disable(logging.CRITICAL)  # each fault fills the log, as it should
    outcomes = list(_try_all([case for case in known if case.name in wanted], args.seed))
    if args.table is not None:
        _write(args.table, outcomes, [])
    live = [_tried_live(name) for name in LIVE_CASES if name in wanted]
    if args.table is not None:
        _write(args.table, [], live)
    if args.json:
        print(
            json.dumps({"limit_s": LIMIT_S, "faults": [_plain(o) for o in outcomes], "live": [_plain(o) for o in live]})
        )
    failures = [o.failure for o in outcomes] + [o.failure for o in live]
    return EXIT_FAILED if any(failures) else EXIT_OK


def _try_all(wanted: list[Case], number: int) -> Iterator[Outcome]:
    for case in wanted:
        outcome = try_case(case, number)
        print(_line(outcome), flush=True)
        yield outcome


def _tried_live(name: str) -> LiveOutcome:
    outcome = try_live(name)
    times = f"driven {_shown(outcome.driven_s)} s, moved {_shown(outcome.moved_s)} s"
    print(f"{name:24} {times}   {outcome.text}   {outcome.failure}", flush=True)
    return outcome


def _line(o: Outcome) -> str:
    times = f"driven {_shown(o.driven_s)} s, moved {_shown(o.moved_s)} s, {100 * o.way_m:5.1f} cm"
    return f"{o.name:24} {times}   {o.reason:18} {o.after:8} {o.failure}"


def _shown(seconds: float) -> str:
    return f"{seconds:.2f}" if math.isfinite(seconds) else "   –"


def _plain(outcome: Outcome | LiveOutcome) -> dict[str, object]:
    """What is no number becomes null."""
    plain = {key: round(v, 4) if isinstance(v, float) else v for key, v in asdict(outcome).items()}
    return {key: None if isinstance(v, float) and not math.isfinite(v) else v for key, v in plain.items()}


def _write(document: Path, outcomes: list[Outcome], live: list[LiveOutcome]) -> None:
    try:
        text = document.read_text("utf-8")
        if outcomes:
            text = replace_between(text, "faults", list(_table(outcomes)))
        if live:
            text = replace_between(text, "live faults", list(_live_table(live)))
        document.write_text(text, "utf-8")
    except (OSError, ValueError) as error:
        print(error, file=sys.stderr)
        raise Refused(f"{document}: {error}") from error


def _table(outcomes: list[Outcome]) -> Iterator[str]:
    yield "| fault | motor on for | car moved for | the operator sees | in the end |"
    yield "|---|---|---|---|---|"
    for o in outcomes:
        yield f"| {o.text} | {_times(o)} | {o.seen} | {o.after} |"


def _live_table(live: list[LiveOutcome]) -> Iterator[str]:
    yield "| fault | at | motor on for | car moved for | the operator sees | in the end |"
    yield "|---|---|---|---|---|---|"
    for o in live:
        speed = f"{o.speed_mps:.2f} m/s" if math.isfinite(o.speed_mps) else "–"
        yield f"| {o.text} | {speed} | {_times(o)} | {o.seen} | {o.after} |"


def _times(o: Outcome | LiveOutcome) -> str:
    return f"{_shown(o.driven_s)} s | {_shown(o.moved_s)} s" if math.isfinite(o.moved_s) else "– | –"
