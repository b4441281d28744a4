"""What all the commands have in common: how they log, how they end."""

from __future__ import annotations

import argparse
import logging
import math
import sys
from collections.abc import Callable
from pathlib import Path
from typing import NoReturn

from shared.config import ConfigError
from shared.link.base import LinkError

EXIT_OK = 0
EXIT_FAILED = 1
EXIT_INTERRUPTED = 130
EXIT_MISUSE = 2  # a wrong port, key, file or option: the line printed names it


class Refused(Exception):
    """Something the user gave cannot be used; the text is one line that names it."""


class Parser(argparse.ArgumentParser):
    """Says in one line what is wrong with the options; `--help` says the rest."""

    def error(self, message: str) -> NoReturn:
        self.exit(EXIT_MISUSE, f"{self.prog}: {message}\n")


def run(name: str, work: Callable[[], int], also: tuple[type[Exception], ...] = ()) -> int:
    """Call `work`; errors of the user's making become one line on stderr and exit code 2."""
    users: tuple[type[Exception], ...] = (Refused, ConfigError, LinkError, *also)
    try:
        return work()
    except users as error:
        _say(f"{name}: {error}")
        return EXIT_MISUSE
    except OSError as error:
        if error.filename is None:  # not about a file that the user named
            raise
        _say(f"{name}: {error.filename}: {error.strerror}")
        return EXIT_MISUSE
    except KeyboardInterrupt:
        _say(f"{name}: interrupted")
        return EXIT_INTERRUPTED


def _say(text: str) -> None:
    print(text, file=sys.stderr)  # noqa: T201 - the command's own words


def set_up_logging(verbose: bool) -> None:
    logging.basicConfig(
        level=logging.DEBUG if verbose else logging.INFO,
        format="%(asctime)s.%(msecs)03d %(levelname)-7s %(name)s: %(message)s",
        datefmt="%H:%M:%S",
        stream=sys.stderr,
    )
    for talkative in ("numba", "OpenGL"):
        logging.getLogger(talkative).setLevel(logging.WARNING)


def address(text: str) -> tuple[str, int]:
    """`host:port` of a command line."""
    host, colon, port = text.rpartition(":")
    if not colon or not host:
        raise argparse.ArgumentTypeError(f"{text!r} is no address; write host:port, for example 192.168.1.20:47100")
    number = port_number(port)
    if number == 0:
        raise argparse.ArgumentTypeError(f"{text!r}: nobody can be reached at port 0; a robot's is 47100 usually")
    return host, number


def port_number(text: str) -> int:
    if not text.isdecimal() or not 0 <= int(text) <= 65_535:
        raise argparse.ArgumentTypeError(f"{text!r} is no port; a port is a number from 0 to 65535")
    return int(text)


def seed(text: str) -> int:
    if not text.isdecimal():
        raise argparse.ArgumentTypeError(f"{text!r} is no seed; a seed is a whole number from 0 on")
    return int(text)


def number_in(low: float, high: float) -> Callable[[str], float]:
    """A parser of numbers from `low` to `high`."""

    def parse(text: str) -> float:
        try:
            value = float(text)
        except ValueError:
            value = math.nan
        if not low <= value <= high:
            raise argparse.ArgumentTypeError(f"{text!r} is no number from {low:g} to {high:g}")
        return value

    return parse


def whole_number_in(low: int, high: int) -> Callable[[str], int]:
    """A parser of whole numbers from `low` to `high`."""

    def parse(text: str) -> int:
        if not text.isdecimal() or not low <= int(text) <= high:
            raise argparse.ArgumentTypeError(f"{text!r} is no whole number from {low} to {high}")
        return int(text)

    return parse


def existing_file(text: str) -> Path:
    path = Path(text)
    if not path.is_file():
        what = "is a folder, not a file" if path.is_dir() else "there is no such file"
        raise argparse.ArgumentTypeError(f"{text}: {what}")
    return path
