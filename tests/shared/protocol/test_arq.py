from __future__ import annotations

import numpy as np
import pytest

from shared.protocol.arq import BEHIND, WINDOW, ReplayWindow, SegmentReceiver, SegmentSender


@pytest.mark.parametrize("loss", [0.0, 0.2, 0.6])
def test_everything_arrives_once_and_in_order_whatever_is_lost(loss: float) -> None:
    rng = np.random.default_rng(3)
    sender, receiver = SegmentSender(), SegmentReceiver()
    sent = [n.to_bytes(2, "little") for n in range(1_000)]
    waiting, came, now_s = list(sent), list[bytes](), 0.0
    while len(came) < len(sent):
        now_s += 1.0
        for _ in range(10):
            segment = sender.lost or (sender.add(waiting.pop(0)) if waiting and sender.has_room else None)
            if segment is None:
                break
            sender.sending(segment, 0)
            sender.left(segment.seq, segment.sendings, now_s)
            if rng.random() >= loss:
                came += receiver.take(segment.seq, segment.data)
        if rng.random() >= loss:
            sender.acknowledge(*receiver.acknowledgement())
            sender.settle(now_s)
        assert sender.unacknowledged <= WINDOW
    assert came == sent


def test_what_left_after_the_question_is_not_taken_for_lost() -> None:
    sender = SegmentSender()
    for left_s in (1.0, 2.0):
        segment = sender.add(b"x")
        sender.sending(segment, 0)
        sender.left(segment.seq, 1, left_s)
    assert [s.seq for s in sender.settle(1.5)] == [0]
    assert sender.settle(1.5) == []


def test_an_old_acknowledgement_changes_nothing() -> None:
    sender = SegmentSender()
    for _ in range(20):
        sender.sending(sender.add(b"x"), 0)
    sender.acknowledge(10, b"")
    assert sender.acknowledge(4, b"\xff") == []
    assert sender.base == 10
    assert sender.acknowledge(200, b"\xff") == []


def test_the_full_number_is_among_the_candidates() -> None:
    receiver = SegmentReceiver()
    for seq in range(300):
        receiver.take(seq, b"x")
    for seq in range(300 - BEHIND, 300 + WINDOW):
        found = list(receiver.candidates(seq & 31, 5))
        assert seq in found
        assert len(found) <= 6
    assert next(receiver.candidates(300 & 31, 5)) == 300


def test_a_segment_far_ahead_is_not_kept() -> None:
    receiver = SegmentReceiver()
    assert receiver.take(WINDOW, b"x") == []
    assert receiver.acknowledgement() == (0, b"")


def test_a_counter_is_new_once() -> None:
    window = ReplayWindow()
    for counter in (0, 3, 1, 40, 2):
        assert counter in list(window.candidates(counter & 31, 5))
        window.add(counter)
        assert counter not in list(window.candidates(counter & 31, 5))
