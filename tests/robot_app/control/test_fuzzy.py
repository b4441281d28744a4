import pytest

from robot_app.control.fuzzy import FuzzySet, RuleTable, Variable

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
