"""docs/reference.md is what the code says."""

from pathlib import Path

from vsx_ros.ros.reference import reference

PAGE = Path(__file__).resolve().parents[2] / "docs/reference.md"


def test_the_reference_is_that_of_the_code():
    written = PAGE.read_text(encoding="utf-8")
    assert written == reference(), "write it anew: python -m vsx_ros.ros.reference > docs/reference.md"


def test_it_holds_what_users_look_for():
    text = reference()
    for words in ("### vsx calibrate camera", "| `--board CxRxM` |", "| vslam | `map` | nav_msgs/OccupancyGrid |"):
        assert words in text
    assert "%(" not in text
