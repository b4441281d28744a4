"""Throw bytes at everything that reads foreign ones: random, mutated, truncated, replayed, between sound ones.

`python -m tools.fuzz --bytes 10000000` gives each target so many, each in a process of its own, and prints a table.
A target fails when it crashes, when it says nothing for a minute, when its process keeps growing, when it takes foreign
bytes for the other side's, or when it does not take what is sound.
"""

from __future__ import annotations

import argparse
import sys
from functools import partial

from shared.command_line import EXIT_FAILED, EXIT_OK, Parser, run, seed
from tools.fuzz.base import Outcome
from tools.fuzz.targets import TARGETS, fuzz_apart

_MEBI = 2**20


def main() -> int:
    parser = Parser(prog="fuzz", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--bytes", type=int, default=1_000_000, help="for each target (default: a million)")
    parser.add_argument("--seed", type=seed, default=1)
    parser.add_argument("--only", nargs="+", choices=TARGETS, metavar="TARGET", help=", ".join(TARGETS))
    parser.add_argument("--slow", action="store_true", help="the hex on the emulated Mega too")
    args = parser.parse_args()
    names = args.only or [name for name, entry in TARGETS.items() if args.slow or not entry.is_slow]
    return run("fuzz", lambda: _fuzz_all(names, args.bytes, args.seed))


def _fuzz_all(names: list[str], total_bytes: int, number: int) -> int:
    print("| target | bytes | foreign | forgeries taken | sound taken | refused | slowest round | growth | time |")
    print("|---|---|---|---|---|---|---|---|---|", flush=True)
    passed = 0
    for name in names:
        outcome = fuzz_apart(name, total_bytes, number, partial(_tell, name, total_bytes))
        _clear_line()
        print(f"| {TARGETS[name].text} | {_row(outcome)} |", flush=True)
        passed += isinstance(outcome, Outcome) and outcome.passed
    print(f"{passed} passed, {len(names) - passed} failed")
    return EXIT_OK if passed == len(names) else EXIT_FAILED


def _row(outcome: Outcome | str) -> str:
    if isinstance(outcome, str):
        return f"**{outcome}**"
    v = outcome.verdict
    counts = f"{outcome.offered_bytes:,} | {v.foreign:,} | {v.forgeries:,} | {v.sound:,} | {v.refused:,}".replace(
        ",", " "
    )
    grown = f"{outcome.grown_bytes / _MEBI:.1f} MB"
    return f"{counts} | {1e3 * outcome.slowest_s:.0f} ms | {grown} | {outcome.took_s:.0f} s"


def _tell(name: str, total_bytes: int, offered: int) -> None:
    if sys.stderr.isatty():
        print(f"\r{name}: {offered / total_bytes:4.0%} ", end="", file=sys.stderr, flush=True)


def _clear_line() -> None:
    if sys.stderr.isatty():
        print(f"\r{'':40}\r", end="", file=sys.stderr, flush=True)


if __name__ == "__main__":
    sys.exit(main())
