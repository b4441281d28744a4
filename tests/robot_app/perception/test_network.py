"""Steps 2-7, on networks made by hand."""

from __future__ import annotations

import numpy as np

from robot_app.perception.network import _kernels as network


def nodes(*points_m: tuple[float, float, float]) -> np.ndarray:
    return np.array(points_m, np.float32)


def pairs_of(linked: np.ndarray) -> set[tuple[int, int]]:
    return {(int(a), int(b)) for a, b in np.argwhere(np.triu(linked))}


def test_isolated_nodes_go_and_the_others_keep_their_connections() -> None:
    node_m = nodes((9, 9, 9), (1, 0, 1), (9, 9, 9), (2, 0, 1), (3, 0, 1))
    curve = np.arange(5, dtype=np.int32)
    linked = np.zeros((5, 5), np.uint8)
    linked[1, 3] = linked[3, 1] = linked[3, 4] = linked[4, 3] = 1
    weight = np.arange(5, dtype=np.float32)
    count = network.remove_isolated(node_m, curve, weight, linked, 5)
    assert count == 3
    assert weight[:3].tolist() == [1, 3, 4]
    assert node_m[:3, 0].tolist() == [1, 2, 3]
    assert curve[:3].tolist() == [1, 3, 4]
    assert pairs_of(linked) == {(0, 1), (1, 2)}
