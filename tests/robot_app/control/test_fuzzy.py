from dataclasses import replace
from pathlib import Path

import pytest

from robot_app.config import DEFAULT_PATH, load_config
from robot_app.control.fuzzy import FuzzySet, RuleTable, Variable
from robot_app.control.path_follower import PathFollowerConfig
from robot_app.control.path_rules import PathRulesConfig
from robot_app.control.wall_follower import WallFollowerConfig
from robot_app.control.wall_rules import WallRulesConfig
from shared.config import ConfigError

HEAT = Variable.partition("heat", cold=0.0, mild=10.0, hot=20.0)
WIND = Variable.partition("wind", calm=0.0, storm=10.0)
COAT = Variable.partition("coat", none=0.0, thin=1.0, thick=2.0)
TABLE = """
cold   thick thick
mild   thin  thick
hot    none  thin
"""


def test_a_trapezoid_rises_holds_and_falls() -> None:
    shape = FuzzySet("some", feet=(0.0, 10.0), shoulders=(2.0, 6.0))
    assert [shape.membership(v) for v in (-1, 0, 1, 2, 4, 6, 8, 10, 11)] == [0, 0, 0.5, 1, 1, 1, 0.5, 0, 0]


def test_a_trapezoid_with_crossed_corners_is_refused() -> None:
    with pytest.raises(ValueError, match="some"):
        FuzzySet("some", feet=(0.0, 1.0), shoulders=(2.0, 3.0))


def test_memberships_of_a_partition_add_up_to_one() -> None:
    for value in (-5.0, 0.0, 3.0, 10.0, 17.5, 99.0):
        assert sum(HEAT.memberships(value)) == pytest.approx(1.0)


def test_a_rule_that_fires_alone_gives_its_own_centre() -> None:
    table = RuleTable(HEAT, WIND, COAT, TABLE)
    assert table(0.0, 0.0) == 2.0
    assert table(10.0, 0.0) == 1.0
    assert table(20.0, 0.0) == 0.0


def test_between_rules_the_output_is_between_their_centres() -> None:
    table = RuleTable(HEAT, WIND, COAT, TABLE)
    assert table(15.0, 0.0) == pytest.approx(0.5)
    assert table(20.0, 5.0) == pytest.approx(0.5)


def test_a_table_that_does_not_fit_its_variables_is_refused() -> None:
    with pytest.raises(ValueError, match="heat"):
        RuleTable(HEAT, WIND, COAT, "cold none none")
    with pytest.raises(ValueError, match="wind"):
        RuleTable(HEAT, WIND, COAT, TABLE.replace("mild   thin  thick", "mild thin"))
    with pytest.raises(ValueError, match="coat has no set fur"):
        RuleTable(HEAT, WIND, COAT, TABLE.replace("none", "fur"))


@pytest.mark.parametrize(
    ("changes", "told"),
    [
        ({"angle_rad": (-0.8, 0.0, 0.8)}, "angle_rad needs 5 peaks"),
        ({"offset_m": (-0.25, 0.0, -0.08, 0.08, 0.25)}, "offset_m must rise"),
        ({"clearance_m": (0.08, 0.25, 0.55, 9.0)}, "clearance_m must lie from 0 to 2"),
        ({"speed_rules": "none slow slow slow"}, "speed_rules: the lines"),
        ({"away_rules": WallRulesConfig().away_rules.replace("half", "some")}, "away_rules: .* has no set some"),
    ],
)
def test_a_wrong_set_or_rule_is_refused_by_its_key(changes: dict[str, object], told: str) -> None:
    with pytest.raises(ValueError, match=told):
        replace(WallRulesConfig(), **changes)  # type: ignore[arg-type]


@pytest.mark.parametrize("config", [WallFollowerConfig, PathFollowerConfig])
def test_slow_medium_and_fast_are_what_the_paper_calls_so(
    config: type[WallFollowerConfig | PathFollowerConfig],
) -> None:
    speeds = config()
    assert speeds.slow_mps < 0.1 < speeds.medium_mps
    assert speeds.medium_mps == pytest.approx(0.2)
    assert speeds.medium_mps < speeds.fast_mps <= 0.46
    with pytest.raises(ValueError, match="medium_mps"):
        config(medium_mps=0.4)


def test_the_file_of_the_robot_names_the_key_that_is_wrong(tmp_path: Path) -> None:
    path = tmp_path / "robot.toml"
    path.write_text(DEFAULT_PATH.read_text("utf-8").replace("bend = [0.2, 0.6, 0.95]", "bend = [0.2, 0.6, 1.95]"))
    with pytest.raises(ConfigError, match=r"control\.path\.rules: bend must lie from 0 to 1"):
        load_config(path)


def test_the_file_of_the_robot_says_what_the_code_has() -> None:
    control = load_config(None).control
    for config, default in ((control.wall.rules, WallRulesConfig()), (control.path.rules, PathRulesConfig())):
        assert config.steering.rows == default.steering.rows
        assert config.steering(0.1, 0.02) == default.steering(0.1, 0.02)
        assert config.speed(0.5, 0.4) == default.speed(0.5, 0.4)
