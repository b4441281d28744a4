from __future__ import annotations

import numpy as np

from station_gui.mapping.slam2d.pieces import Pieces


def _three() -> Pieces:
    """Two nodes of the map, two of a piece, one of another."""
    pieces = Pieces()
    for begins in (False, False, True, False, True):
        if begins:
            pieces.begin()
        pieces.add_node()
    return pieces


def test_a_map_is_one_piece_until_another_begins() -> None:
    pieces = Pieces()
    pieces.add_node()
    assert not pieces.apart
    assert _three().apart
    assert _three().of_node.tolist() == [0, 0, 1, 1, 2]
    assert _three().in_current.tolist() == [False, False, False, False, True]


def test_pieces_that_are_joined_are_the_older_one() -> None:
    pieces = _three()
    pieces.join(4, 2)
    assert pieces.of_node.tolist() == [0, 0, 1, 1, 1]
    assert pieces.in_current.tolist() == [False, False, True, True, True]
    pieces.join(0, 3)
    assert not pieces.of_node.any()
    assert not pieces.apart
    pieces.join(0, 1)
    assert not pieces.of_node.any()


def test_the_robot_goes_on_in_the_piece_where_it_was_found() -> None:
    pieces = Pieces()
    pieces.load(np.array([0, 0, 1], np.int32))
    pieces.go_to(2)
    pieces.add_node()
    pieces.go_to(0)
    pieces.add_node()
    assert not pieces.apart
    assert pieces.of_node.tolist() == [0, 0, 1, 1, 0]
    pieces.begin()
    pieces.add_node()
    assert pieces.of_node[-1] == 2
