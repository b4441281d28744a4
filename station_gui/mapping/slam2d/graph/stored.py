"""A pose graph and its keyframes into a saved map and back."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from station_gui.mapping.saved_map import SavedMap
from station_gui.mapping.slam2d.graph.pose_graph import PoseGraph
from station_gui.mapping.slam2d.keyframes import Keyframe


def to_saved(graph: PoseGraph, keyframes: Sequence[Keyframe], pieces: NDArray[np.int32]) -> SavedMap:
    """A copy: the graph may go on. `pieces`: (N,), as of `SavedMap`."""
    return SavedMap(
        nodes=graph.poses.copy(),
        ends=graph.ends.copy(),
        measured=graph.measured.copy(),
        information=graph.information.copy(),
        robust=graph.robust.copy(),
        length_m=graph.length_m.copy(),
        keyframes=tuple(keyframes),
        pieces=pieces,
    )


def fill(graph: PoseGraph, saved: SavedMap) -> None:
    """Nodes and edges of a saved map into an empty graph."""
    for pose in saved.nodes:
        graph.add_node(pose)
    for e, (i, j) in enumerate(saved.ends.tolist()):
        graph.add_edge(
            i, j, saved.measured[e], saved.information[e], float(saved.length_m[e]), robust=bool(saved.robust[e])
        )
    graph.take_as_settled()
