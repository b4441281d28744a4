"""The heap against the standard library's."""

import heapq

import numpy as np

from shared.heap import _kernels


def test_the_heap_gives_back_items_as_heapq_does() -> None:
    generator = np.random.default_rng(1)
    keys, items, twin = np.empty(500), np.empty(500, np.int64), []
    size = 0
    for k in range(400):
        key = float(generator.random())
        size = _kernels.heap_push(keys, items, size, key, k)
        heapq.heappush(twin, (key, k))
        if k % 3 == 0:
            size = _kernels.heap_pop(keys, items, size)
            assert (keys[size], items[size]) == heapq.heappop(twin)
    while size > 0:
        size = _kernels.heap_pop(keys, items, size)
        assert (keys[size], items[size]) == heapq.heappop(twin)


def test_a_full_heap_drops_what_does_not_fit() -> None:
    keys, items = np.empty(2), np.empty(2, np.int64)
    size = 0
    for k in range(5):
        size = _kernels.heap_push(keys, items, size, float(k), k)
    assert size == 2
