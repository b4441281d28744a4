"""A scan's symbols: is there a measurement, and how far is it from what was expected. One walk for both directions.

All lengths are whole millimetres, 0 where there is none.
"""

from __future__ import annotations

from numba import njit

from shared.protocol.compact.mixing._kernels import CONTEXT, Bytes, Ints, Refined, Slots, Weights, code, mixed, slot

_UNARY = 8
_FAR_BITS = 13


@njit(nogil=True, cache=True)
def level(x: int) -> int:
    """How big a difference is, 0 to 6."""
    x = abs(x)
    if x < 24:
        return 0 if x < 6 else 1 if x < 12 else 2
    return 3 if x < 48 else 4 if x < 100 else 5 if x < 300 else 6


@njit(nogil=True, cache=True)
def steps(x: int, step: int, limit: int) -> int:
    """The nearest number of steps, within the limit."""
    return min(limit, max(-limit, (2 * x + step) // (2 * step)))


@njit(nogil=True, cache=True)
def residual(
    coder: Ints,
    data: Bytes,
    e: int,
    kind: int,
    gap: int,
    slots: Slots,
    weights: Weights,
    refined: Refined,
    tables: Ints,
) -> int:
    """Code a number from -4 to 4."""
    negative = 0
    size = 0
    for turn in range(5):
        if turn == 0:
            bit = 1 if e == 0 else 0
        elif turn == 1:
            bit = 1 if e < 0 else 0
        else:
            bit = 1 if abs(e) > turn - 1 else 0
        coder[CONTEXT] = slot(23, turn, negative, 0, 0)
        coder[CONTEXT + 1] = slot(23, turn + 8, negative, kind, 0)
        coder[CONTEXT + 2] = slot(23, turn + 16, negative, gap, 0)
        bit = mixed(
            coder, data, bit, 3, 230 + turn, 235, 101 + turn,
            slots, weights, refined, tables,
        )  # fmt: skip
        if turn == 0:
            if bit == 1:
                return 0
            size = 1
        elif turn == 1:
            negative = bit
        elif bit == 0:
            break
        else:
            size = turn
    return -size if negative else size


@njit(nogil=True, cache=True)
def anything(
    coder: Ints,
    data: Bytes,
    value: int,
    beam: int,
    slots: Slots,
    weights: Weights,
    refined: Refined,
    tables: Ints,
) -> int:
    """Code a number of _FAR_BITS bits of which little is known."""
    got = 0
    for k in range(_FAR_BITS):
        bit = (value >> (_FAR_BITS - 1 - k)) & 1
        if k < 10:
            coder[CONTEXT] = slot(24, k, got, 0, 0)
            coder[CONTEXT + 1] = slot(24, k, got, 1 + (beam >> 4), 0)
            bit = mixed(
                coder, data, bit, 2, 236 + k, 246, 106 + k,
                slots, weights, refined, tables,
            )  # fmt: skip
        else:
            bit = code(coder, data, bit, 32768)
        got = 2 * got + bit
    return got


@njit(nogil=True, cache=True)
def code_scan(
    coder: Ints,
    data: Bytes,
    ranges: Ints,
    step: int,
    slack: int,
    views: Ints,
    before: Ints,
    shift: int,
    slots: Slots,
    weights: Weights,
    refined: Refined,
    tables: Ints,
    decoded: Ints,
) -> None:
    """Code `ranges` (B,), or read them; `decoded` (B, 3) out: the range, the expected range, the count behind that.

    `views` (B, 8): expected range and count, slope, from the newest scan, from the second, ...; `before` (B,): the
    last scan's ranges; beam i pointed then where i + `shift` points now. A measurement within `slack` of the expected
    is taken for it.
    """
    beams = ranges.shape[0]
    decoding = coder[5] == 1
    error1 = 0
    error2 = 0
    invalid_run = 0
    for i in range(beams):
        p = views[i, 0]
        p2 = views[i, 2]
        known = min(views[i, 1], 15)
        slope = views[i, 4]
        hv = 1 if p > 0 else 0
        left = decoded[i - 1, 0] if i > 0 else 0
        left2 = decoded[i - 2, 0] if i > 1 else 0
        left3 = decoded[i - 3, 0] if i > 2 else 0
        l1 = 1 if left > 0 else 0
        l2 = 1 if left2 > 0 else 0
        l3 = 1 if left3 > 0 else 0
        after = views[i + 1, 0] if i + 1 < beams else 0
        after2 = views[i + 2, 0] if i + 2 < beams else 0
        nv = 1 if after > 0 else 0
        nv2 = 1 if after2 > 0 else 0
        pv = 1 if i > 0 and views[i - 1, 0] > 0 else 0
        k = i - shift
        t1 = 1 if k >= 0 and k < beams and before[k] > 0 else 0
        t0 = 1 if k >= 1 and k <= beams and before[k - 1] > 0 else 0
        t2 = 1 if k >= -1 and k < beams - 1 and before[k + 1] > 0 else 0
        if k < 0 or k >= beams:
            t1 = 2
        jump = level(p - left) if l1 and hv else 7
        ahead = level(after - p) if nv and hv else 7
        two = level(p - p2) if hv and p2 > 0 else 7 + (1 if p2 > 0 else 0)
        count = min(known, 4)

        v = 1 if ranges[i] > 0 else 0
        a = hv + 2 * l1 + 4 * l2 + 8 * nv + 16 * t1
        coder[CONTEXT] = slot(0, a, count, 0, 0)
        coder[CONTEXT + 1] = slot(1, i, 0, 0, 0)
        coder[CONTEXT + 2] = slot(2, hv + 2 * l1 + 4 * pv, nv + 2 * nv2, l2 + 2 * l3, count)
        coder[CONTEXT + 3] = slot(3, t1 + 4 * t0 + 8 * t2, l1, hv, slope)
        coder[CONTEXT + 4] = slot(4, jump, ahead, l1 + 2 * l2, 0)
        coder[CONTEXT + 5] = slot(5, p // 200 if hv else 99, l1, 0, 0)
        coder[CONTEXT + 6] = slot(6, error1 + 8, error2 + 8, l1 + 2 * hv, 0)
        coder[CONTEXT + 7] = slot(7, i >> 3, t1, hv, l1)
        coder[CONTEXT + 8] = slot(8, l1 + 2 * l2 + 4 * l3, left // 300, min(invalid_run, 12), hv)
        coder[CONTEXT + 9] = slot(9, two, l1, t1, count + 5 * slope)
        v = mixed(
            coder, data, v, 10, a, 64 + min(invalid_run, 7) + 8 * (t1 + 3 * hv),
            hv + 2 * l1 + 4 * t1, slots, weights, refined, tables,
        )  # fmt: skip
        if v == 0:
            invalid_run += 1
            decoded[i, 0] = 0
            decoded[i, 1] = 0
            decoded[i, 2] = 0
            continue
        invalid_run = 0

        aside: int = 0
        if l1:
            aside = left
            if l2 and abs(left - left2) < 150:
                # a straight wall is linear in the inverse of the range
                den = 2 * left2 - left
                if den > 0:
                    aside = min(6000, left * left2 // den)
        elif l2:
            aside = left2
        source = 0
        m: int = p
        if not hv:
            source = 1
            m = aside
            if aside == 0:
                source = 2
                m = p2 if p2 > 0 else 1500
        q = (2 * (ranges[i] - m) + step) // (2 * step)
        if abs(ranges[i] - m) <= slack:
            q = 0
        gap = level(aside - m) * 2 + (1 if aside > m else 0) if aside > 0 else 15
        near = steps(aside - m, step, 6) if aside > 0 else 9
        other = steps(p2 - m, step, 6) if p2 > 0 and hv else 9
        far = m // 400
        size = 0
        negative = 0
        magnitude = _UNARY
        for turn in range(2 + _UNARY):
            if turn == 0:
                bit = 1 if q == 0 else 0
                place = 0
            elif turn == 1:
                bit = 1 if q < 0 else 0
                place = 1
            else:
                size = turn - 1
                if size == _UNARY:
                    break
                bit = 1 if abs(q) > size else 0
                place = 1 + size + negative * _UNARY
            spot = place * 3 + source
            coder[CONTEXT] = slot(10, spot, count, ahead, 0)
            coder[CONTEXT + 1] = slot(11, spot, error1 + 8, error2 + 8, 0)
            coder[CONTEXT + 2] = slot(12, spot, near + 8, known, 0)
            coder[CONTEXT + 3] = slot(13, spot, near + 8, error1 + 8, 0)
            coder[CONTEXT + 4] = slot(14, spot, other + 8, error1 + 8, 0)
            coder[CONTEXT + 5] = slot(15, spot, jump, ahead, 0)
            coder[CONTEXT + 6] = slot(16, spot, far, error1 + 8, 0)
            coder[CONTEXT + 7] = slot(17, spot, gap, jump, 0)
            coder[CONTEXT + 8] = slot(18, spot, i >> 2, 0, 0)
            coder[CONTEXT + 9] = slot(19, spot, other + 8, near + 8, 0)
            coder[CONTEXT + 10] = slot(20, spot, slope, far, known)
            coder[CONTEXT + 11] = slot(21, spot, slope, error1 + 8, jump)
            bit = mixed(
                coder, data, bit, 12, 128 + min(place, 18) * 3 + source,
                192 + min(place, 3) * 16 + min(known, 15), 16 + min(place, 9) * 8 + min(6, abs(error1)),
                slots, weights, refined, tables,
            )  # fmt: skip
            if turn == 0:
                if bit == 1:
                    magnitude = 0
                    break
            elif turn == 1:
                negative = bit
            elif bit == 0:
                magnitude = size
                break
        if magnitude < _UNARY:
            q = -magnitude if negative else magnitude
            r: int = max(1, m + step * q)
        else:
            # an edge: perhaps what is seen beside it, before it or behind it
            r = 0
            tried: int = m
            for k in range(5):
                if k == 0:
                    guess = aside
                elif k == 1:
                    guess = after if l1 and abs(after - left) > 60 else after2
                elif k == 2:
                    guess = p2
                elif k == 3:
                    guess = views[i - 1, 0] if i > 0 else 0
                else:
                    guess = before[i - shift] if 0 <= i - shift < beams else 0
                if guess <= 0 or abs(guess - m) <= 4 * step or (k > 0 and abs(guess - tried) <= 2 * step):
                    continue
                side = 1 if negative == (1 if guess < m else 0) else 0
                tried = guess
                e = (2 * (ranges[i] - guess) + step) // (2 * step)
                coder[CONTEXT] = slot(22, k, side, 0, 0)
                coder[CONTEXT + 1] = slot(22, k + 8, side, level(guess - left) if l1 else 7, hv)
                coder[CONTEXT + 2] = slot(22, k + 16, side, level(guess - m), known)
                coder[CONTEXT + 3] = slot(22, k + 24, side, jump, ahead)
                hit = mixed(
                    coder, data, 1 if abs(e) <= 4 else 0, 4, 224 + k, 229,
                    100, slots, weights, refined, tables,
                )  # fmt: skip
                if hit == 0:
                    continue
                e = residual(
                    coder, data, e, k, level(guess - left) if l1 else 7, slots, weights, refined,
                    tables,
                )  # fmt: skip
                r = max(1, guess + step * e)
                break
            if r == 0:
                r = max(1, step * anything(
                    coder, data, (2 * ranges[i] + step) // (2 * step), i, slots, weights, refined,
                    tables,
                ))  # fmt: skip
            q = 7 if r > m else -7
        if not decoding and ranges[i] > 0 and r <= 0:
            r = 1
        decoded[i, 0] = r
        decoded[i, 1] = m if magnitude < _UNARY and source == 0 else 0
        decoded[i, 2] = views[i, 1]
        error2 = error1
        error1 = max(-7, min(7, q))
