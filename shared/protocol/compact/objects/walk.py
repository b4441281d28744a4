"""Object networks between the robot's frame and the store that both sides have."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from shared.messages import ObjectNetwork
from shared.protocol.compact import tables
from shared.protocol.compact.model import Coding
from shared.protocol.compact.objects import _kernels as kernels
from shared.protocol.compact.state import HEADING_UNIT, NODES, State

IntArray = NDArray[np.int64]

STEP_MM = 16  # of the grid that nodes are put on: at most 13.9 mm off
MOST_NEW = 255
_HAS_OBJECTS = 11


@dataclass(slots=True, eq=False)
class NetworkChoice:
    """`kept` (NODES,), `keep_edge` (EDGES,): 1 for what is kept.

    `fresh` (F, 4), `extra` (X, 2): see `code_network`.
    """

    kept: IntArray
    keep_edge: IntArray
    fresh: IntArray
    extra: IntArray


def code_objects(coding: Coding, state: State, choice: NetworkChoice | None) -> ObjectNetwork | None:
    """Write or read a network against the store, which is brought up to date; None when nobody looked."""
    if coding.number(int(choice is not None), _HAS_OBJECTS, 1) == 0:
        return None
    store = state.store
    now = state.number + 1
    pose = np.array((state.odom[0], state.odom[1], state.odom[2] * HEADING_UNIT), np.int64)
    kept = choice.kept.copy() if choice is not None else np.zeros(NODES, np.int64)
    keep_edge = choice.keep_edge if choice is not None else np.zeros(len(store.edges), np.int64)
    fresh, extra = np.zeros((MOST_NEW, 4), np.int64), np.zeros((MOST_NEW, 2), np.int64)
    new, joined = 0, 0
    if choice is not None:
        new, joined = len(choice.fresh), len(choice.extra)
        fresh[:new], extra[:joined] = choice.fresh, choice.extra
    kernels.code_kept(
        coding.coder, coding.data, pose, store.places, store.used, store.last, store.edges, now, kept,
        *coding.arrays, tables.ATAN,
    )  # fmt: skip
    members = np.zeros(NODES, np.int64)
    count = kernels.code_network(
        coding.coder, coding.data, pose, STEP_MM, store.places, store.used, store.last, store.edges, now, kept,
        fresh, new, keep_edge, extra, joined, members, *coding.arrays,
    )  # fmt: skip
    return _network(state, members[:count])


def _network(state: State, members: IntArray) -> ObjectNetwork:
    """The nodes in the robot's frame, and the edges among them."""
    store = state.store
    index = np.full(NODES, -1, np.int64)
    index[members] = np.arange(len(members))
    edges = store.edges[store.edges[:, 2] == 1, :2]
    robot_from_odom = state.odom_from_robot.inverse()
    nodes = robot_from_odom.apply_3d(store.places[members] * 1e-3).astype(np.float32)
    return ObjectNetwork(nodes, index[edges].reshape(-1, 2).astype(np.uint16))
