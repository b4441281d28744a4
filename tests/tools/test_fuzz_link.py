from __future__ import annotations

import numpy as np

from tools.fuzz_link import fuzz_conversation, fuzz_failover, fuzz_parsers


def test_no_forged_packet_is_accepted_and_the_conversation_goes_on() -> None:
    result = fuzz_conversation(np.random.default_rng(1), 200_000)
    assert result.forged_packets > 4_000
    assert result.accepted_forgeries == result.wrongly_delivered == 0
    assert result.delivered > 100


def test_bodies_of_any_bytes_are_parsed_or_dropped() -> None:
    assert fuzz_parsers(np.random.default_rng(2), 100_000) >= 100_000


def test_frames_of_any_bytes_do_not_disturb_a_failover() -> None:
    assert fuzz_failover(np.random.default_rng(3), 50_000) >= 50_000
