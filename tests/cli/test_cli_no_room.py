"""A run that has no place for its folder ends at once, in one sentence, whatever is the reason."""

import shutil
import subprocess
from collections.abc import Iterator
from pathlib import Path

import pytest

from vsx_ros.cli.main import execute

KINDS = (["explore", "--fast"], ["explore", "--world", "lab", "--headless"], ["replay", "RECORDING"])
SMALL_KB = 256


@pytest.fixture(params=KINDS, ids=["lock-step", "live", "replay"])
def begin(request: pytest.FixtureRequest, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """The command without --out; it may not even compile."""
    monkeypatch.setattr(f"vsx_ros.cli.{request.param[0]}.compile_kernels", lambda *_: pytest.fail("it compiles first"))
    return [word.replace("RECORDING", str(tmp_path / "absent.bag")) for word in request.param]


@pytest.fixture
def mounted(tmp_path: Path) -> Iterator[Path]:
    """A small disk."""
    place = tmp_path / "disk"
    place.mkdir()
    command = ["mount", "-t", "tmpfs", "-o", f"size={SMALL_KB}k", "tmpfs", str(place)]
    if shutil.which("mount") is None or subprocess.run(command, capture_output=True, check=False).returncode:
        pytest.skip("mounting a small disk is not permitted; the tests with other places say the same")
    yield place
    subprocess.run(["umount", "-l", str(place)], check=True)


def is_refused(words: list[str], why: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert execute(words) == 1
    said = capsys.readouterr()
    assert said.out == ""
    assert said.err.startswith("vsx: ")
    assert said.err.count("\n") == 1
    assert why in said.err
    assert len(said.err) < 1500


@pytest.mark.parametrize(
    ("place", "why"),
    [
        ("/proc/x", "cannot be made"),
        ("/dev/null", "is not a run folder"),
        ("FOLDER/file", "is not a run folder"),
        ("FOLDER/file/run", "Not a directory"),
        (f"FOLDER/{'x' * 300}", "File name too long"),
        ("FOLDER/" + 30 * f"{'x' * 200}/", "File name too long"),
        ("FOLDER/circle/run", "symbolic links"),
    ],
)
def test_a_place_where_no_folder_can_be(
    begin: list[str], place: str, why: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "file").write_text("in the way", encoding="utf-8")
    (tmp_path / "circle").symlink_to(tmp_path / "circle")
    is_refused([*begin, "--out", place.replace("FOLDER", str(tmp_path))], why, capsys)


@pytest.mark.parametrize("given", [True, False])
def test_a_disk_that_is_read_only_from_the_beginning(
    begin: list[str], given: bool, mounted: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    subprocess.run(["mount", "-o", "remount,ro", str(mounted)], check=True)
    monkeypatch.chdir(mounted)
    is_refused([*begin, *(["--out", str(mounted / "run")] if given else [])], "Read-only file system", capsys)


@pytest.mark.parametrize("given", [True, False])
def test_a_disk_that_is_full_from_the_beginning(
    begin: list[str], given: bool, mounted: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(OSError, match="No space"):
        (mounted / "taken").write_bytes(bytes(2 * SMALL_KB << 10))
    monkeypatch.chdir(mounted)
    is_refused([*begin, *(["--out", str(mounted / "run")] if given else [])], "No space left on device", capsys)


@pytest.mark.parametrize("words", [["explore", "--fast", "--load-map"], ["explore", "--fast", "--resume"], ["report"]])
def test_too_long_a_path_of_any_option_is_no_error_of_this_program(
    words: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    is_refused([*words, "/" + "x" * 300], "File name too long", capsys)
