from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tools.codec_states import encode_to, read
from tools.fuzz.room_drive import drive


def test_what_is_read_has_the_states_that_were_written(tmp_path: Path, rng: np.random.Generator) -> None:
    file, again = tmp_path / "room.datagrams", tmp_path / "again" / "room.datagrams"
    again.parent.mkdir()
    written = encode_to(drive(12, rng), file)
    observations, said = read(file)
    assert said == written
    assert len(observations) == 12
    assert encode_to(observations, again) == read(again)[1]


def test_a_changed_byte_is_noticed(tmp_path: Path, rng: np.random.Generator) -> None:
    file = tmp_path / "room.datagrams"
    encode_to(drive(6, rng), file)
    data = bytearray(file.read_bytes())
    data[-3] ^= 1
    file.write_bytes(bytes(data))
    with pytest.raises(ValueError, match="refused"):
        read(file)
