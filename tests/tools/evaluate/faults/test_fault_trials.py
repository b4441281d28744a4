from __future__ import annotations

import math
from argparse import Namespace

import numpy as np
import pytest

from tools.evaluate.faults.cases import cases
from tools.evaluate.faults.command import run
from tools.evaluate.faults.trial import try_case


def test_each_fault_has_a_name_of_its_own_and_every_device_is_taken_away_for_a_while_and_for_ever(
    rng: np.random.Generator,
) -> None:
    names = [case.name for case in cases(rng)]
    assert len(set(names)) == len(names)
    for device in ("scanner", "camera", "imu", "power", "encoders", "drive", "thermometer"):
        assert {f"{device}-unplugged", f"{device}-unplugged-3s"} <= set(names)


def test_the_list_has_the_words_of_the_table_beside_each_name(capsys: pytest.CaptureFixture[str]) -> None:
    run(Namespace(list=True, seed=1))
    listed = dict(line.split(maxsplit=1) for line in capsys.readouterr().out.splitlines())
    assert listed["encoder-stuck"] == "one encoder stuck"
    assert listed["killed"] == "app killed with SIGKILL"


@pytest.mark.parametrize("name", ["scanner-unplugged", "encoders-stuck"])
def test_what_is_lost_for_ever_stops_the_robot_in_time(rng: np.random.Generator, name: str) -> None:
    outcome = try_case(next(case for case in cases(rng) if case.name == name), 1)
    assert outcome.failure == ""  # it stood in time
    assert outcome.driven_s < outcome.moved_s
    assert outcome.after in {"waits", "halted"}
    assert outcome.seen.startswith("Stopped")
    assert math.isfinite(outcome.way_m)
