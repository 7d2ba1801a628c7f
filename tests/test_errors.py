"""What is said about files that cannot be read."""

import errno
import os
import re
from pathlib import Path

import pytest
import yaml

from vsx_ros.errors import CalibrationError, InputError, MapFileError, disk_trouble, explained, reason_of


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


def test_what_goes_wrong_with_a_file_is_told_with_reason_and_remedy(tmp_path: Path) -> None:
    with (
        pytest.raises(InputError, match=r"^list cannot be read \(No such file or directory\); give one$"),
        explained(InputError, "list cannot be read", "give one"),
    ):
        (tmp_path / "absent").read_text(encoding="utf-8")
    with pytest.raises(MapFileError), explained(InputError, "list cannot be read", "give one"):
        raise MapFileError("ours says more already")
    with pytest.raises(ZeroDivisionError), explained(CalibrationError, "x", "y"):
        raise ZeroDivisionError
    with pytest.raises(ValueError, match="^a mistake of ours$"), explained(InputError, "x", "y", OSError):
        raise ValueError("a mistake of ours")


@pytest.mark.parametrize(
    ("number", "said"),
    [(errno.ENOSPC, "/d/f .*No space left.*df -h"), (errno.EACCES, "/d/f .*Permission denied.*your own")],
)
def test_a_full_or_foreign_disk_is_named_with_its_remedy(number: int, said: str) -> None:
    assert re.search(said, disk_trouble(OSError(number, os.strerror(number), "/d/f")))


def test_other_errors_of_the_system_are_no_trouble_of_the_disk() -> None:
    assert disk_trouble(OSError(errno.ENOENT, os.strerror(errno.ENOENT), "/d/f")) == ""
    assert disk_trouble(OSError("no number at all")) == ""


def test_a_message_that_quotes_megabytes_is_cut_in_its_middle() -> None:
    said = str(InputError("bag x: " + "9" * 100_000 + "; copy it again"))
    assert said.startswith("bag x: 9")
    assert said.endswith("9; copy it again")
    assert len(said) < 1300
