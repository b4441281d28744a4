"""What both sides have learned of how scans and objects go."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from shared.protocol.compact import tables
from shared.protocol.compact.mixing import _kernels as mixing

REGIONS = 33
SETS = 320
INPUTS = 24
REFINES = 160
_REGION_SLOTS = 4096
_FIRST_WEIGHT = 32_768  # 0.5
WEIGHT_SHIFT = 6  # of the weights in the file that comes along
_TRAINED = Path(__file__).with_name("trained.npz")

TABLES = np.concatenate((tables.STRETCH, tables.SQUASH, tables.RATES))
TABLES.setflags(write=False)


@dataclass(slots=True, eq=False)
class Model:
    """The arrays of `mixing`: they change with each bit that is coded."""

    slots: NDArray[np.uint32]
    weights: NDArray[np.int32]
    refined: NDArray[np.uint16]

    def copy(self) -> Model:
        return Model(self.slots.copy(), self.weights.copy(), self.refined.copy())

    @staticmethod
    def untrained() -> Model:
        curve = tables.SQUASH[np.minimum(128 * np.arange(33), 4095)]
        return Model(
            np.full(REGIONS * _REGION_SLOTS, 1 << 31, np.uint32),
            np.full((SETS, INPUTS), _FIRST_WEIGHT, np.int32),
            np.tile(curve, (REFINES, 1)).astype(np.uint16),
        )

    @staticmethod
    def trained() -> Model:
        """What comes along, learned from recorded missions; both sides must have the same."""
        return _trained().copy()


@cache
def _trained() -> Model:
    model = Model.untrained()
    with np.load(_TRAINED, allow_pickle=False) as stored:
        at = np.cumsum(stored["steps"].astype(np.int64))
        model.slots[at] = stored["probabilities"].astype(np.uint32) << 20 | 1 << 19 | stored["counts"]
        model.weights[:] = stored["weights"].astype(np.int32) << WEIGHT_SHIFT
        model.refined[:] = stored["refined"]
    return model


class Coding:
    """Writes the values of one observation, or reads them; where it reads, the values given do not matter."""

    def __init__(self, model: Model, data: NDArray[np.uint8], end: int, reading: bool) -> None:
        self.model, self.data, self.reading = model, data, reading
        self.coder = np.zeros(mixing.CODER_SIZE, np.int64)
        mixing.start(self.coder, data, 0, end, reading)

    @property
    def arrays(self) -> tuple[NDArray[np.uint32], NDArray[np.int32], NDArray[np.uint16], NDArray[np.int64]]:
        return self.model.slots, self.model.weights, self.model.refined, TABLES

    @property
    def bytes_so_far(self) -> int:
        return int(self.coder[3])

    def number(self, value: int, kind: int, bits: int, a: int = 0, b: int = 0) -> int:
        """A number of either sign, cheap near zero; learned by its kind and what it depends on."""
        return int(mixing.number(self.coder, self.data, value, kind, a, b, bits, *self.arrays))

    def raw(self, value: int, bits: int) -> int:
        """A number of `bits` bits, none more likely than another."""
        got = 0
        for shift in range(bits - 1, -1, -1):
            got = 2 * got + int(mixing.code(self.coder, self.data, value >> shift & 1, 32_768))
        return got

    def has_ended(self) -> bool:
        """Whether nothing is left to read, and the end is as it is written."""
        return bool(mixing.ends_as_written(self.coder, self.data, 0))

    def finish(self) -> bytes:
        """Everything written."""
        return self.data[: mixing.finish(self.coder, self.data, 0)].tobytes()
