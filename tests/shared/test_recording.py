from __future__ import annotations

import os
from pathlib import Path

import pytest

from shared.messages import Ack
from shared.protocol.codec import encode
from shared.recording import MissionReader, Recorder, RecordingError
from tests.shared import samples

DATAGRAMS = [encode(samples.telemetry(stamp_s=i / 5, late_ticks=i * 7919)) for i in range(400)]


def record(path: Path) -> Recorder:
    recorder = Recorder(path, {"address": "robot:47001"}, wall_ns=1_700_000_000_000_000_000)
    for i, datagram in enumerate(DATAGRAMS):
        recorder.write(datagram, i / 5)
    return recorder


def test_a_recording_gives_back_what_was_written_with_its_times(tmp_path: Path) -> None:
    record(tmp_path / "m.mcap").close()
    reader = MissionReader(tmp_path / "m.mcap")
    recorded = list(reader)
    assert [r.datagram for r in recorded] == DATAGRAMS
    assert recorded[100].time_s == pytest.approx(20.0)
    assert reader.head["address"] == "robot:47001"
    assert reader.truncated is None


def test_a_recording_that_was_never_closed_loses_only_its_last_moments(tmp_path: Path) -> None:
    recorder = record(tmp_path / "m.mcap")
    killed = tmp_path / "killed.mcap"
    killed.write_bytes((tmp_path / "m.mcap").read_bytes())
    recorder.close()
    reader = MissionReader(killed)
    recorded = [r.datagram for r in reader]
    assert len(recorded) > 250
    assert recorded == DATAGRAMS[: len(recorded)]
    assert reader.truncated is not None
    assert "killed.mcap" in reader.truncated


def test_a_recording_cut_anywhere_is_read_up_to_the_cut(tmp_path: Path) -> None:
    record(tmp_path / "m.mcap").close()
    whole = (tmp_path / "m.mcap").read_bytes()
    for cut in range(600, len(whole) - 10, len(whole) // 25):
        (tmp_path / "cut.mcap").write_bytes(whole[:cut])
        reader = MissionReader(tmp_path / "cut.mcap")
        recorded = [r.datagram for r in reader]
        assert recorded == DATAGRAMS[: len(recorded)]
        assert reader.truncated is not None


def test_a_file_that_is_no_recording_is_refused_by_name(tmp_path: Path) -> None:
    (tmp_path / "x.mcap").write_bytes(b"not a recording at all")
    with pytest.raises(RecordingError, match=r"x\.mcap"):
        MissionReader(tmp_path / "x.mcap")
    with pytest.raises(RecordingError, match=r"absent\.mcap: cannot be read"):
        MissionReader(tmp_path / "absent.mcap")


def test_a_recording_is_never_written_over(tmp_path: Path) -> None:
    record(tmp_path / "m.mcap").close()
    second = record(tmp_path / "m.mcap")
    second.close()
    assert second.path == tmp_path / "m-2.mcap"
    assert len(list(MissionReader(tmp_path / "m.mcap"))) == len(list(MissionReader(second.path))) == len(DATAGRAMS)


def test_a_full_disk_ends_the_recording_and_not_the_mission(tmp_path: Path) -> None:
    recorder = Recorder(tmp_path / "full.mcap", {}, 0)
    full = Path("/dev/full").open("wb")  # noqa: SIM115 - the recorder closes it
    assert recorder._file is not None
    recorder._file.close()
    recorder._file = full
    recorder._writer._Writer__stream = full
    for i in range(2000):
        recorder.write(encode(Ack(i, True, os.urandom(100).hex())), i / 10)
    assert recorder.error is not None
    assert "full.mcap" in recorder.error
    recorder.close()


def test_a_folder_that_cannot_be_made_is_named(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(RecordingError, match=r"file/m\.mcap: cannot be written"):
        Recorder(tmp_path / "file" / "m.mcap", {}, 0)
