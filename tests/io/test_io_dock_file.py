"""The dock beside a map comes back; what cannot be used is refused in one sentence."""

import math

import pytest

from vsx_ros.errors import MapFileError
from vsx_ros.geometry.se2 import SE2
from vsx_ros.io.dock_file import dock_file, load_dock, save_dock


def test_it_comes_back_and_goes(tmp_path):
    path = dock_file(tmp_path / "lab.vsxmap")
    assert path.name == "lab_dock.yaml"
    assert load_dock(path) is None
    save_dock(SE2(1.25, -3.5, 2.0 * math.pi + 0.5), path)
    there = load_dock(path)
    assert (there.x, there.y, there.theta) == pytest.approx((1.25, -3.5, 0.5), abs=1e-4)
    save_dock(None, path)
    assert not path.exists()


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("version: 2\ndocked: {x_m: 1, y_m: 1, heading_rad: 0}\n", "version: 1"),
        ("version: 1\n", "a table 'docked'"),
        ("version: 1\ndocked: {x_m: 1, y_m: nan}\n", "needs the numbers"),
        ("version: 1\ndocked: {x_m: .nan, y_m: 1, heading_rad: 0}\n", "no building"),
        ("version: 1\ndocked: {x_m: 1" + "0" * 400 + ", y_m: 1, heading_rad: 0}\n", "no building"),
        ("version: 1\ndocked: {x_m: 1, y_m: 1, heading_rad: 1.0e+300}\n", "heading 1e[+]300 rad"),
        ("version: 1\ndocked: {x_m: true, y_m: 1, heading_rad: 0}\n", "needs the numbers"),
        ("version: 1\ndocked: {x_m: 1000000000.0, y_m: 1, heading_rad: 0}\n", "no building"),
        ("version: [\n", "cannot be read"),
    ],
)
def test_a_damaged_file_is_refused(tmp_path, text, words):
    path = tmp_path / "lab_dock.yaml"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(MapFileError, match=words):
        load_dock(path)
