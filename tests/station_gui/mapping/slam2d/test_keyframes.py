from __future__ import annotations

import numpy as np

from station_gui.mapping.slam2d.keyframes import Placed
from station_gui.mapping.slam2d.se2_arrays import compose


def test_poses_ride_on_their_nodes() -> None:
    rng = np.random.default_rng(0)
    nodes, placed = rng.uniform(-3, 3, (4, 3)), Placed()
    riders = [(int(node), rng.uniform(-3, 3, 3)) for node in (0, 0, 2, 1, 1, 2, 3)]
    for node, in_node in riders:
        placed.append(node, in_node)

    np.testing.assert_allclose(placed.poses(nodes), [compose(nodes[node], in_node) for node, in_node in riders])
    assert Placed().poses(nodes).shape == (0, 3)
