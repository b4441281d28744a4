"""Tables of the functions that both sides need, made with whole numbers only, so that they are equal on any machine.

An angle is a whole number of 2**-20 turns. A stretched probability is ln(p / (1 - p)) in steps of 1/256.
"""

from __future__ import annotations

from decimal import Decimal, localcontext
from fractions import Fraction

import numpy as np
from numpy.typing import NDArray

IntArray = NDArray[np.int64]

TURN = 1 << 20  # angle units in a turn
QUARTER_STEPS = 4096  # entries of a quarter of the sine
SINE_BITS = 20
ATAN_STEPS = 4096
STRETCH_LIMIT = 2047
PROBABILITY_BITS = 16

_WORK_BITS = 60
_PI = Fraction(31415926535897932384626433832795028841971, 10**40)


def _rounded(value: int, bits: int) -> int:
    return (value + (1 << bits - 1)) >> bits


def _rotation(step: Fraction) -> tuple[int, int]:
    """Cosine and sine of a small angle in 2**-60, by their series."""
    one = 1 << _WORK_BITS
    cosine = sine = Fraction(0)
    term = Fraction(1)
    for n in range(12):
        if n % 2 == 0:
            cosine += term if n % 4 == 0 else -term
        else:
            sine += term if n % 4 == 1 else -term
        term = term * step / (n + 1)
    return int(cosine * one), int(sine * one)


def _quarter_sine() -> IntArray:
    """(QUARTER_STEPS + 2,) sine in 2**-SINE_BITS at each step of a quarter turn."""
    c, s = _rotation(_PI / 2 / QUARTER_STEPS)
    x, y = 1 << _WORK_BITS, 0
    values = []
    for _ in range(QUARTER_STEPS + 2):
        values.append(_rounded(y, _WORK_BITS - SINE_BITS))
        x, y = (x * c - y * s) >> _WORK_BITS, (x * s + y * c) >> _WORK_BITS
    return np.array(values, np.int64)


def _arc_tangent(sine: IntArray) -> IntArray:
    """(ATAN_STEPS + 1,) the angle whose tangent is i / ATAN_STEPS."""
    angles = []
    k = 0
    for i in range(ATAN_STEPS + 1):
        while k < QUARTER_STEPS // 2 and sine[k + 1] * ATAN_STEPS <= i * sine[QUARTER_STEPS - k - 1]:
            k += 1
        here = int(sine[k]) * ATAN_STEPS - i * int(sine[QUARTER_STEPS - k])
        there = int(sine[k + 1]) * ATAN_STEPS - i * int(sine[QUARTER_STEPS - k - 1])
        part = (-here << 8) // (there - here)
        angles.append((k * (TURN // 4 // QUARTER_STEPS)) + (part * (TURN // 4 // QUARTER_STEPS) >> 8))
    return np.array(angles, np.int64)


def _squash() -> IntArray:
    """(4096,) probability in 2**-16 of the stretched value i - 2048."""
    values = []
    with localcontext() as context:
        context.prec = 30
        factor = (Decimal(1) / 256).exp()
        power = (Decimal(-2048) / 256).exp()
        for _ in range(2 * (STRETCH_LIMIT + 1)):
            values.append(int((power / (1 + power) * 65536).to_integral_value()))
            power *= factor
    return np.array(values, np.int64)


def _stretch(squash: IntArray) -> IntArray:
    """(4096,) stretched value of the probability (i + 1/2) / 4096."""
    middle = 16 * np.arange(4096, dtype=np.int64) + 8
    found = np.searchsorted(squash, middle)
    values: IntArray = np.clip(found - 2048, -STRETCH_LIMIT, STRETCH_LIMIT).astype(np.int64)
    return values


def _rates() -> IntArray:
    """(1024,) how much of a surprise a counter takes over that has seen n, in 2**-16."""
    n = np.arange(1024, dtype=np.int64)
    values: IntArray = (2 * 65536) // (2 * n + 3)
    return values


SINE = _quarter_sine()
ATAN = _arc_tangent(SINE)
SQUASH = _squash()
STRETCH = _stretch(SQUASH)
RATES = _rates()
for _table in (SINE, ATAN, SQUASH, STRETCH, RATES):
    _table.setflags(write=False)
