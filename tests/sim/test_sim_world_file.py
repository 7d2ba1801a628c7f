from pathlib import Path

import pytest
import yaml

from vsx_ros.errors import ConfigError
from vsx_ros.runs.world import save_world
from vsx_ros.sim.generate import generate_world
from vsx_ros.sim.world_file import load_world


@pytest.mark.parametrize("name", ["lab", "corridor"])
def test_round_trip_keeps_every_value(tmp_path: Path, name: str) -> None:
    world = generate_world(name, 3)
    save_world(world, tmp_path / "world.yaml")
    assert load_world(tmp_path / "world.yaml") == world


def broken(tmp_path: Path, path: list[str | int], value: object) -> Path:
    save_world(generate_world("lab", 0), tmp_path / "world.yaml")
    tree = yaml.safe_load((tmp_path / "world.yaml").read_text())
    node = tree
    for key in path[:-1]:
        node = node[key]
    node[path[-1]] = value
    (tmp_path / "world.yaml").write_text(yaml.safe_dump(tree))
    return tmp_path / "world.yaml"


@pytest.mark.parametrize(
    ("path", "value", "words"),
    [
        (["version"], 2, "version"),
        (["boxes", 0, "height"], -1.0, "height"),
        (["boxes", 0, "colour"], "red", "colour"),
        (["boxes", 0, "material"], "granite", "granite"),
        (["boxes", 0, "yaw_rad"], float("nan"), "finite"),
        (["boxes", 0, "x"], float("inf"), "x"),
        (["outlines", 0, "points"], [[0, 0], [1, 0]], "points"),
        (["outlines", 0, "material"], ["paint", "paint"], "one per side"),
        (["materials", "paint", "kind"], "marble", "marble"),
        (["start"], None, "start"),
        (["start", "x"], 1e4, "outside of its outlines"),
    ],
)
def test_wrong_values_are_named(tmp_path: Path, path: list[str | int], value: object, words: str) -> None:
    with pytest.raises(ConfigError, match=words):
        load_world(broken(tmp_path, path, value))


def test_a_file_cut_short_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "world.yaml"
    save_world(generate_world("corridor", 0), path)
    lines = path.read_text().rstrip().splitlines(keepends=True)
    for count in range(0, len(lines), 10):
        path.write_text("".join(lines[:count]))
        with pytest.raises(ConfigError, match="world.yaml"):
            load_world(path)
    path.write_text("".join(lines)[:-1])
    with pytest.raises(ConfigError, match="it is cut short: its last line, '# end', is missing"):
        load_world(path)


@pytest.mark.parametrize("text", ["[1, 2", "just words", "", "\x00\x01"])
def test_files_that_are_no_worlds_are_refused(tmp_path: Path, text: str) -> None:
    (tmp_path / "world.yaml").write_text(text)
    with pytest.raises(ConfigError, match="world.yaml"):
        load_world(tmp_path / "world.yaml")


def test_missing_file_and_unwritable_place_are_refused(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="nowhere"):
        load_world(tmp_path / "nowhere.yaml")
    with pytest.raises(ConfigError, match="cannot be written"):
        save_world(generate_world("corridor", 0), tmp_path / "no" / "folder" / "world.yaml")
