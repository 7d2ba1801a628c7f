"""Light that changes: deterministic, off by default, and as a camera sees it."""

from pathlib import Path

import numpy as np
import pytest
from msgspec.structs import replace

from vsx_ros.errors import ConfigError
from vsx_ros.kernels.sim.raycast_cull import Scene
from vsx_ros.robot import STOP
from vsx_ros.runs.world import save_world
from vsx_ros.sim.changing_light import ChangingLight, windows_of
from vsx_ros.sim.drawn_world import DrawnWorld
from vsx_ros.sim.light_map import Nodes, Window, sunlight
from vsx_ros.sim.lighting import LIGHTS, Lighting, circuits_on, light_named
from vsx_ros.sim.optics import scene_of
from vsx_ros.sim.robot import EmulatedRobot
from vsx_ros.sim.world import World
from vsx_ros.sim.world_file import load_world


def images(world: World, count: int) -> np.ndarray:
    robot = EmulatedRobot(world, 1)
    return np.stack([robot.step(STOP).frame.image for _ in range(count)])


def test_without_lighting_nothing_changes(lab: World, lab_scene: Scene, tmp_path: Path) -> None:
    steady = scene_of(lab)
    assert isinstance(steady, DrawnWorld)
    assert all(np.array_equal(a, b) for a, b in zip(steady.scene, lab_scene))
    save_world(lab, tmp_path / "world.yaml")
    assert "lighting" not in (tmp_path / "world.yaml").read_text()


def test_all_circuits_together_are_the_steady_light(lab: World, lab_scene: Scene) -> None:
    lit, _ = ChangingLight(lab, Lighting(circuits=5), lab_scene).at(0)
    assert np.allclose(lit.surfaces, lab_scene.surfaces, rtol=1e-5)
    corners = lit.light.view(np.uint8).astype(int) - lab_scene.light.view(np.uint8)
    assert np.abs(corners).max() <= 1


@pytest.mark.parametrize("light", ["switched", "sun"])
def test_same_seed_same_light(lab: World, light: str) -> None:
    first, again = (images(replace(lab, lighting=light_named(light, 3)), 3) for _ in range(2))
    assert np.array_equal(first, again)
    assert not np.array_equal(first, images(replace(lab, lighting=light_named(light, 5)), 3))


def test_one_circuit_is_switched_at_a_time_and_one_stays_on() -> None:
    for seed in range(5):
        lighting = Lighting(seed=seed, circuits=4, lit=0.5)
        states = np.array([circuits_on(lighting, k) for k in range(60)])
        assert states[0].sum() == 2
        assert states.any(axis=1).all()
        changed = (states[1:] != states[:-1]).sum(axis=1)
        assert set(changed.tolist()) <= {1, 2}, "the last one goes off as another goes on"
        assert (changed == 1).mean() > 0.7
        assert states.mean(axis=0).min() > 0.1, "every circuit gets its turn"


def test_the_scene_changes_when_a_lamp_is_switched_and_only_then(lab: World, lab_scene: Scene) -> None:
    light = ChangingLight(lab, Lighting(lit=0.5, switches_per_min=6.0), lab_scene)
    first, _ = light.at(0)
    assert light.at(9_900_000_000)[0] is first
    assert not np.array_equal(light.at(10_100_000_000)[0].light, first.light)


def test_sunlight_falls_through_the_window_and_wanders() -> None:
    x, y = np.meshgrid(np.linspace(0.0, 4.0, 201), np.linspace(-2.0, 2.0, 201))
    floor = Nodes(np.stack([x, y, np.zeros_like(x)], axis=2), np.array([0.0, 0.0, 1.0]))
    window = Window(np.array([0.0, 0.0, 1.5]), np.array([0.0, 1.0, 0.0]), np.array([1.0, 0.0, 0.0]), (1.0, 1.0))
    slope = np.array([1.0, 0.0, -1.0]) / np.sqrt(2.0)
    light = sunlight(floor, [window], slope)
    inside = (x > 1.05) & (x < 1.95) & (np.abs(y) < 0.45)
    outside = (x < 0.95) | (x > 2.05) | (np.abs(y) > 0.55)
    assert light[inside].min() == pytest.approx(np.sqrt(0.5))
    assert light[outside].max() == 0.0
    assert sunlight(floor, [window], slope * [-1, 1, 1]).max() == 0.0, "from inside"
    aside = np.array([1.0, 0.2, -1.0]) / np.linalg.norm([1.0, 0.2, -1.0])
    moved = sunlight(floor, [window], aside)
    assert np.average(y, weights=moved) == pytest.approx(0.3, abs=0.03)


def test_windows_are_in_the_outer_walls(lab: World) -> None:
    x0, y0, x1, y1 = lab.bounds
    for window in windows_of(lab, Lighting(windows=5)):
        x, y, z = window.middle
        assert min(x - x0, x1 - x, y - y0, y1 - y) == pytest.approx(0.0, abs=1e-9)
        ix, iy, _ = window.middle + window.inwards
        assert x0 < ix < x1
        assert y0 < iy < y1


def test_a_tenth_of_the_light_is_as_bright_in_the_image_and_noisier(lab: World) -> None:
    steady = images(lab, 3)[1:].astype(float)
    dark = images(replace(lab, lighting=LIGHTS["dim"]), 3)[1:].astype(float)
    assert dark.mean() == pytest.approx(steady.mean(), rel=0.03)
    assert np.diff(dark, axis=0).std() > 2.5 * np.diff(steady, axis=0).std()


def test_light_in_a_world_file(lab: World, tmp_path: Path) -> None:
    file = tmp_path / "night.yaml"
    night = replace(lab, lighting=light_named("night", 2))
    save_world(night, file)
    assert load_world(file) == night
    file.write_text(file.read_text().replace("circuits: 4", "circuits: 0"))
    with pytest.raises(ConfigError, match="circuits"):
        load_world(file)


def test_an_unknown_light_is_refused_with_those_there_are() -> None:
    with pytest.raises(ConfigError, match="did you mean 'night'"):
        light_named("nigth", 0)
