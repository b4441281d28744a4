"""Which piece of the map each node belongs to: pieces hang on one another by nothing that is worth much."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


class Pieces:
    """The map itself is piece 0; others begin where a robot was lost, until a closure joins them."""

    def __init__(self) -> None:
        self._of_node: list[int] = []
        self._current = 0

    def load(self, of_node: NDArray[np.int32]) -> None:
        """(N,), for nodes that are there already."""
        self._of_node = of_node.tolist()

    @property
    def apart(self) -> bool:
        """The newest node's piece is not the map."""
        return self._current != 0

    @property
    def of_node(self) -> NDArray[np.int32]:
        """(N,)"""
        return np.array(self._of_node, np.int32)

    @property
    def in_current(self) -> NDArray[np.bool_]:
        """(N,): nodes of the newest node's piece."""
        return np.asarray(self.of_node == self._current)

    def add_node(self) -> None:
        self._of_node.append(self._current)

    def begin(self) -> None:
        """Nodes that come now are of a new piece."""
        self._current = max(self._of_node, default=-1) + 1

    def go_to(self, node: int) -> None:
        """Nodes that come now are of this one's piece."""
        self._current = self._of_node[node]

    def join(self, a: int, b: int) -> None:
        """The pieces of both nodes become one, that of the older."""
        kept, given_up = sorted((self._of_node[a], self._of_node[b]))
        if kept == given_up:
            return
        self._of_node = [kept if piece == given_up else piece for piece in self._of_node]
        if self._current == given_up:
            self._current = kept
