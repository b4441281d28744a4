from __future__ import annotations

import json
import sys

import pytest

from shared.link.radio_pair.config import PairConfig
from tools.evaluate import __main__ as evaluate
from tools.evaluate.link.air import SCENARIOS, measure
from tools.evaluate.link.cut import measure_cuts


@pytest.mark.parametrize("name", [name for name in SCENARIOS if name != "cut"])
def test_nothing_is_lost_doubled_or_out_of_order(name: str) -> None:
    figures = measure(name, 6.0, 1, 110, PairConfig())
    assert (figures.lost, figures.duplicated, figures.out_of_order) == (0, 0, 0)
    assert 0.0 < figures.goodput_bps < figures.carried_bps


def test_cuts_are_survived_and_counted() -> None:
    figures = measure_cuts(3, 1, 110, 932)
    assert (figures.lost, figures.duplicated, figures.out_of_order) == (0, 0, 0)
    assert figures.failover_ms_max < 500.0


def test_the_json_has_the_figures_of_one_scenario(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(
        sys, "argv", ["evaluate", "link", "--scenario", "paper", "--seconds", "5", "--size", "80", "--json"]
    )
    assert evaluate.main() == 0
    figures = json.loads(capsys.readouterr().out)
    assert figures["bytes_per_observation"] == 80
    assert figures["module_limit_bps"] == pytest.approx(9_040, rel=0.001)
    assert figures["possible_bps"] == pytest.approx(6_020, rel=0.001)
    assert 0 < figures["bytes_scan"] + figures["bytes_objects"] < figures["bytes_compact"] < 110
    assert figures["bytes_compact"] < figures["bytes_zstd"] < figures["bytes_struct"] < figures["bytes_cbor"]
    assert (figures["paper_lora_bytes"], figures["paper_wifi_bytes"]) == (471, 932)


@pytest.mark.parametrize(
    "words",
    [
        ("link", "--seconds", "0"),
        ("link", "--turn", "-1"),
        ("link", "--size", "2"),
        ("link", "--cuts", "0"),
        ("radio-mission", "--bandwidth", "123"),
    ],
)
def test_what_cannot_be_is_refused_in_one_line(
    words: tuple[str, ...], capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sys, "argv", ["evaluate", *words])
    with pytest.raises(SystemExit) as refused:
        evaluate.main()
    assert refused.value.code == 2
    told = capsys.readouterr().err
    assert told.count("\n") == 1
    assert words[1] in told
