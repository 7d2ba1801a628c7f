"""What makes a world hard: named, bounded, off by default, the same by the same seed."""

from pathlib import Path

import numpy as np
import pytest

from vsx_ros.errors import ConfigError
from vsx_ros.robot import STOP, VelocityCommand
from vsx_ros.runs.world import open_world, save_world
from vsx_ros.sim.body import BodySettings
from vsx_ros.sim.camera import CameraSettings
from vsx_ros.sim.generate import generate_world
from vsx_ros.sim.hard_settings import body_in, camera_in
from vsx_ros.sim.hard_surfaces import CHANGES
from vsx_ros.sim.hard_things import HARD_THINGS, named_things
from vsx_ros.sim.robot import EmulatedRobot
from vsx_ros.sim.smear import Smear
from vsx_ros.sim.truth import is_connected
from vsx_ros.sim.world import World
from vsx_ros.sim.world_file import load_world, with_hard_things


def hard(world: World, **things: float) -> World:
    """The world with these things, underscores for hyphens."""
    changed = with_hard_things(world, {name.replace("_", "-"): amount for name, amount in things.items()}, "test")
    assert isinstance(changed, World)
    return changed


def test_words_become_amounts() -> None:
    assert named_things(["white-walls=0.5,latency", "thin-legs=2"], "--with") == {
        "white-walls": 0.5,
        "latency": HARD_THINGS["latency"].usual,
        "thin-legs": 2.0,
    }
    assert named_things(["latency=0"], "--with") == {"latency": 0.0}


@pytest.mark.parametrize(
    ("words", "told"),
    [
        ("white-wals", r"did you mean 'white-walls'\?"),
        ("white-walls=2", "white-walls is 2; give 0 to 1 share"),
        ("white-walls=much", r"no number; write white-walls=AMOUNT"),
        ("latency=nan", "latency is nan"),
    ],
)
def test_wrong_words_are_named(words: str, told: str) -> None:
    with pytest.raises(ConfigError, match=told):
        named_things([words], "--with")


def test_usual_amounts_lie_within_their_bounds() -> None:
    for thing in HARD_THINGS.values():
        low, high = thing.bounds
        assert low <= thing.usual <= high
        assert thing.usual > 0.0


def test_a_world_file_keeps_its_hard_things_and_without_any_says_nothing_of_them(tmp_path: Path, lab: World) -> None:
    path = tmp_path / "world.yaml"
    save_world(lab, path)
    assert "hard" not in path.read_text()
    path.write_text(path.read_text() + "hard: {white-walls: 1, latency: 150}\n")
    world = load_world(path)
    assert world == hard(lab, white_walls=1.0, latency=150.0)
    save_world(world, path)
    assert load_world(path) == world
    path.write_text(path.read_text().replace("latency", "latenzy"))
    with pytest.raises(ConfigError, match=r"world.yaml.*latency|latency.*\?"):
        load_world(path)


def test_zero_takes_a_world_s_own_thing_away(tmp_path: Path, lab: World) -> None:
    path = tmp_path / "world.yaml"
    save_world(hard(lab, people=3.0, latency=150.0, robot_error=1.0, glossy_floor=0.2), path)
    assert open_world(str(path), 1, hard=["people=0,latency=0"]).hard == {"robot-error": 1.0, "glossy-floor": 0.2}
    assert open_world(str(path), 1, hard=["people=0,latency=0,robot-error=0,glossy-floor=0"]) == lab
    assert "people" not in open_world(str(path), 1, hard=["people", "people=0,doors=0"]).hard


@pytest.mark.parametrize("name", CHANGES)
def test_what_has_changed_a_building_is_not_taken_away(name: str, tmp_path: Path, lab: World) -> None:
    path = tmp_path / "world.yaml"
    save_world(with_hard_things(lab, {name: HARD_THINGS[name].usual}, "test"), path)
    with pytest.raises(ConfigError, match=f"--with: {name}=0 .* without it"):
        open_world(str(path), 1, hard=[f"{name}=0"])
    save_world(lab, path)
    assert open_world(str(path), 1, hard=[f"{name}=0"]) == lab
    path.write_text(path.read_text() + f"hard: {{{name}: 0}}\n")
    assert load_world(path) == lab


@pytest.mark.parametrize("name", CHANGES)
def test_changes_of_surfaces_are_idempotent_and_leave_ways_open(name: str) -> None:
    for seed in (0, 1):
        world = generate_world("lab", seed)
        changed = CHANGES[name](world, HARD_THINGS[name].usual)
        assert changed != world
        assert CHANGES[name](changed, HARD_THINGS[name].usual) == changed
        assert is_connected(changed)


def test_all_changes_at_once_survive_a_file(tmp_path: Path) -> None:
    half = {"white-walls": 0.4, "glass-walls": 0.5, "mirrors": 2.0, "windows": 2.0, "thin-legs": 1.5, "people": 2.0}
    for name, seed in (("lab", 20), ("office", 2)):
        world = with_hard_things(generate_world(name, seed), half, "test")
        save_world(world, tmp_path / "world.yaml")
        assert load_world(tmp_path / "world.yaml") == world


def test_white_walls_have_no_pictures_and_others_keep_theirs(lab: World) -> None:
    assert hard(lab, white_walls=1.0).posters == []
    half = hard(lab, white_walls=0.5)
    assert 0 < len(half.posters) < len(lab.posters)
    assert set(half.posters) < set(lab.posters)


def test_a_gazebo_file_gets_what_goes_with_it(tmp_path: Path) -> None:
    file = str(Path(__file__).parents[1] / "data/gazebo_room/worlds/room.world")
    world = open_world(file, 1, hard=["latency=100"])
    assert world.hard == {"latency": 100.0}
    save_world(world, tmp_path / "world.yaml")
    assert load_world(tmp_path / "world.yaml").hard == {"latency": 100.0}
    assert open_world(str(tmp_path / "world.yaml"), 1, hard=["latency=0,white-walls=0"]).hard == {}
    with pytest.raises(ConfigError, match="white-walls goes with generated buildings"):
        open_world(file, 1, hard=["white-walls"])


def test_the_robot_s_errors_differ_by_seed_and_are_told_to_nobody(empty_room: World) -> None:
    plain = EmulatedRobot(empty_room, 3)
    wrong = [EmulatedRobot(hard(empty_room, robot_error=1.0), seed) for seed in (3, 3, 4)]
    for robot in wrong:
        assert robot.T_base_cam_given.rotation_angle_to(plain.T_base_cam_given) == 0.0
        assert robot.camera_given.shutter == plain.camera_given.shutter
        assert 0.0249 < robot.camera_true.shutter.readout_s < 0.0301
        assert robot.T_base_cam_given.rotation_angle_to(robot.T_base_cam_true) < 2**0.5 * 0.036
    assert wrong[0].camera_true == wrong[1].camera_true != wrong[2].camera_true
    assert wrong[0].camera_given == plain.camera_given
    assert wrong[0].T_base_cam_true.rotation_angle_to(wrong[2].T_base_cam_true) > 0.002


def test_errors_grow_with_their_amount_and_none_leaves_the_settings() -> None:
    assert body_in({}, BodySettings()) == BodySettings()
    assert camera_in({}, 1, CameraSettings()) == CameraSettings()
    one, two = (camera_in({"robot-error": amount}, 1, CameraSettings()) for amount in (1.0, 2.0))
    assert two.readout_off_ns == pytest.approx(2 * one.readout_off_ns, abs=2)
    assert body_in({"robot-error": 2.0}, BodySettings()).wheel_scale_error == pytest.approx(0.1)


def test_a_sticky_wheel_turns_the_robot_and_its_encoder_stands(empty_room: World) -> None:
    robot = EmulatedRobot(hard(empty_room, sticky_wheel=1.0), 1)
    turned = [robot.step(VelocityCommand(0.1, 0.0)).odometry.omega for _ in range(60)]
    assert max(abs(omega) for omega in turned) > 0.2
    assert len({omega > 0.0 for omega in turned if abs(omega) > 0.2}) == 1  # always the same wheel
    left, right = robot.body.encoders()
    assert abs(left - right) > 500


def test_lost_images_leave_gaps_and_repeat_by_seed(empty_room: World) -> None:
    stamps = []
    for _ in range(2):
        robot = EmulatedRobot(hard(empty_room, dropped_frames=30.0), 2)
        stamps.append([robot.step(STOP).frame.stamp_ns for _ in range(20)])
    assert stamps[0] == stamps[1]
    slots = np.rint(np.array(stamps[0]) * 15e-9)
    assert 24 < slots[-1] < 36


def test_the_answer_to_a_late_image_is_late(empty_room: World) -> None:
    ways = []
    for late_ms in (0.0, 200.0):
        robot = EmulatedRobot(hard(empty_room, latency=late_ms), 1)
        for _ in range(15):
            robot.step(VelocityCommand(0.2, 0.0))
        ways.append(robot.truth.path_length_m)
    assert ways[0] - ways[1] == pytest.approx(0.2 * 0.2, abs=0.005)


def test_fingerprints_blur_the_share_that_they_cover(rng: np.random.Generator) -> None:
    smear = Smear(120, 160, 0.3, rng)
    stripes = np.tile((np.arange(160) % 4 < 2).astype(np.float32), (120, 1))
    seen = smear.through(stripes)
    blurred = np.abs(np.diff(seen[:, 1::2], axis=1)) < 0.5
    assert 0.2 < blurred.mean() < 0.55
    assert seen.mean() == pytest.approx(stripes.mean(), abs=0.02)


def test_fingerprints_are_on_the_robot_s_lens(lab: World) -> None:
    smeared, clean = (EmulatedRobot(world, 1).step(STOP).frame.image for world in (hard(lab, fingerprints=0.3), lab))
    assert 0.005 < (np.abs(smeared.astype(int) - clean) > 20).mean() < 0.6
