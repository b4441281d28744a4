from __future__ import annotations

import json

import numpy as np
import pytest
from PIL import Image

from tools.evaluate import __main__ as evaluate
from tools.evaluate.depth.lateness import Metronome


@pytest.fixture
def boxes(tmp_path):
    """A depth image of many boxes before a wall."""
    depth = np.full((480, 640), 3000, np.uint16)
    for k, (row, column) in enumerate((r, c) for r in (30, 250) for c in (40, 240, 440)):
        depth[row : row + 180, column : column + 150] = 1500 + 150 * k
    path = tmp_path / "boxes.png"
    Image.fromarray(depth).save(path)
    return path


def run(monkeypatch, *words: str) -> int:
    monkeypatch.setattr("sys.argv", ["evaluate", *words])
    return evaluate.main()


def test_all_learners_are_compared_at_one_number_of_nodes(monkeypatch, capsys, boxes) -> None:
    assert run(monkeypatch, "learners", str(boxes), "--nodes", "80", "--runs", "2", "--json") == 0
    table = json.loads(capsys.readouterr().out)
    assert [row["file"] for row in table["files"]] == ["boxes.png"]
    rows = {row["learner"]: row for row in table["files"][0]["learners"]}
    assert set(rows) == {"standard GNG", "FastGNG", "simplified FastGNG", "simplified, with evidence"}
    assert rows["standard GNG"]["nodes"] == 80
    assert rows["standard GNG"]["steps"] >= 78 * 25
    assert rows["standard GNG"]["times_as_fast"] == 1.0
    assert 70 <= rows["simplified FastGNG"]["nodes"] <= 90
    assert all(row["node_error_mm"] < 60 and row["learn_ms"] > 0 for row in rows.values())


def test_frames_with_too_few_samples_are_named(monkeypatch, capsys, tmp_path) -> None:
    path = tmp_path / "wall.png"
    Image.fromarray(np.full((480, 640), 3000, np.uint16)).save(path)
    assert run(monkeypatch, "learners", str(path), "--nodes", "180") == 1
    assert "wall.png" in capsys.readouterr().err


def test_learners_without_a_frame_to_learn_from_ask_for_one(monkeypatch, capsys) -> None:
    assert run(monkeypatch, "learners") == 2
    assert capsys.readouterr().err == "evaluate learners: give depth images, --lab or both\n"


def test_a_bare_view_is_sampled_as_densely_as_the_nodes_need(monkeypatch, capsys, boxes) -> None:
    samples = []
    for nodes in ("20", "180"):
        assert run(monkeypatch, "learners", str(boxes), "--nodes", nodes, "--runs", "1", "--json") == 0
        samples.append(json.loads(capsys.readouterr().out)["files"][0]["samples"])
    assert samples[0] < 5 * 180 <= samples[1]


def test_a_file_that_is_no_depth_image_is_refused(monkeypatch, capsys, tmp_path) -> None:
    path = tmp_path / "text.png"
    path.write_text("no picture")
    assert run(monkeypatch, "learners", str(path)) == 2
    assert run(monkeypatch, "lateness", str(path)) == 2
    assert "text.png" in capsys.readouterr().err


def test_lateness_is_measured_with_and_without_the_extraction(monkeypatch, capsys, boxes) -> None:
    assert run(monkeypatch, "lateness", str(boxes), "--seconds", "0.4", "--rounds", "1", "--json") == 0
    report = json.loads(capsys.readouterr().out)
    assert report["extractions"] > 0
    assert report["longest_ms"] > 0
    assert {"ticks", "p50_ms", "p99_ms", "max_ms"} == set(report["alone"]) == set(report["beside"])


class Calls:
    """A clock that says what it is told; a call is due each 10 ms."""

    def __init__(self, times_s: list[float]) -> None:
        self._times_s = iter(times_s)
        self.due_s = 0.49

    def now_s(self) -> float:
        self.due_s += 0.01
        return next(self._times_s)


def test_lateness_is_told_against_the_deadlines() -> None:
    times_s = [0.5 + 0.01 * k + {30: 0.003, 40: 0.012}.get(k, 0.0002) for k in range(60)]
    metronome = Metronome(Calls(times_s), 100)
    for _ in times_s:
        metronome.tick()
    late_ms = metronome.late_ms()
    assert np.sort(late_ms)[-2:] == pytest.approx([3.0, 12.0])
    assert float(np.median(late_ms)) == pytest.approx(0.2)
