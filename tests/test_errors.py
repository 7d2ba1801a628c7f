"""What is said about files that cannot be read."""

from pathlib import Path

import pytest
import yaml

from vsx_ros.errors import reason_of


def test_the_system_s_reason_comes_without_its_number(tmp_path: Path) -> None:
    with pytest.raises(OSError) as caught:
        (tmp_path / "absent").read_text(encoding="utf-8")
    assert reason_of(caught.value) == "No such file or directory"


def test_yaml_tells_the_line() -> None:
    with pytest.raises(yaml.YAMLError) as caught:
        yaml.safe_load("a: 1\nb: 2: 3\n")
    assert reason_of(caught.value) == "line 2: mapping values are not allowed here"


def test_other_words_are_cut_to_one_line() -> None:
    assert reason_of(ValueError("first\nsecond")) == "first"
