"""`python -m tools.train_codec OUT LOG...`: what profile COMPACT knows of scans and objects before the first one.

Both sides must have the same table: a new one is a new version of the protocol.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

from shared.command_line import EXIT_MISUSE, EXIT_OK
from shared.protocol.compact.encoder import Encoder
from shared.protocol.compact.model import WEIGHT_SHIFT, Model
from shared.protocol.compact.state import State
from tools.evaluate.link.codec import observations_of

_ROUNDS = 2
_MOST_COUNT = 24  # a counter that comes along is as sure as one that has seen so many
_FEWEST_COUNT = 2  # what was seen less often is left out


def main(arguments: list[str]) -> int:
    if len(arguments) < 2:
        print(__doc__)
        return EXIT_MISUSE
    out, *logs = map(Path, arguments)
    model = Model.untrained()
    for _ in range(_ROUNDS):
        for log in logs:
            model = _after(log, model)
    save(model, out)
    print(f"{out}: {out.stat().st_size} bytes")
    return EXIT_OK


def _after(log: Path, model: Model) -> Model:
    _, observations = observations_of(log)
    encoder = Encoder(in_order=True, initial=lambda: State(model.copy()))
    for observation in observations:
        encoder.encode(observation)
    newest = encoder.newest
    return newest.model if newest is not None else model


def save(model: Model, out: Path) -> None:
    """Only the slots that were used often enough, in fewer digits, and less sure than they are."""
    count = model.slots & 1023
    at = np.flatnonzero(count >= _FEWEST_COUNT)
    np.savez_compressed(
        out,
        steps=np.diff(at, prepend=0).astype(np.uint16),
        probabilities=(model.slots[at] >> 20).astype(np.uint16),
        counts=np.minimum(count[at], _MOST_COUNT).astype(np.uint8),
        weights=np.clip(model.weights >> WEIGHT_SHIFT, -32_768, 32_767).astype(np.int16),
        refined=model.refined,
    )


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
