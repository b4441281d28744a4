"""The targets by name, and each of them in a process of its own: what it ends with is told, however it ends."""

from __future__ import annotations

import logging
import multiprocessing
from collections.abc import Callable
from dataclasses import dataclass
from multiprocessing.connection import Connection

import numpy as np

from tools.fuzz.base import MakeTarget, Outcome, fuzz
from tools.fuzz.compact import Compact
from tools.fuzz.conversation import FailoverFrames, Items, Packets
from tools.fuzz.messages import Frames, LinkMessages, ascii_lines, full
from tools.fuzz.radio_module import RadioModule
from tools.fuzz.transceiver import FirmwareCore, FirmwareHex, Host
from tools.simulator.devices.mega import StepMega
from tools.simulator.devices.mega_build import build_core_library, build_mega
from tools.simulator.devices.mega_core import Core

_HANGS_S = 60.0
_START_S = 300.0  # kernels and the firmware may have to be compiled
_END_S = 5.0
_TELL_EVERY = 100  # parts of the whole


@dataclass(frozen=True, slots=True)
class Entry:
    text: str
    make: MakeTarget
    is_slow: bool = False


TARGETS = {
    "frames": Entry("frames of TCP, profile FULL behind them", Frames),
    "full": Entry("profile FULL", full),
    "ascii": Entry("profile ASCII", ascii_lines),
    "compact": Entry("profile COMPACT", Compact),
    "messages": Entry("what a link with a radio brings, all profiles", LinkMessages),
    "radio": Entry("serial line of an ES920LR: parser, driver", RadioModule),
    "packets": Entry("sealed packets of the radio link", Packets),
    "items": Entry("what is in a packet", Items),
    "failover": Entry("frames of the failover", FailoverFrames),
    "core": Entry("firmware core, with sanitizers", lambda rng: FirmwareCore(rng, Core(build_core_library()))),
    "host": Entry("the transceiver's host", Host),
    "hex": Entry("firmware's hex on the emulated Mega", lambda rng: FirmwareHex(rng, StepMega(build_mega())), True),
}


def fuzz_apart(name: str, total_bytes: int, number: int, tell: Callable[[int], None]) -> Outcome | str:
    """One target; in words how its process ended where it has no outcome. `tell` gets the bytes now and then."""
    context = multiprocessing.get_context("spawn")
    ours, theirs = context.Pipe(duplex=False)
    process = context.Process(target=_child, args=(name, total_bytes, number, theirs), daemon=True)
    process.start()
    theirs.close()
    try:
        return _listen(ours, tell)
    except EOFError:
        process.join(_END_S)
        return f"crashed with {process.exitcode}"
    finally:
        process.kill()
        process.join(_END_S)


def _listen(ours: Connection, tell: Callable[[int], None]) -> Outcome | str:
    patience_s = _START_S
    while ours.poll(patience_s):
        said: Outcome | int = ours.recv()
        if not isinstance(said, int):
            return said
        tell(said)
        patience_s = _HANGS_S
    return f"said nothing for {patience_s:g} s"


def _child(name: str, total_bytes: int, number: int, pipe: Connection) -> None:
    """Whatever is raised ends the process, with a traceback."""
    logging.disable(logging.CRITICAL)  # whoever gets foreign bytes says so, a million times
    told = 0

    def tell(offered: int) -> None:
        nonlocal told
        if offered - told >= total_bytes // _TELL_EVERY:
            told = offered
            pipe.send(offered)

    pipe.send(fuzz(TARGETS[name].make(np.random.default_rng(number)), total_bytes, tell))
