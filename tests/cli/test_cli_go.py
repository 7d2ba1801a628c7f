"""The place of ``vsx go``."""

import argparse
import math

import pytest

from vsx_ros.cli.main import parse
from vsx_ros.cli.option_values import place
from vsx_ros.geometry.se2 import SE2


@pytest.mark.parametrize(
    ("text", "meant"),
    [("1.5,-2", (1.5, -2.0, None)), ("-1,2,90", (-1.0, 2.0, math.pi / 2)), ("0,0,0", (0.0, 0.0, 0.0))],
)
def test_a_place_may_have_a_heading_and_begin_with_a_minus_sign(text: str, meant: tuple[float, ...]) -> None:
    assert parse(["go", text]).place == pytest.approx(meant)


@pytest.mark.parametrize("text", ["", "1", "1,2,3,4", "kitchen", "nan,0", "1,inf"])
def test_what_is_no_place_is_refused(text: str) -> None:
    with pytest.raises(argparse.ArgumentTypeError, match=r"X,Y or X,Y,DEG"):
        place(text)


def test_without_a_heading_it_looks_the_way_it_came() -> None:
    pytest.importorskip("rospy")
    from vsx_ros.ros.go import goal_pose

    assert goal_pose(1.0, 3.0, None, SE2(1.0, 1.0, 2.0)).theta == pytest.approx(math.pi / 2)
    assert goal_pose(1.0, 3.0, -1.0, SE2(1.0, 1.0, 2.0)).theta == -1.0
