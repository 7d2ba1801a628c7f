"""docs/reference.md has the commands, options, topics and services of the code."""

from pathlib import Path

from vsx_ros.ros.reference import reference

PAGE = Path(__file__).resolve().parents[2] / "docs/reference.md"


def names(text: str) -> list[str]:
    """Headings, and of tables all cells in backticks; wording may lag behind until 'make docs'."""
    lines = [line for line in text.splitlines() if line.startswith(("#", "| "))]
    return [line if line.startswith("#") else line.split("` |")[0] for line in lines]


def test_the_reference_is_that_of_the_code():
    written = PAGE.read_text(encoding="utf-8")
    assert names(written) == names(reference()), "write it anew: make docs"


def test_it_holds_what_users_look_for():
    text = reference()
    for words in ("### vsx calibrate camera", "| `--board CxRxM` |", "| vslam | `map` | nav_msgs/OccupancyGrid |"):
        assert words in text
    assert "%(" not in text
