"""An adaptive binary range coder whose probabilities are mixed from many contexts (after M. Mahoney's lpaq).

Whole numbers only: both sides must come to the same probability on any machine.
`coder`: (64,) int64: low, high, code, position, end, 1 when decoding; from 8 on the contexts of the next bit, from 32
on what they say. The model is three arrays: `slots` (N,) uint32, a probability in the upper 22 bits and a count in the
lower 10; `weights` (S, 2 C) int32 in 2**-16; `refined` (R, 33) uint16, probabilities at 33 stretched values.
`tables`: stretch, squash and rates of `compact.tables`, one behind the other.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

Ints = NDArray[np.int64]
Bytes = NDArray[np.uint8]
Slots = NDArray[np.uint32]
Weights = NDArray[np.int32]
Refined = NDArray[np.uint16]

CODER_SIZE = 64
CONTEXT = 8  # where contexts begin in `coder`
_INPUT = 32
_SQUASH = 4096  # where it begins in `tables`
_RATES = 8192
_COUNT_LIMIT = 250
_LEARNING = 14
_REFINING = 6
_LEAST = 24  # a probability's distance from 0 and 1
_LEAST_IN_SLOT = 2048


@njit(nogil=True, cache=True)
def start(coder: Ints, data: Bytes, begin: int, end: int, decoding: bool) -> None:
    """Get ready to write from `begin` on, or to read what stands there up to `end`; behind it stand zeros."""
    coder[0] = 0
    coder[1] = 0xFFFFFFFF
    coder[2] = 0
    coder[3] = begin
    coder[4] = end
    coder[5] = 1 if decoding else 0
    if decoding:
        for _ in range(4):
            byte = np.int64(data[coder[3]]) if coder[3] < end else 0
            coder[2] = (coder[2] << 8) | byte
            coder[3] += 1


@njit(nogil=True, cache=True)
def code(coder: Ints, data: Bytes, bit: int, probability: int) -> int:
    """Write `bit`, or read one; `probability` that it is 1, 1 to 65535 in 2**-16."""
    low = coder[0]
    high = coder[1]
    width = high - low
    middle = low + (width >> 16) * probability + (((width & 0xFFFF) * probability) >> 16)
    if coder[5] == 1:
        bit = 1 if coder[2] <= middle else 0
    if bit == 1:
        high = middle
    else:
        low = middle + 1
    while ((low ^ high) & 0xFF000000) == 0:
        if coder[5] == 1:
            byte = np.int64(data[coder[3]]) if coder[3] < coder[4] else 0
            coder[2] = ((coder[2] << 8) & 0xFFFFFFFF) | byte
        elif coder[3] < coder[4]:
            data[coder[3]] = high >> 24
        coder[3] += 1
        low = (low << 8) & 0xFFFFFFFF
        high = ((high << 8) & 0xFFFFFFFF) | 255
    coder[0] = low
    coder[1] = high
    return bit


@njit(nogil=True, cache=True)
def _ending(low: int, high: int) -> int:
    """The first number of the fewest bytes in an interval, those bytes first, in 32 bits."""
    for count in range(5):
        unit = 1 << (32 - 8 * count)
        value = ((low + unit - 1) // unit) * unit
        if value <= high:
            return value
    return high


@njit(nogil=True, cache=True)
def finish(coder: Ints, data: Bytes, begin: int) -> int:
    """Write the fewest bytes that tell the last interval, zeros behind them understood; gives the end."""
    value = _ending(coder[0], coder[1])
    while value > 0:
        if coder[3] < coder[4]:
            data[coder[3]] = value >> 24
        coder[3] += 1
        value = (value << 8) & 0xFFFFFFFF
    end: int = coder[3]
    while end > begin and end <= coder[4] and data[end - 1] == 0:
        end -= 1
    return end


@njit(nogil=True, cache=True)
def ends_as_written(coder: Ints, data: Bytes, begin: int) -> bool:
    """Whether what was read is, to its last byte, what `finish` would have written."""
    at: int = coder[3] - 4
    end: int = coder[4]
    if end > begin and data[end - 1] == 0:
        return False
    value = _ending(coder[0], coder[1])
    for _ in range(4):
        if (data[at] if at < end else 0) != value >> 24:
            return False
        at += 1
        value = (value << 8) & 0xFFFFFFFF
    return at >= end


@njit(nogil=True, cache=True)
def mixed(
    coder: Ints,
    data: Bytes,
    bit: int,
    count: int,
    first_set: int,
    second_set: int,
    refine: int,
    slots: Slots,
    weights: Weights,
    refined: Refined,
    tables: Ints,
) -> int:
    """Code one bit with the mixed opinion of the first `count` contexts in `coder`, and learn from it."""
    for i in range(count):
        slot = int(np.int64(slots[coder[CONTEXT + i]]))
        p = slot >> 16
        n = slot & 1023
        coder[_INPUT + i] = tables[p >> 4]
        coder[_INPUT + count + i] = ((p - 32768) * min(n, 30)) >> 11
    a = 0
    b = 0
    for i in range(2 * count):
        a += int(weights[first_set, i]) * coder[_INPUT + i]
        b += int(weights[second_set, i]) * coder[_INPUT + i]
    a = min(2047, max(-2047, a >> 16))
    b = min(2047, max(-2047, b >> 16))
    s = (a + b) >> 1
    plain = tables[_SQUASH + s + 2048]
    # the last stage: what came of such an opinion in such a place
    place = (s + 2048) >> 7
    part = (s + 2048) & 127
    below = int(np.int64(refined[refine, place]))
    above = int(np.int64(refined[refine, place + 1]))
    known = (below * (128 - part) + above * part) >> 7
    p = (plain + known) >> 1
    p = min(65535 - _LEAST, max(_LEAST, p))
    bit = code(coder, data, bit, p)

    y = bit << 16
    error_a = (y - tables[_SQUASH + a + 2048]) * _LEARNING
    error_b = (y - tables[_SQUASH + b + 2048]) * _LEARNING
    for i in range(2 * count):
        weights[first_set, i] += (coder[_INPUT + i] * error_a + 131072) >> 18
        weights[second_set, i] += (coder[_INPUT + i] * error_b + 131072) >> 18
    y = bit * 65535
    nearest = place + 1 if part >= 64 else place
    refined[refine, nearest] += (y - np.int64(refined[refine, nearest])) >> _REFINING
    y = bit * 4194303
    for i in range(count):
        slot = int(np.int64(slots[coder[CONTEXT + i]]))
        p = slot >> 10
        n = slot & 1023
        p += ((y - p) * tables[_RATES + n]) >> 16
        p = min(4194303 - _LEAST_IN_SLOT, max(_LEAST_IN_SLOT, p))
        if n < _COUNT_LIMIT:
            n += 1
        slots[coder[CONTEXT + i]] = (p << 10) | n
    return bit


@njit(nogil=True, cache=True)
def slot(region: int, a: int, b: int, c: int, d: int) -> int:
    """Where the context of these small numbers is kept in its region of 4096."""
    v = (a * 1000003 + b * 29791 + c * 961 + d * 31 + 7919) & 0x3FFFFFFF
    v = (v * 2654435761) >> 9
    v ^= v >> 17
    return (region << 12) + (v & 4095)


@njit(nogil=True, cache=True)
def number(
    coder: Ints,
    data: Bytes,
    value: int,
    kind: int,
    a: int,
    b: int,
    bits: int,
    slots: Slots,
    weights: Weights,
    refined: Refined,
    tables: Ints,
) -> int:
    """Code a whole number of at most `bits` bits and either sign; `kind` (0 to 31), `a` and `b`: what it depends on."""
    at = kind * 40
    size = 0
    while size < bits and (abs(value) >> size) > 0:
        size += 1
    got = 0
    while got < bits:
        coder[CONTEXT] = slot(25, at + got, 0, 0, 0)
        coder[CONTEXT + 1] = slot(26, at + got, a + 1, 0, 0)
        coder[CONTEXT + 2] = slot(27, at + got, a + 1, b + 1, 0)
        more = mixed(
            coder, data, 1 if size > got else 0, 3, 256 + kind, 288 + min(got, 15), 128 + min(got, 15),
            slots, weights, refined, tables,
        )  # fmt: skip
        if more == 0:
            break
        got += 1
    if got == 0:
        return 0
    coder[CONTEXT] = slot(25, at + 39, 0, 0, 0)
    coder[CONTEXT + 1] = slot(26, at + 39, a + 1, got, 0)
    coder[CONTEXT + 2] = slot(27, at + 39, a + 1, b + 1, got)
    negative = mixed(
        coder, data, 1 if value < 0 else 0, 3, 256 + kind, 304, 144, slots, weights, refined, tables
    )  # fmt: skip
    result = 1
    for k in range(got - 2, -1, -1):
        bit = (abs(value) >> k) & 1
        if got - 2 - k < 3:
            coder[CONTEXT] = slot(28, at + got, result, 0, 0)
            coder[CONTEXT + 1] = slot(28, at + got, result, a + 1, 1)
            bit = mixed(coder, data, bit, 2, 305 + got - 2 - k, 308, 145, slots, weights, refined, tables)
        else:
            bit = code(coder, data, bit, 32768)
        result = 2 * result + bit
    return -result if negative else result
