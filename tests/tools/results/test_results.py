from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from tools.results.code_state import mapping_code, measured_at
from tools.results.one_log import shrink
from tools.results.tables import BEGIN, CARMEN_LOGS, END, URG_LOGS, render, with_section
from tools.results.targets import TARGETS, rows

SLAM: dict[str, Any] = {
    "scans": 13631, "relations": 2984, "translation_mean_m": 0.0135, "translation_std_m": 0.0095,
    "rotation_mean_deg": 0.216, "rotation_std_deg": 0.207, "seconds": 5.7, "realtime_factor": 469.2,
    "step_ms_p50": 0.23, "step_ms_p99": 3.2, "step_ms_p99_first_1000": 1.0, "step_ms_p99_last_1000": 2.0,
    "peak_rss_mb": 294.0, "loop_closures": 557,
}  # fmt: skip
URG: dict[str, Any] = {
    "walls": 18, "wall_length_m": 40.9, "wall_thickness_m": 0.0278, "wall_scanner_m": 0.0178, "wall_p95_m": 0.0619,
    "double_walls": 2, "double_length_m": 3.0, "scanner_noise_m": 0.0055,
    "wall_bend_m": 0.01, "wall_bend_worst_m": 0.04,
}  # fmt: skip
BACK = {"revisit_median_m": 0.0037, "revisit_p95_m": 0.044, "revisit_offset_m": 0.028, "revisit_offset_deg": -0.66}
LAB_FIGURES = {
    "pose_rmse_m": 0.0034, "map_rmse_m": 0.0062, "map_completeness": 0.94, "collisions": 0, "goal_error_m": 0.02,
    "encoder_slip_mean_abs": 0.11,
}  # fmt: skip


CPU = {
    "cpu_seconds": 3.0, "cpu_realtime_factor": 900.0,
    "step_ms_max": 30.0, "step_cpu_ms_p50": 0.2, "step_cpu_ms_p99": 1.5,
    "step_cpu_ms_max": 9.0, "step_cpu_ms_p99_first_1000": 1.0, "step_cpu_ms_p99_last_1000": 1.2, "unlocated": 4,
}  # fmt: skip
KIDNAP: dict[str, Any] = {
    "trials": 100, "found": 96, "wrong": 1, "lost": 3, "seconds_to_find_p50": 2.0, "seconds_to_find_p95": 9.5,
    "error_m_p95": 0.004, "error_deg_p95": 0.1, "elsewhere": 40, "elsewhere_lost": 40, "elsewhere_wrong": 0,
}  # fmt: skip


CONTINUED: dict[str, Any] = {
    "scans": 2467, "keyframes_given": 1957, "found_after": 288, "unlocated": 290, "relations": 1431,
    "translation_mean_m": 0.0306, "translation_std_m": 0.0228, "rotation_mean_deg": 0.462, "rotation_std_deg": 0.615,
    "map_bytes": 2687314,
}  # fmt: skip


def _row(text: str, *begin: str) -> list[str]:
    """The first row of all tables that begins with these cells; the cells after them."""
    start = "| " + " | ".join(begin) + " |"
    row = next(line for line in text.splitlines() if line.startswith(start))
    return [cell.strip() for cell in row.removeprefix(start).strip(" |").split(" | ")]


def test_what_was_measured_stands_beside_what_was_published() -> None:
    text = render({"intel": {"graph": SLAM}})
    (row,) = [line for line in text.splitlines() if line.startswith("| Intel | 0.0135")]
    assert "0.0135 ± 0.0095 m, 0.216 ± 0.207°" in row
    assert "0.0229 ± 0.0239 m" in row
    told = _row(text, "Intel", "graph")
    assert told == [
        "5.7", "?", "469", "?", "0.23 / 3.2 / ?", "? / ? / ?", "1.0 / 2.0", "? / ?", "294 MB", "557", "?",
    ]  # fmt: skip
    told = _row(render({"intel": {"graph": SLAM | CPU}}), "Intel", "graph")
    assert told == [
        "5.7", "3.0", "469", "900", "0.23 / 3.2 / 30", "0.20 / 1.5 / 9", "1.0 / 2.0", "1.0 / 1.2", "294 MB", "557", "4",
    ]  # fmt: skip
    assert "images/intel-graph.png" in text
    assert "images/intel-particle.png" not in text


def test_the_particle_filter_says_how_often_it_resampled() -> None:
    figures = SLAM | CPU | {"resamplings": 31, "effective_share": 0.634}
    assert _row(render({"intel": {"particle": figures}}), "Intel", "particle")[-1] == "31 times, 63 % of the particles"


def test_a_continued_session_says_after_how_many_scans_the_robot_was_found() -> None:
    text = render({"continued": {"graph": {"fr079": CONTINUED}}})
    assert "| FR079 | graph | 0.0306 ± 0.0228 m, 0.462 ± 0.615° | 1431 | 288 scans | 290, 2467 | 2.7 MB |" in text
    assert "| FR079 | particle | not measured |" in text


def test_every_row_of_a_table_has_as_many_columns_as_its_head() -> None:
    lab = {"seeds": [1, 2], "finished": True, "mean": LAB_FIGURES, "worst": LAB_FIGURES}
    text = render(
        {
            "intel": {"graph": SLAM, "particle": SLAM | CPU}, "exp1": {"graph": URG | BACK}, "lab": {"graph": lab},
            "kidnap": {"graph": {"put_down": KIDNAP, "carried": KIDNAP}}, "continued": {"graph": {"fr079": CONTINUED}},
            "repeat": {"graph": {"different_runs": 0}},
        }
    )  # fmt: skip
    for table in text.split("\n\n"):
        rows = [line.count("|") for line in table.splitlines() if line.startswith("|")]
        assert len(set(rows)) <= 1, table
    assert "2, all finished" in text


def test_a_map_that_is_off_by_more_than_can_be_compared_says_so() -> None:
    far = URG | BACK | {"revisit_median_m": None, "revisit_p95_m": None, "revisit_offset_m": 0.49}
    text = render({"exp2": {"graph": far, "particle": URG}})
    assert "over 300 / over 300 | 490, -0.66°" in text
    assert "saw too little" in text
    nowhere = render({"exp2": {"graph": far | {"revisit_offset_m": None, "revisit_offset_deg": None}}})
    assert "nothing aligns it" in nowhere
    assert _row(nowhere, "exp2: revisit, offset", "graph")[1:] == ["cannot be told", "**no**"]


def test_every_target_is_told_with_whether_it_is_met() -> None:
    lab = {"seeds": [1], "finished": True, "mean": LAB_FIGURES, "worst": LAB_FIGURES | {"pose_rmse_m": 0.0101}}
    text = render(
        {
            "intel": {"graph": SLAM | CPU}, "lab": {"graph": lab}, "kidnap": {"graph": {"put_down": KIDNAP}},
            "exp1": {"graph": URG | BACK}, "fr079": {"graph": SLAM | CPU | {"realtime_factor": 9.0}},
        }
    )  # fmt: skip
    assert _row(text, "Intel: relations, shift", "graph") == ["≤ 0.0203 m", "0.0135 m", "yes"]
    assert _row(text, "Intel: relations, shift", "particle") == ["≤ 0.0250 m", "not measured"]
    assert _row(text, "exp1: walls that are there twice", "graph") == ["≤ 0.0 m", "3.0 m", "**no**"]
    assert _row(text, "lab with slip, worst of the seeds: `pose_rmse_m`", "graph")[2] == "**no**"
    assert _row(text, "kidnapped, put down: found", "graph") == ["≥ 95 %", "96 %", "yes"]
    assert _row(text, "kidnapped, put down: claimed wrongly", "graph") == ["≤ 0", "1", "**no**"]
    assert len({row[:2] for row in rows({})}) == len(TARGETS)
    assert {row[3] for row in rows({})} == {"not measured"}


def test_a_figure_of_time_says_whether_a_loaded_machine_is_to_blame() -> None:
    slow = SLAM | CPU | {"realtime_factor": 120.0}
    assert _row(render({"intel": {"graph": slow}}), "Intel: × real time", "graph") == [
        "≥ 250", "120, by CPU time 900", "**no**, by CPU time yes",
    ]  # fmt: skip


def test_a_figure_names_the_state_of_the_mapping_that_it_was_measured_with(tmp_path: Path) -> None:
    at = {"commit": "abc1234", "code": "0123456789ab", "load": 0.4}
    text = render({"exp1": {"graph": URG | {"measured_at": at}}})
    assert _row(text, "abc1234", "0123456789ab") == ["exp1", "graph", "0.4"]
    for name in ("build.py", "config.py", "station.toml", "mapping/a.py"):
        (tmp_path / "station_gui" / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / "station_gui" / name).write_text("1")
    before = mapping_code(tmp_path)
    assert mapping_code(tmp_path) == before
    (tmp_path / "station_gui" / "mapping" / "a.py").write_text("2")
    assert mapping_code(tmp_path) != before
    assert measured_at()["code"] == mapping_code()


def test_only_what_stands_between_the_marks_is_replaced() -> None:
    text = f"# Results\n{BEGIN}\nold\n{END}\nmore\n"
    once = with_section(text, "new\n")
    assert once.startswith("# Results\n")
    assert once.endswith(f"{END}\nmore\n")
    assert "old" not in once
    assert with_section(once, "new\n") == once
    with pytest.raises(ValueError, match="needs one"):
        with_section("no marks", "new")


def test_the_docs_are_what_the_tool_writes() -> None:
    docs = Path(__file__).resolve().parents[3] / "docs"
    text = (docs / "results.md").read_text("utf-8")
    figures = json.loads((docs / "slam2d.json").read_text("utf-8"))
    assert with_section(text, render(figures)) == text
    for log, methods in figures.items():
        for method in methods if log in {**CARMEN_LOGS, **URG_LOGS} else ():
            assert 5_000 < (docs / "images" / f"{log}-{method}.png").stat().st_size <= 150_000


def test_a_picture_becomes_small(tmp_path: Path) -> None:
    path = tmp_path / "map.png"
    rng = np.random.default_rng(1)
    noise = rng.integers(0, 255, (600, 1656, 3)).astype(np.uint8)
    noise[:500] = 255
    Image.fromarray(noise).save(path)
    shrink(path)
    with Image.open(path) as picture:
        assert max(picture.size) == 1000
        assert picture.size[1] == round(600 * 1000 / 1656)
    assert path.stat().st_size <= 150_000
