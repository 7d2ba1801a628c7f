"""The unit files of the drivers."""

import shutil
import subprocess
from configparser import ConfigParser
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
UNITS = sorted((ROOT / "hw/systemd").glob("*.service"))


def read(unit: Path) -> ConfigParser:
    parser = ConfigParser(strict=True, interpolation=None)
    parser.optionxform = str  # type: ignore[assignment,method-assign]  # names keep their case
    parser.read(unit)
    return parser


@pytest.mark.parametrize("unit", UNITS, ids=lambda unit: unit.stem)
def test_a_driver_is_started_again_however_often_it_fails(unit: Path) -> None:
    """By default systemd gives up for good after five starts within ten seconds."""
    of = read(unit)
    assert of["Unit"]["StartLimitIntervalSec"] == "0"
    assert of["Service"]["Restart"] == "on-failure"
    assert float(of["Service"]["RestartSec"]) > 0.0
    assert of["Install"]["WantedBy"] == "multi-user.target"


@pytest.mark.parametrize("unit", UNITS, ids=lambda unit: unit.stem)
def test_the_programs_of_the_units_exist(unit: Path) -> None:
    of = read(unit)["Service"]
    for program in (of[name].split()[0] for name in ("ExecStart", "ExecStopPost") if name in of):
        assert (ROOT / Path(program).relative_to("/opt/vsx_ros")).is_file()


@pytest.mark.skipif(shutil.which("systemd-analyze") is None, reason="systemd is not installed")
@pytest.mark.parametrize("unit", UNITS, ids=lambda unit: unit.stem)
def test_systemd_understands_every_option(unit: Path, tmp_path: Path) -> None:
    here = tmp_path / unit.name
    here.write_text(unit.read_text().replace("/opt/vsx_ros", str(ROOT)))
    done = subprocess.run(["systemd-analyze", "verify", here], capture_output=True, text=True, timeout=60, check=False)
    told = [line for line in done.stderr.splitlines() if unit.name in line]
    assert (done.returncode, told) == (0, [])
