from robot_app.control.arbiter import Choice, Source, choose
from robot_app.control.motion import STAND_STILL, Motion

SLOW, FAST, BACK = Motion(0.1, 0.0), Motion(0.4, 0.1), Motion(-0.1, 0.2)


def test_a_halt_wins_over_everything() -> None:
    assert choose(True, SLOW, FAST, BACK) == Choice(Source.HALT, STAND_STILL)


def test_the_operators_hand_wins_over_path_and_wall() -> None:
    assert choose(False, SLOW, FAST, BACK) == Choice(Source.MANUAL, SLOW)


def test_the_path_wins_over_the_wall() -> None:
    assert choose(False, None, FAST, BACK) == Choice(Source.PATH, FAST)


def test_the_wall_follower_has_the_car_when_nobody_else_asks() -> None:
    assert choose(False, None, None, BACK) == Choice(Source.WALL, BACK)


def test_the_car_stands_when_nobody_asks() -> None:
    assert choose(False, None, None, None) == Choice(Source.NOBODY, STAND_STILL)
