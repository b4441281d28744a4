"""Kernels: a binary heap in two arrays, the least key first (Williams 1964)."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


@njit(nogil=True, cache=True)
def heap_push(keys: Floats, items: Ints, size: int, key: float, item: int) -> int:
    """Put an item into the binary heap of `size` items; returns the new size. A full heap drops the item."""
    if size >= len(keys):
        return size
    i = size
    while i > 0:
        parent = (i - 1) // 2
        if keys[parent] <= key:
            break
        keys[i] = keys[parent]
        items[i] = items[parent]
        i = parent
    keys[i] = key
    items[i] = item
    return size + 1


@njit(nogil=True, cache=True)
def heap_pop(keys: Floats, items: Ints, size: int) -> int:
    """Take the item with the smallest key, which is then at index `size - 1`; the new size is `size - 1`."""
    top_key = keys[0]
    top_item = items[0]
    last = size - 1
    key = keys[last]
    item = items[last]
    i = 0
    while True:
        child = 2 * i + 1
        if child >= last:
            break
        if child + 1 < last and keys[child + 1] < keys[child]:
            child += 1
        if keys[child] >= key:
            break
        keys[i] = keys[child]
        items[i] = items[child]
        i = child
    keys[i] = key
    items[i] = item
    keys[last] = top_key
    items[last] = top_item
    return last
