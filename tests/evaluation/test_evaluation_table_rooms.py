"""The rows of a table outlive every change but those of the code that they judge."""

import subprocess
import sys
from pathlib import Path

import pytest
import tables

import vsx_ros

WITH_ROS = [pytest.mark.ros, pytest.mark.light]
ROWS = sorted({table.rows for table in tables.TABLES.values()})


@pytest.mark.parametrize("rows", ROWS)
def test_every_room_is_there(rows: str) -> None:
    rooms = tables.rooms_of(rows)
    assert [room for room in rooms if not room.exists()] == []
    programs = [room.read_text() for room in rooms if room.suffix == ".py"]
    assert rows == "drives" or any(f'"{rows}"' in program for program in programs)


DOES = {
    "exploration": "explored(exploration.Exploration('lab', 3, 0, 'views', 0.9, 6.0, 1.0))",
    "docking": "attempted(docking.Attempt('create', 0, True))",
}
"""What a program does while it is looked at which modules it loads."""


@pytest.mark.skipif(
    not Path(vsx_ros.__file__).is_relative_to(tables.ROOT), reason="the package is installed; its files are elsewhere"
)
@pytest.mark.parametrize(
    "rows", [pytest.param(rows, marks=WITH_ROS if rows == "docking" else []) for rows in sorted(tables._IN_PROCESS)]
)
def test_what_a_program_loads_is_in_its_rooms(rows: str) -> None:
    """However it comes to be loaded."""
    program = tables._PROGRAMS.get(rows, rows)
    look = f"import sys; sys.path[:0] = {list(map(str, tables._BESIDE))}; "
    look += f"from unittest.mock import MagicMock; sys.modules['tables'] = MagicMock(); import {program}; "
    look += f"{program}.{DOES[rows]}; " if rows in DOES else ""
    look += "print(*(m.__file__ for m in list(sys.modules.values()) if getattr(m, '__file__', None)), sep='\\n')"
    done = subprocess.run([sys.executable, "-c", look], capture_output=True, text=True, check=True)
    rooms = tables.rooms_of(rows)
    paths = map(Path, done.stdout.split("\n"))
    ours = [path for path in paths if path.is_relative_to(tables.ROOT) and not path.name.startswith("table")]
    assert len(ours) > 10
    assert [path for path in ours if path not in rooms] == []


def test_rows_of_one_process_outlive_changes_of_what_it_does_not_import() -> None:
    rooms = {str(room.relative_to(tables.ROOT)) for room in tables.rooms_of("exploration")}
    assert {"src/vsx_ros/slam/mapper.py", "src/vsx_ros/runs/lockstep.py", "benchmarks/exploration.py"} <= rooms
    assert not any(room.startswith(("src/vsx_ros/ros", "src/vsx_ros/cli", "hw")) for room in rooms)


def test_what_a_program_starts_or_imports_later_is_in_its_rooms() -> None:
    """The nodes are processes; the stack of the live tests is imported within a function."""
    rooms = {str(room.relative_to(tables.ROOT)) for room in tables.rooms_of("fault_operator")}
    assert {"src/vsx_ros", "hw/vsx_hw", "benchmarks/exploring_robot.py", "tests/ros/conftest.py"} <= rooms
    assert {"tests/ros/processes.py", "tests/ros/mission_listener.py", "tests/waiting.py"} <= rooms
    assert not any("table" in room for room in rooms)  # how rows are shown does not change them
