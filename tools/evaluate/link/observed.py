"""What the observations of the lab cost, beside a channel's figures, and what other packings take of the same."""

from __future__ import annotations

import numpy as np

from tools.evaluate.link import codec
from tools.evaluate.link.packings import PAPER_LORA_BYTES, PAPER_WIFI_BYTES

_LONGEST_S = 30.0  # of the mission: a look round and the beginning of the drive
_SHORTEST_S = 5.0  # with less nothing may have been observed
_PACKINGS = ("struct", "zlib", "zstd", "cbor", "full", "ascii")


def lab_bytes(seconds: float, seed: int) -> dict[str, object]:
    """Mean bytes of an observation of the lab's mission in lock-step, over a link in order.

    `bytes_compact` is the whole datagram, `bytes_scan` and `bytes_objects` are parts of it; the paper's are one
    refresh each.
    """
    observations = codec.lab_mission(seed, ends_s=min(max(seconds, _SHORTEST_S), _LONGEST_S))
    channel = codec.Channel(loss=0.0, delay=0, budget=None)
    report = codec.figures(codec.measure(observations, channel, np.random.default_rng(seed)))
    found: dict[str, object] = {
        "lab_observations": report["observations"],
        "bytes_compact": report["bytes_per_observation"],
        "bytes_scan": report["bytes_scan"],
        "bytes_objects": report["bytes_objects"],
    }
    found |= {f"bytes_{name}": report[f"bytes_{name}"] for name in _PACKINGS}
    return found | {"paper_lora_bytes": PAPER_LORA_BYTES, "paper_wifi_bytes": PAPER_WIFI_BYTES}
