"""Compiles the codec before the first observation is waiting for it."""

from __future__ import annotations

import numpy as np

from shared.geometry.se2 import Pose2
from shared.messages import ObjectNetwork, Observation
from shared.protocol.compact.decoder import Decoder
from shared.protocol.compact.encoder import Encoder
from shared.protocol.compact.state import CAR_BEAMS, CAR_SCANNER


def warm_up() -> None:
    """Both directions, with every kernel; the second time it takes some milliseconds."""
    encoder, decoder = Encoder(in_order=True), Decoder()
    ranges_m = np.linspace(0.5, 1.5, CAR_BEAMS).astype(np.float32)
    objects = ObjectNetwork(np.eye(3, dtype=np.float32), np.array([(0, 1), (1, 2)], np.uint16))
    for sequence in range(3):
        observation = Observation(
            sequence, 0.1 * sequence, Pose2(0.01 * sequence), 0.1, 0.0, CAR_SCANNER, ranges_m, objects, True
        )
        decoder.decode(encoder.encode(observation).datagram)
