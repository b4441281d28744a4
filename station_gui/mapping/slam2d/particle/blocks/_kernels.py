"""Kernels of the shared maps: plain arrays, gathered in a tuple.

The plane is cut into cells, and these into blocks of 16 × 16. A place is a block's position in the plane, found by
a hash table that all particles share; `directory` names the block that a particle has at a place. A block that more
than one particle refers to is copied before one of them changes it.

A cell holds a surfel, the mean of the hits in it and of their normals, and the way to the nearest cell that has one.
A surfel remembers the age in which it was hit last. It counts for nothing while its age is not joined to the present,
and a new hit then begins it afresh.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

SIDE_BITS = 4
SIDE = 1 << SIDE_BITS
MAX_REACH = 7
NONE_NEAR = 255
CODE_ROW = 2 * MAX_REACH + 1
UNIT = 32767.0  # one cell, or a normal of length one, in a surfel's whole numbers
AGES = 32768
FARTHEST_BLOCK = 1 << 20
_PLACES = 0  # indices into `Blocks.counts`
_FREE = 1


class Blocks(NamedTuple):
    """N particles, C places, P blocks.

    `keys` (T,) int64, -1 where empty, and `places` (T,) int32: the hash table. `directory` (N, C) int32, -1 for none.
    `nearest` (P, 16, 16) uint8: (row + 7) * 15 + (column + 7) of the way to the nearest surfel, 255 for none.
    `surfels` (P, 16, 16, 6) int16: count, mean x and y from the cell's corner, mean normal x and y, age; see `UNIT`.
    `references` (P,) int32: particles that refer to a block. `free` (P,) int32: a stack. `counts` (2,) int64: places
    in use, blocks on the stack. `joined` (AGES,) uint8: 1 for an age whose surfels count.
    """

    keys: NDArray[np.int64]
    places: NDArray[np.int32]
    directory: NDArray[np.int32]
    nearest: NDArray[np.uint8]
    surfels: NDArray[np.int16]
    references: NDArray[np.int32]
    free: NDArray[np.int32]
    counts: NDArray[np.int64]
    joined: NDArray[np.uint8]


@njit(nogil=True, cache=True)
def _slot(blocks: Blocks, key: int) -> int:
    """Where `key` is in the table, or the empty slot where it belongs."""
    mask = blocks.keys.shape[0] - 1
    mixed = key * -7046029254386353131  # Knuth's multiplicative hash: 2**64 over the golden ratio
    slot = ((mixed >> 32) ^ (mixed >> 12)) & mask
    while blocks.keys[slot] != -1 and blocks.keys[slot] != key:
        slot = (slot + 1) & mask
    return int(slot)


@njit(nogil=True, cache=True)
def block_at(blocks: Blocks, particle: int, row: int, column: int) -> int:
    """The particle's block that holds a cell, -1 for none. `row`, `column`: of the cell in the plane."""
    block_row = (row >> SIDE_BITS) + FARTHEST_BLOCK
    block_column = (column >> SIDE_BITS) + FARTHEST_BLOCK
    if not (0 <= block_row < 2 * FARTHEST_BLOCK and 0 <= block_column < 2 * FARTHEST_BLOCK):
        return -1
    key = block_row * (2 * FARTHEST_BLOCK) + block_column
    slot = _slot(blocks, key)
    if blocks.keys[slot] == -1:
        return -1
    return int(blocks.directory[particle, blocks.places[slot]])


@njit(nogil=True, cache=True)
def own_block(blocks: Blocks, particle: int, row: int, column: int) -> int:
    """The same block for writing: made or copied where need be; -1 where there is no room."""
    block_row = (row >> SIDE_BITS) + FARTHEST_BLOCK
    block_column = (column >> SIDE_BITS) + FARTHEST_BLOCK
    if not (0 <= block_row < 2 * FARTHEST_BLOCK and 0 <= block_column < 2 * FARTHEST_BLOCK):
        return -1
    key = block_row * (2 * FARTHEST_BLOCK) + block_column
    slot = _slot(blocks, key)
    if blocks.keys[slot] == -1:
        if blocks.counts[_PLACES] >= blocks.directory.shape[1] or blocks.counts[_FREE] == 0:
            return -1
        blocks.keys[slot] = key
        blocks.places[slot] = blocks.counts[_PLACES]
        blocks.counts[_PLACES] += 1
    place = blocks.places[slot]
    block = blocks.directory[particle, place]
    if block >= 0 and blocks.references[block] == 1:
        return int(block)
    if blocks.counts[_FREE] == 0:
        return -1
    blocks.counts[_FREE] -= 1
    fresh = blocks.free[blocks.counts[_FREE]]
    if block >= 0:
        blocks.nearest[fresh] = blocks.nearest[block]
        blocks.surfels[fresh] = blocks.surfels[block]
        blocks.references[block] -= 1
    else:
        blocks.nearest[fresh] = NONE_NEAR
        blocks.surfels[fresh] = 0
    blocks.references[fresh] = 1
    blocks.directory[particle, place] = fresh
    return int(fresh)


@njit(nogil=True, cache=True)
def adopt(blocks: Blocks, before: NDArray[np.int32], parents: NDArray[np.int64]) -> None:
    """Every particle takes over the map of its parent. `before` (N, places in use): a copy of the directory."""
    count, places = before.shape
    for particle in range(count):
        for place in range(places):
            block = before[parents[particle], place]
            blocks.directory[particle, place] = block
            if block >= 0:
                blocks.references[block] += 1
    for particle in range(count):
        for place in range(places):
            block = before[particle, place]
            if block < 0:
                continue
            blocks.references[block] -= 1
            if blocks.references[block] == 0:
                blocks.free[blocks.counts[_FREE]] = block
                blocks.counts[_FREE] += 1


@njit(nogil=True, cache=True)
def release(blocks: Blocks, particle: int) -> None:
    """The particle's map becomes empty."""
    for place in range(blocks.counts[_PLACES]):
        block = blocks.directory[particle, place]
        if block < 0:
            continue
        blocks.directory[particle, place] = -1
        blocks.references[block] -= 1
        if blocks.references[block] == 0:
            blocks.free[blocks.counts[_FREE]] = block
            blocks.counts[_FREE] += 1


@njit(nogil=True, cache=True)
def counts_in(blocks: Blocks, particle: int, block: int, row: int, column: int) -> bool:
    """Whether the surfel nearest to a cell of `block` counts."""
    code = blocks.nearest[block, row & (SIDE - 1), column & (SIDE - 1)]
    other_row = row + code // CODE_ROW - MAX_REACH
    other_column = column + code % CODE_ROW - MAX_REACH
    holder = block
    if other_row >> SIDE_BITS != row >> SIDE_BITS or other_column >> SIDE_BITS != column >> SIDE_BITS:
        holder = block_at(blocks, particle, other_row, other_column)
        if holder < 0:
            return False
    return bool(blocks.joined[blocks.surfels[holder, other_row & (SIDE - 1), other_column & (SIDE - 1), 5]] != 0)


@njit(nogil=True, cache=True)
def stamp(
    blocks: Blocks,
    particle: int,
    points: NDArray[np.float64],
    normals: NDArray[np.float64],
    pose: NDArray[np.float64],
    cell_m: float,
    reach: int,
    max_count: int,
    age: int,
) -> None:
    """Add a scan at `pose` to a particle's map; older hits of a cell fade after `max_count`."""
    c = math.cos(pose[2])
    s = math.sin(pose[2])
    for i in range(points.shape[0]):
        x = (pose[0] + c * points[i, 0] - s * points[i, 1]) / cell_m
        y = (pose[1] + s * points[i, 0] + c * points[i, 1]) / cell_m
        column = math.floor(x)
        row = math.floor(y)
        block = own_block(blocks, particle, row, column)
        if block < 0:
            continue
        r = row & (SIDE - 1)
        q = column & (SIDE - 1)
        before = int(blocks.surfels[block, r, q, 0])
        if before > 0 and blocks.joined[blocks.surfels[block, r, q, 5]] == 0:
            before = 0
        count = min(before, max_count - 1) + 1
        if count == 1:
            for k in range(1, 5):
                blocks.surfels[block, r, q, k] = 0
        blocks.surfels[block, r, q, 0] = count
        _blend(blocks.surfels, block, r, q, 1, x - column, count)
        _blend(blocks.surfels, block, r, q, 2, y - row, count)
        _blend(blocks.surfels, block, r, q, 3, c * normals[i, 0] - s * normals[i, 1], count)
        _blend(blocks.surfels, block, r, q, 4, s * normals[i, 0] + c * normals[i, 1], count)
        if before == 0:
            apart = blocks.nearest[block, r, q] != NONE_NEAR and not counts_in(blocks, particle, block, row, column)
            blocks.surfels[block, r, q, 5] = age
            _brush(blocks, particle, row, column, reach, apart)
        blocks.surfels[block, r, q, 5] = age


@njit(nogil=True, cache=True)
def _blend(surfels: NDArray[np.int16], block: int, r: int, q: int, k: int, value: float, count: int) -> None:
    mean = float(surfels[block, r, q, k])
    surfels[block, r, q, k] = math.floor(mean + (value * UNIT - mean) / count + 0.5)


@njit(nogil=True, cache=True)
def _brush(blocks: Blocks, particle: int, row: int, column: int, reach: int, apart: bool) -> None:
    """Tell the cells round a new surfel of it, block by block; `apart`: surfels that do not count are near."""
    first_row = (row - reach) >> SIDE_BITS
    last_row = (row + reach) >> SIDE_BITS
    first_column = (column - reach) >> SIDE_BITS
    last_column = (column + reach) >> SIDE_BITS
    for block_row in range(first_row, last_row + 1):
        for block_column in range(first_column, last_column + 1):
            _brush_block(blocks, particle, block_row << SIDE_BITS, block_column << SIDE_BITS, row, column, reach, apart)


@njit(nogil=True, cache=True)
def _brush_block(
    blocks: Blocks, particle: int, corner_row: int, corner_column: int, row: int, column: int, reach: int, apart: bool
) -> None:
    """A cell keeps its surfel only where that is as near and counts."""
    block = block_at(blocks, particle, corner_row, corner_column)
    own = False
    for r in range(max(row - reach - corner_row, 0), min(row + reach - corner_row, SIDE - 1) + 1):
        dr = corner_row + r - row
        for q in range(max(column - reach - corner_column, 0), min(column + reach - corner_column, SIDE - 1) + 1):
            dc = corner_column + q - column
            d2 = dr * dr + dc * dc
            if d2 > reach * reach:
                continue
            near = block >= 0 and distance2(blocks.nearest[block, r, q]) <= d2
            if near and (not apart or counts_in(blocks, particle, block, corner_row + r, corner_column + q)):
                continue
            if not own:
                block = own_block(blocks, particle, corner_row, corner_column)
                own = True
                if block < 0:
                    return
            blocks.nearest[block, r, q] = (MAX_REACH - dr) * CODE_ROW + MAX_REACH - dc


@njit(nogil=True, cache=True)
def distance2(code: int) -> int:
    """Squared distance in cells to the nearest surfel."""
    if code == NONE_NEAR:
        return 1 << 20
    dr = code // CODE_ROW - MAX_REACH
    dc = code % CODE_ROW - MAX_REACH
    return int(dr * dr + dc * dc)
