from __future__ import annotations

import math
import zlib

import numpy as np

from shared.protocol.compact import tables
from shared.protocol.compact.casting._kernels import bearing, sine


def test_the_tables_are_the_same_on_every_machine() -> None:
    whole = b"".join(t.astype("<i8").tobytes() for t in (tables.SINE, tables.ATAN, tables.SQUASH, tables.STRETCH))
    assert zlib.crc32(whole) == 2388942309


def test_sines_are_right_to_the_last_digits_but_one() -> None:
    for angle in range(-tables.TURN, tables.TURN, 7919):
        exact = math.sin(angle / tables.TURN * math.tau) * 2**tables.SINE_BITS
        assert abs(sine(angle, tables.SINE) - exact) < 2


def test_bearings_are_right_to_a_few_units(rng: np.random.Generator) -> None:
    for x, y in rng.integers(-100_000, 100_000, (500, 2)).tolist():
        exact = math.atan2(y, x) / math.tau * tables.TURN
        off = (bearing(x, y, tables.ATAN) - exact + tables.TURN / 2) % tables.TURN - tables.TURN / 2
        assert abs(off) < 4
    assert bearing(0, 0, tables.ATAN) == 0


def test_stretch_undoes_squash() -> None:
    for stretched in range(-1900, 1900, 13):
        probability = int(tables.SQUASH[stretched + 2048])
        assert abs(probability / 65536 - 1 / (1 + math.exp(-stretched / 256))) < 1e-4
        again = int(tables.STRETCH[probability >> 4])
        assert abs(int(tables.SQUASH[again + 2048]) - probability) <= 72
