"""What docs/extraction.md shows: tables between marks, and how stability is measured."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from shared.messages import ObjectNetwork
from tools.evaluate.depth.stability import compare
from tools.evaluate.depth.tables import replace_between

DOCUMENT = Path(__file__).resolve().parents[4] / "docs" / "extraction.md"
NODES_M = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], np.float32)
RING = np.array([[0, 1], [1, 2], [2, 3], [0, 3]], np.uint16)


def test_a_table_replaces_what_stood_between_its_marks_and_nothing_else() -> None:
    text = "before\n<!-- a -->\nold\n<!-- end of a -->\nafter\n"
    assert replace_between(text, "a", ["| 1 |", "| 2 |"]) == (
        "before\n<!-- a -->\n| 1 |\n| 2 |\n<!-- end of a -->\nafter\n"
    )


@pytest.mark.parametrize(
    "text", ["", "<!-- a -->", "<!-- end of a --> <!-- a -->", "<!-- a --><!-- a --><!-- end of a -->"]
)
def test_a_document_without_the_marks_is_refused(text: str) -> None:
    with pytest.raises(ValueError, match="needs"):
        replace_between(text, "a", [])


def test_the_document_has_all_marks() -> None:
    text = DOCUMENT.read_text(encoding="utf-8")
    for name in ("table 2", "batches", "table 4", "variations", "drawing", "stability"):
        assert replace_between(text, name, []) != text


def test_the_same_network_is_kept_whatever_the_order_of_its_nodes() -> None:
    order = np.array([2, 0, 3, 1])
    shuffled = ObjectNetwork(NODES_M[order], np.argsort(order)[RING].astype(np.uint16))
    kept = compare(ObjectNetwork(NODES_M, RING), shuffled)
    assert (kept.nodes_within_3_cm, kept.median_step_mm, kept.connections_kept) == (1.0, 0.0, 1.0)


def test_a_lost_connection_and_a_node_that_moved_count() -> None:
    moved = NODES_M + np.array([[0.2, 0, 0], [0, 0, 0], [0, 0, 0], [0, 0, 0]], np.float32)
    kept = compare(ObjectNetwork(NODES_M, RING), ObjectNetwork(moved, RING[:3]))
    assert kept.nodes_within_3_cm == 0.75
    assert kept.connections_kept == 0.5


def test_nothing_is_kept_of_what_vanishes() -> None:
    assert compare(ObjectNetwork(NODES_M, RING), ObjectNetwork()).connections_kept == 0.0
    assert compare(ObjectNetwork(), ObjectNetwork()).connections_kept == 1.0
