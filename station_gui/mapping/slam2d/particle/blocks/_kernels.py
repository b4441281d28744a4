"""Kernels of the shared maps: plain arrays, gathered in a tuple.

The plane is cut into cells, and these into blocks of 16 × 16. A place is a block's position in the plane, found by
a hash table that all particles share; `directory` names the block that a particle has at a place. A block that more
than one particle refers to is copied before one of them changes it.

A cell holds a surfel, the mean of the hits in it and of their normals, and the way to the nearest cell that has one.
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
_FARTHEST_BLOCK = 1 << 20
_PLACES = 0  # indices into `Blocks.counts`
_FREE = 1


class Blocks(NamedTuple):
    """N particles, C places, P blocks.

    `keys` (T,) int64, -1 where empty, and `places` (T,) int32: the hash table. `directory` (N, C) int32, -1 for none.
    `nearest` (P, 16, 16) uint8: (row + 7) * 15 + (column + 7) of the way to the nearest surfel, 255 for none.
    `surfels` (P, 16, 16, 5) float32: count, mean x, y, mean normal x, y. `references` (P,) int32: particles that
    refer to a block. `free` (P,) int32: a stack. `counts` (2,) int64: places in use, blocks on the stack.
    """

    keys: NDArray[np.int64]
    places: NDArray[np.int32]
    directory: NDArray[np.int32]
    nearest: NDArray[np.uint8]
    surfels: NDArray[np.float32]
    references: NDArray[np.int32]
    free: NDArray[np.int32]
    counts: NDArray[np.int64]


@njit(nogil=True, cache=True)
def _slot(blocks: Blocks, key: int) -> int:
    """Where `key` is in the table, or the empty slot where it belongs."""
    mask = blocks.keys.shape[0] - 1
    mixed = (key ^ (key >> 21)) * 0x9E3779B1
    slot = (mixed ^ (mixed >> 15)) & mask
    while blocks.keys[slot] != -1 and blocks.keys[slot] != key:
        slot = (slot + 1) & mask
    return int(slot)


@njit(nogil=True, cache=True)
def block_at(blocks: Blocks, particle: int, row: int, column: int) -> int:
    """The particle's block that holds a cell, -1 for none. `row`, `column`: of the cell in the plane."""
    block_row = (row >> SIDE_BITS) + _FARTHEST_BLOCK
    block_column = (column >> SIDE_BITS) + _FARTHEST_BLOCK
    if not (0 <= block_row < 2 * _FARTHEST_BLOCK and 0 <= block_column < 2 * _FARTHEST_BLOCK):
        return -1
    key = block_row * (2 * _FARTHEST_BLOCK) + block_column
    slot = _slot(blocks, key)
    if blocks.keys[slot] == -1:
        return -1
    return int(blocks.directory[particle, blocks.places[slot]])


@njit(nogil=True, cache=True)
def own_block(blocks: Blocks, particle: int, row: int, column: int) -> int:
    """The same block for writing: made or copied where need be; -1 where there is no room."""
    block_row = (row >> SIDE_BITS) + _FARTHEST_BLOCK
    block_column = (column >> SIDE_BITS) + _FARTHEST_BLOCK
    if not (0 <= block_row < 2 * _FARTHEST_BLOCK and 0 <= block_column < 2 * _FARTHEST_BLOCK):
        return -1
    key = block_row * (2 * _FARTHEST_BLOCK) + block_column
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
        blocks.surfels[fresh] = 0.0
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
def stamp(
    blocks: Blocks,
    particle: int,
    points: NDArray[np.float64],
    normals: NDArray[np.float64],
    pose: NDArray[np.float64],
    cell_m: float,
    reach: int,
    max_count: float,
) -> None:
    """Add a scan at `pose` to a particle's map; older hits of a cell fade after `max_count`."""
    c = math.cos(pose[2])
    s = math.sin(pose[2])
    for i in range(points.shape[0]):
        x = pose[0] + c * points[i, 0] - s * points[i, 1]
        y = pose[1] + s * points[i, 0] + c * points[i, 1]
        column = math.floor(x / cell_m)
        row = math.floor(y / cell_m)
        block = own_block(blocks, particle, row, column)
        if block < 0:
            continue
        r = row & (SIDE - 1)
        q = column & (SIDE - 1)
        if blocks.surfels[block, r, q, 0] == 0.0:
            _brush(blocks, particle, row, column, reach)
        count = min(blocks.surfels[block, r, q, 0], max_count - 1.0) + 1.0
        blocks.surfels[block, r, q, 0] = count
        blocks.surfels[block, r, q, 1] += (x - blocks.surfels[block, r, q, 1]) / count
        blocks.surfels[block, r, q, 2] += (y - blocks.surfels[block, r, q, 2]) / count
        nx = c * normals[i, 0] - s * normals[i, 1]
        ny = s * normals[i, 0] + c * normals[i, 1]
        blocks.surfels[block, r, q, 3] += (nx - blocks.surfels[block, r, q, 3]) / count
        blocks.surfels[block, r, q, 4] += (ny - blocks.surfels[block, r, q, 4]) / count


@njit(nogil=True, cache=True)
def _brush(blocks: Blocks, particle: int, row: int, column: int, reach: int) -> None:
    """Tell the cells round a new surfel of it, block by block."""
    first_row = (row - reach) >> SIDE_BITS
    last_row = (row + reach) >> SIDE_BITS
    first_column = (column - reach) >> SIDE_BITS
    last_column = (column + reach) >> SIDE_BITS
    for block_row in range(first_row, last_row + 1):
        for block_column in range(first_column, last_column + 1):
            _brush_block(blocks, particle, block_row << SIDE_BITS, block_column << SIDE_BITS, row, column, reach)


@njit(nogil=True, cache=True)
def _brush_block(
    blocks: Blocks, particle: int, corner_row: int, corner_column: int, row: int, column: int, reach: int
) -> None:
    block = block_at(blocks, particle, corner_row, corner_column)
    own = False
    for r in range(max(row - reach - corner_row, 0), min(row + reach - corner_row, SIDE - 1) + 1):
        dr = corner_row + r - row
        for q in range(max(column - reach - corner_column, 0), min(column + reach - corner_column, SIDE - 1) + 1):
            dc = corner_column + q - column
            d2 = dr * dr + dc * dc
            if d2 > reach * reach or (block >= 0 and distance2(blocks.nearest[block, r, q]) <= d2):
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
