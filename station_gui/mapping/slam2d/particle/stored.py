"""The path of one particle into a saved map and back."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from station_gui.mapping.saved_map import SavedMap
from station_gui.mapping.slam2d.base import MappingError
from station_gui.mapping.slam2d.keyframes import Keyframe
from station_gui.mapping.slam2d.se2_arrays import between, compose_all

FloatArray = NDArray[np.float64]

_NODE_DISTANCE_M, _NODE_TURN_RAD = 1.0, math.radians(60.0)  # graph SLAM's, which may go on from the map
_SHIFT_SIGMA_M, _TURN_SIGMA_RAD = 0.02, math.radians(0.3)  # of the way from one node to the next


def to_saved(steps: Sequence[Keyframe], poses: FloatArray) -> SavedMap:
    """`poses`: (K, 3) of the steps, map frame. A chain: what a loop says is in the poses."""
    if not steps:
        raise MappingError("there is no map to save yet")
    nodes = [0]
    of_step = []
    way_m = turn_rad = 0.0
    for k in range(len(steps)):
        if k:
            step = between(poses[k - 1], poses[k])
            way_m += float(np.hypot(step[0], step[1]))
            turn_rad += abs(float(step[2]))
        if way_m >= _NODE_DISTANCE_M or turn_rad >= _NODE_TURN_RAD:
            nodes.append(k)
            way_m = turn_rad = 0.0
        of_step.append(len(nodes) - 1)
    at = poses[nodes]
    measured = np.array([between(a, b) for a, b in itertools.pairwise(at)]).reshape(-1, 3)
    edges = len(measured)
    weights = 1.0 / np.square([_SHIFT_SIGMA_M, _SHIFT_SIGMA_M, _TURN_SIGMA_RAD])
    first = np.arange(edges, dtype=np.int32)
    return SavedMap(
        nodes=at.copy(),
        ends=np.column_stack((first, first + 1)).astype(np.int32),
        measured=measured,
        information=np.tile(np.diag(weights), (edges, 1, 1)),
        robust=np.zeros(edges, np.bool_),
        length_m=np.maximum(np.hypot(measured[:, 0], measured[:, 1]), 0.1),
        keyframes=tuple(
            Keyframe(
                step.stamp_s, of_step[k], between(at[of_step[k]], poses[k]), step.points_m, step.normals, step.scanner_m
            )
            for k, step in enumerate(steps)
            if len(step.points_m)
        ),
    )


def steps_of(saved: SavedMap) -> tuple[list[Keyframe], FloatArray]:
    """Every keyframe as a step of its own, and their poses, (K, 3), map frame."""
    in_node = np.array([keyframe.in_node for keyframe in saved.keyframes])
    poses = compose_all(saved.nodes[saved.keyframe_nodes()], in_node)
    steps = [
        Keyframe(keyframe.stamp_s, k, np.zeros(3), keyframe.points_m, keyframe.normals, keyframe.scanner_m)
        for k, keyframe in enumerate(saved.keyframes)
    ]
    return steps, poses
