import argparse
import importlib.util
import subprocess
import sys

import pytest

from vsx_hw import bases
from vsx_hw.errors import DeviceNotFound
from vsx_ros import __version__
from vsx_ros.cli import main, options_runs, options_study
from vsx_ros.config import Config, overridden
from vsx_ros.errors import ConfigError, InputError
from vsx_ros.planning.planners import PLANNERS
from vsx_ros.runs.process import FAILED
from vsx_ros.runs.world import check_world

LIGHT = "import sys, vsx_ros.cli.main as m; m.parser(); print([n for n in {heavy!r} if n in sys.modules])"


def test_help_loads_nothing_heavy():
    heavy = ("numpy", "numba", "cv2", "yaml", "msgspec", "rosbags", "rospy")
    code = LIGHT.format(heavy=heavy)
    shown = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert shown.stdout.strip() == "[]"


def test_help_names_what_the_registries_hold():
    explored, planned = argparse.ArgumentParser(), argparse.ArgumentParser()
    options_runs.explore(explored)
    options_study.plan(planned)
    named = {action.dest: action.metavar for action in (*planned._actions, *explored._actions)}
    assert named["planner"] == planned._option_string_actions["--planner"].metavar == "|".join(PLANNERS)
    kinds = {name.partition("[")[0] for name in named["base"].split("|")}
    assert kinds == {"auto", "ros", *bases.BASES} == set(explored._option_string_actions["--base"].choices)


def test_version(capsys):
    with pytest.raises(SystemExit) as left:
        main.execute(["--version"])
    assert left.value.code == 0
    assert capsys.readouterr().out.strip() == f"vsx_ros {__version__}"


def test_phi_has_the_bound_of_its_parameter():
    least = main.parse(["explore", "--phi", "0.01"]).phi
    assert overridden(Config(), {"planner.phi_rad_m": least}).planner.phi_rad_m == 0.01
    with pytest.raises(ConfigError, match=r"at least 0\.01"):
        overridden(Config(), {"planner.phi_rad_m": 0.0099})


MINUS = "-1,2,90"
PLACES = {  # every value that is a place, in a whole line
    ("explore", "--dock"): ["explore", "--dock", MINUS],
    ("map load", "--dock"): ["map", "load", "x.vsxmap", "--dock", MINUS],
    ("world", "--start"): ["world", "import", "house.world", "--start", MINUS],
    ("plan", "--start"): ["plan", "--start", MINUS, "--goal", "0,0,0"],
    ("plan", "--goal"): ["plan", "--start", "0,0,0", "--goal", MINUS],
    ("go", "place"): ["go", MINUS],
    ("dock", "--at"): ["dock", "--at", MINUS],
    ("zone add", "points"): ["zone", "add", "stairs", "wall", "-1,2 3,4", "-.5,2"],
}


def values(parser, name=""):
    """Every command and option with what its value is called."""
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            for verb, inner in action.choices.items():
                yield from values(inner, f"{name} {verb}".strip())
        else:
            yield (name, (*action.option_strings, action.dest)[0]), str(action.metavar)


def test_a_place_may_begin_with_a_minus_sign():
    assert set(PLACES) == {key for key, what in values(main.parser()) if "X,Y" in what or what == "CORNERS"}
    for (_, option), line in PLACES.items():
        value = getattr(main.parse(line), option.lstrip("-"))
        if option == "points":
            assert value == ["-1,2 3,4", "-.5,2"]
        elif value != MINUS:  # as it stands
            assert value[:2] == (-1.0, 2.0)


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ([], "COMMAND"),
        (["fly"], "'fly'"),
        (["exlpore"], "(did you mean 'explore'?)"),
        (["explore", "--wrld", "lab"], "vsx explore: unrecognized arguments: --wrld lab (did you mean '--world'?)"),
        (["explore", "--base", "kobuky"], "(did you mean 'kobuki'?)"),
        (["map", "info", "x", "--jsn"], "vsx map info: unrecognized arguments: --jsn (did you mean '--json'?)"),
        (["explore", "--eye", "foo"], "'mitsuba'); 'vsx explore --help'"),  # 'fov' is a planner
        (["plan", "--start", "0,0,0", "--goal", "1,0,0", "--phi", "-1"], "--phi: -1: give a number of at least 0.01"),
        (["plan", "--start", "0,0,0", "--goal", "1,0,0", "--phi", "0.0099"], "--phi: 0.0099: give a number of at"),
        (["explore", "--phi", "0.0099"], "--phi: 0.0099: give a number of at least 0.01"),
        (["map", "load", "x.vsxmap", "--phi", "nan"], "--phi: nan: give a number of at least 0.01"),
        (["map", "load", "x.vsxmap", "--resume", "r"], "unrecognized arguments: --resume r"),
        (["replay"], "INPUT"),
        (["replay", "x", "--wings"], "--wings"),
        (["explore", "--camera", "v4l"], "write kinect"),
        (["explore", "--camera", "v4l:video0"], "v4l:/dev/v4l/by-id/..., ros or ros:TOPIC"),
        (["explore", "--time", "0"], "--time: 0: give a positive number"),
        (["record", "--time", "nan"], "--time: nan: give a positive number"),
        (["sweep", "--time", "-1"], "--time: -1: give a positive number"),
        (["replay", "x", "--seed", "-1"], "--seed: -1: give a whole number from 0 on"),
        (["explore", "--seed", "-1"], "--seed: -1: give a whole number from 0 on"),
        (["evaluate", "x", "--max-gap", "inf"], "--max-gap: inf: give a positive number"),
        (["evaluate", "x", "--max-gap", "nan"], "--max-gap: nan: give a positive number"),
        (["world", "lab", "--start", "nan,0,0", "--out", "w.yaml"], "'nan,0,0' is not a pose"),
        (["teleop", "--v", "fast"], "--v: invalid positive value: 'fast'"),
        (["reproduce", "fig5", "--time", "0"], "--time: 0: give a positive number"),
        (
            ["explore", "--room", "-x"],
            "--room: expected one argument (one that begins with '-' is given as --room=-...)",
        ),
        (["map", "save", "--out"], "--out: expected one argument (one that begins with '-' is given as --out=-...)"),
        (["explore", "-5"], "unrecognized arguments: -5"),
        (["world", "lab", "--start", "-1,2"], "--start: '-1,2' is not a pose; write X,Y,DEG"),
        (["reproduce", "table1", "--jobs", "0"], "--jobs: 0: give a number of at least 1"),
    ],
)
def test_wrong_usage_is_one_line_and_exit_1(line, said, capsys):
    with pytest.raises(SystemExit) as left:
        main.execute(line)
    assert left.value.code == 1
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    assert "--help" in error
    assert said in error


@pytest.mark.parametrize(
    ("raised", "code", "said"),
    [
        (None, 0, ""),
        (InputError("bag x is empty; record it again"), 1, "vsx: bag x is empty; record it again\n"),
        (DeviceNotFound("/dev/kobuki is absent; plug it in"), 2, "vsx: /dev/kobuki is absent; plug it in\n"),
        (KeyboardInterrupt(), 4, "vsx: stopped by the operator\n"),
        (ZeroDivisionError("oops"), 5, "internal error"),
    ],
)
@pytest.mark.parametrize("debug", [False, True])
def test_exit_codes_and_one_sentence(raised, code, said, debug, monkeypatch, capsys):
    def run(args):
        assert args.debug is debug
        if raised is not None:
            raise raised
        return 0

    monkeypatch.setattr("vsx_ros.cli.small_commands.config", run)
    assert main.execute(["config", *(["--debug"] if debug else [])]) == code
    error = capsys.readouterr().err
    assert said in error
    assert ("Traceback" in error) == (debug and raised is not None)
    assert debug or error.count("\n") == (raised is not None)


@pytest.mark.parametrize("line", [["stop"], ["status"], ["view"], ["record"], ["map", "save"], ["explore"]])
def test_where_ros_is_not_installed_one_sentence_says_so(line):
    ros = ("rospy", "rosgraph", "roslaunch", "std_msgs", "sensor_msgs", "geometry_msgs", "nav_msgs", "std_srvs")
    code = f"import sys; sys.modules.update(dict.fromkeys({ros!r})); from vsx_ros.cli.main import main; main()"
    done = subprocess.run([sys.executable, "-c", code, *line], capture_output=True, text=True, check=False)
    assert done.returncode == 1, done.stderr
    assert done.stderr.startswith("vsx: there is no Python package '")
    assert "'vsx doctor'" in done.stderr
    assert done.stderr.count("\n") == 1


def test_a_reader_that_leaves_is_no_error():
    code = f"import sys; sys.path[:0] = {sys.path!r}; from vsx_ros.cli.main import main; main()"
    line = [sys.executable, "-c", code, "config"]
    with subprocess.Popen(line, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as process:
        assert process.stdout is not None
        process.stdout.close()
        assert process.stderr is not None
        assert process.stderr.read() == b""
        assert process.wait() == 0


@pytest.mark.parametrize(
    ("line", "said"),
    [
        (["explore", "--world", "labb"], "or .png (did you mean 'lab'?)"),
        (
            ["explore", "--fast", "--set", "limits.v_ms=0.2"],
            "no parameter 'limits.v_ms' (did you mean 'limits.v_m_s'?)",
        ),
        (["explore", "--config", "{config}"], "no parameter 'limits.v_ms' (did you mean 'limits.v_m_s'?)"),
        (["replay", "drive.bagg"], "there is no drive.bagg"),
        (["explore", "--fast", "--load-map", "no.vsxmap"], "there is no map"),
        (["explore", "--fast", "--load-map", "{config}"], "is not a .vsxmap"),
        (["explore", "--world", "lab", "--resume", "no_run"], "no_run"),
        (["explore", "--fast", "--zones", "no_zones.yaml"], "no_zones.yaml"),
        (["explore", "--fast", "--room", "kitchen"], "give it with --load-map"),
        (["replay", "drive.bag", "--set", "slam.x=1"], "there is no parameter 'slam.x'"),
        (["explore", "--fast", "--set", "limits.v_m_s=fast"], "limits.v_m_s is 'fast'; give a number from 0.01 to 0.7"),
        (["explore", "--fast", "--set", "planner.phi_rad_m=-1"], "planner.phi_rad_m is -1; give a number of at least"),
        (["explore", "--fast", "--set", "dense.enabled=3"], "dense.enabled is 3; give true or false"),
        (["explore", "--fast", "--set", "slam.culling=3"], "slam.culling is 3; give a tree of names and values"),
        (["explore", "--fast", "--world", "lab", "--models", "m"], "--models m is for a Gazebo world, and lab is none"),
        (["explore", "--world", "h.world", "--models", "m"], "--models m: there is no such folder"),
        (["explore", "--models", "m"], "--models m is for a Gazebo world; give --world"),
        (["world", "lab", "--models", "m", "--out", "w.yaml"], "--models m is for a Gazebo world"),
        (["world", "render"], "vsx: give the world, e.g. vsx world render lab"),
        (["world", "lab"], "vsx: say what to write"),
        (["replay", "{folder}", "--image-topic", "/x"], "of images, without topics; leave out --image-topic"),
        (["replay", "{folder}", "--odometry-topic", "/x"], "of images, without topics; leave out --odometry-topic"),
        (["calibrate", "camera", "no_folder", "--board", "8x6x0.025"], "give pictures, a folder of pictures, or a bag"),
        (["map", "info", "{config}"], "is not a .vsxmap; 'vsx map save' makes one"),
        (["map", "export", "{config}", "--format", "ply"], "is not a .vsxmap; 'vsx map save' makes one"),
    ],
)
def test_what_is_misspelt_is_told_before_anything_is_compiled(line, said, monkeypatch, capsys, tmp_path):
    monkeypatch.setattr("vsx_ros.cli.explore.compile_kernels", lambda *_: pytest.fail("compiles"))
    (tmp_path / "robot.yaml").write_text("limits: {v_ms: 0.2}\n")
    (tmp_path / "rgb.txt").touch()
    assert main.execute([word.format(config=tmp_path / "robot.yaml", folder=tmp_path) for word in line]) == FAILED
    error = capsys.readouterr().err
    assert said in error
    assert error.count("\n") == 1


def test_another_world_file_of_the_folder_is_proposed(tmp_path):
    (tmp_path / "house.world").write_text("")
    with pytest.raises(ConfigError, match=r"did you mean '.*house\.world'"):
        check_world(str(tmp_path / "hose.world"))


@pytest.mark.parametrize("error", [ModuleNotFoundError("No module named 'cv2'", name="cv2"), AttributeError("no 'x'")])
def test_a_python_without_the_environment_is_told_whatever_fails_there(error, monkeypatch, capsys):
    def broken(_):
        raise error

    find = importlib.util.find_spec
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None if name == "numba" else find(name))
    monkeypatch.setattr(main, "run", broken)
    assert main.execute(["config"]) == FAILED
    said = capsys.readouterr().err
    assert f"is not the Python of this checkout's environment ({error})" in said
    assert "scripts/vsx" in said
    assert said.count("\n") == 1


def test_another_python_than_the_environment_s_is_told_in_a_sentence(monkeypatch, capsys):
    def broken(_):
        raise ImportError("cannot import name 'A' from 'numpy'")

    monkeypatch.setattr(main, "run", broken)
    assert main.execute(["doctor"]) == FAILED
    said = capsys.readouterr().err
    assert "is not the Python of this checkout's environment (cannot import name 'A' from 'numpy')" in said
    assert "scripts/vsx" in said
    assert "internal error" not in said
