"""``vsx calibrate camera`` from files and recordings, and what it writes."""

import cv2
import pytest
import yaml
from board_pictures import CAMERA, Photographer, poses

from vsx_ros.calibration.board import Board
from vsx_ros.cli.main import execute, parse
from vsx_ros.io.calibration_file import read_calibration
from vsx_ros.runs.parameters import default_robot_file, update_robot_file
from vsx_ros.runs.start import begin

BOARD = ["--board", "8x6x0.03"]


@pytest.fixture(scope="module")
def pictures(tmp_path_factory):
    folder, photographer = tmp_path_factory.mktemp("pictures"), Photographer()
    for k, T in enumerate(poses(15)):
        cv2.imwrite(str(folder / f"{k:02d}.png"), photographer.picture(T))
    return folder


def test_pictures_become_a_file_where_ros_looks_for_it(pictures, tmp_path, monkeypatch, capsys):
    monkeypatch.setenv("ROS_HOME", str(tmp_path))
    assert execute(["calibrate", "camera", str(pictures), *BOARD, "--name", "rgb_A1"]) == 0
    said = capsys.readouterr().out
    file = tmp_path / "camera_info/rgb_A1.yaml"
    assert read_calibration(file).shutter is None
    for words in ("15 of 15 pictures", "px rms", "good", str(file)):
        assert words in said
    assert read_calibration(file).fx == pytest.approx(CAMERA.fx, rel=0.003)
    text = file.read_text(encoding="utf-8")
    assert text.startswith("# vsx calibrate camera: 0.")
    assert yaml.safe_load(text)["camera_name"] == "rgb_A1"
    file.write_text(text + "shutter: {readout_s: 0.03, exposure_s: 0.01}\n", encoding="utf-8")
    assert execute(["calibrate", "camera", str(pictures), *BOARD, "--name", "rgb_A1", "--model", "rational"]) == 0
    again = read_calibration(file)
    assert (again.shutter, again.model) == ((0.03, 0.01), "rational_polynomial")


def test_a_board_of_circles_will_do(tmp_path, capsys):
    board = Board("circles", 8, 6, 0.03)
    photographer = Photographer(board=board)
    for k, T in enumerate(poses(15)):
        cv2.imwrite(str(tmp_path / f"{k:02d}.png"), photographer.picture(T))
    words = [*BOARD, "--pattern", "circles", "--out", str(tmp_path / "c.yaml")]
    assert execute(["calibrate", "camera", str(tmp_path), *words]) == 0
    assert "px rms" in capsys.readouterr().out
    found = read_calibration(tmp_path / "c.yaml")
    assert found.fx == pytest.approx(CAMERA.fx, rel=0.005)
    assert found.fy == pytest.approx(CAMERA.fy, rel=0.005)


def test_a_recording_is_searched_for_views_that_differ(pictures, tmp_path, capsys):
    (tmp_path / "rgb").symlink_to(pictures)
    files = sorted(pictures.glob("*.png"))
    lines = [f"{k * 0.1 + d * 0.01:.3f} rgb/{file.name}" for k, file in enumerate(files) for d in range(3)]
    (tmp_path / "rgb.txt").write_text("\n".join(lines), encoding="utf-8")
    assert execute(["calibrate", "camera", str(tmp_path), *BOARD, "--out", str(tmp_path / "c.yaml")]) == 0
    assert "15 of 45 pictures" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["{p}/00.png", "{p}/01.png", *BOARD], "4 are needed"),
        (["{p}", "--board", "9x7x0.03"], "check the number of inner corners"),
        (["{p}", "--board", "8x6"], "8x6x0.025"),
        (["{p}/none", *BOARD], "there is no"),
        ([*BOARD], "--live"),
        (["{p}", "--live", *BOARD], "--live"),
        (["--live", *BOARD, "--out", "c.yaml"], "leave out --out"),
        (["--live", *BOARD, "--name", "left"], "leave out --name"),
        (["{t}", *BOARD], "no picture"),
        (["{p}", "{t}/small.png", *BOARD], "64x48"),
        (["{t}/text.png", *BOARD], "it is no JPEG, PNG"),
        (["{p}", *BOARD, "--out", "{t}/text.png/c.yaml"], "another file with --out"),
    ],
)
def test_what_cannot_be_used_is_said_in_one_sentence(words, said, pictures, tmp_path, capsys):
    if any("small" in word for word in words):
        cv2.imwrite(str(tmp_path / "small.png"), cv2.imread(str(pictures / "00.png"))[:48, :64])
    if any("text" in word for word in words):
        (tmp_path / "text.png").write_text("no picture", encoding="utf-8")
    line = ["calibrate", "camera", *(word.format(p=pictures, t=tmp_path) for word in words)]
    assert execute(line) == 1
    error = capsys.readouterr().err
    assert said in error
    assert error.count("\n") == 1


def test_a_real_robot_explores_with_its_own_parameters_and_an_emulated_one_without(tmp_path, monkeypatch, capsys):
    monkeypatch.setenv("ROS_HOME", str(tmp_path))
    update_robot_file(default_robot_file(), "robot.mount", {"height_m": 0.42}, "by hand")
    words = ["explore", "--out"]
    with begin(parse([*words, str(tmp_path / "real")])) as (_, real, _):
        assert real.robot.mount.height_m == 0.42
    assert "robot.yaml" in capsys.readouterr().err
    with begin(parse([*words, str(tmp_path / "emulated"), "--world", "lab"])) as (_, emulated, _):
        assert emulated.robot.mount.height_m == 0.31


def test_a_file_of_the_users_own_replaces_the_calibrations_and_that_is_told(tmp_path, monkeypatch, capsys):
    monkeypatch.setenv("ROS_HOME", str(tmp_path))
    body = tmp_path / "body.yaml"
    body.write_text("limits: {v_m_s: 0.18}\n", encoding="utf-8")
    words = ["explore", "--config", str(body), "--out", str(tmp_path / "run")]
    with begin(parse(words)):
        assert capsys.readouterr().err == ""
    update_robot_file(default_robot_file(), "robot.mount", {"height_m": 0.42}, "by hand")
    with begin(parse(words)) as (_, config, _):
        assert (config.limits.v_m_s, config.robot.mount.height_m) == (0.18, 0.31)
    told = f"vsx: {body} replaces this robot's own parameters and calibrations in {default_robot_file()}\n"
    assert capsys.readouterr().err == told
    with begin(parse([*words, "--world", "lab"])):
        assert capsys.readouterr().err == ""
    words[2] = str(default_robot_file())
    with begin(parse(words)) as (_, config, _):
        assert config.robot.mount.height_m == 0.42
    assert capsys.readouterr().err == ""
