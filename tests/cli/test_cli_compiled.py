import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from vsx_ros.cli import compiled
from vsx_ros.cli.compiled import ALL, DRIVE, SLAM, compile_kernels, is_compiled
from vsx_ros.cli.main import execute
from vsx_ros.kernels.warmup import GROUPS
from vsx_ros.runs.process import STOPPED

HALLWAY = Path(__file__).resolve().parents[1] / "data/mononav_hallway/hallway.bag"


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """A folder with a kernel, and the groups that were compiled; no compiler is at work."""
    (tmp_path / "loop.py").write_text("")
    started = []

    def start(groups):
        started.extend(groups)
        good = [group for group in groups if group != "loops" or "broken" not in started]
        return compiled.subprocess.Popen(["printf", "%s\\n", *good], stdout=compiled.subprocess.PIPE)

    monkeypatch.setattr(compiled, "_started", start)
    return tmp_path, started


def test_each_group_is_known_to_the_command_and_the_first_drive_needs_some_of_them():
    assert set(ALL) == set(GROUPS)
    assert set(SLAM) < set(DRIVE) < set(ALL)
    assert {"surfaces", "emulation"}.isdisjoint(DRIVE)


def test_kernels_are_compiled_once_and_that_is_told(folder, capsys):
    path, started = folder
    assert not is_compiled(folder=path)
    assert compile_kernels(folder=path)
    said = capsys.readouterr().err
    assert "compiling the kernels" in said
    assert f"{len(ALL)} parts" in said
    assert sorted(started) == sorted(ALL)
    assert is_compiled(folder=path)
    assert compile_kernels(folder=path)
    assert (capsys.readouterr().err, len(started)) == ("", len(ALL))


def test_only_what_is_asked_for_is_compiled_and_later_the_rest(folder):
    path, started = folder
    assert compile_kernels(*SLAM, folder=path)
    assert sorted(started) == sorted(SLAM)
    assert is_compiled(*SLAM, folder=path)
    assert not is_compiled(*DRIVE, folder=path)
    code = path / "__pycache__" / "loop.nbc"
    code.write_bytes(b"machine code")
    assert compile_kernels(folder=path)
    assert sorted(started) == sorted(ALL)
    assert code.exists()


@pytest.mark.parametrize("change", ["a source", "the compiler"])
def test_after_a_change_all_is_compiled_anew_callers_too(folder, monkeypatch, change):
    path, started = folder
    compile_kernels(folder=path)
    caller = path / "__pycache__" / "caller.nbc"
    caller.write_bytes(b"machine code of before")
    if change == "a source":
        os.utime(path / "loop.py", (100, 100))
    else:
        monkeypatch.setattr(compiled, "compiler", lambda: "numba 0.1, Python 3.8.0")
    assert not is_compiled("ground", folder=path)
    compile_kernels("ground", folder=path)
    assert not caller.exists()
    assert started[len(ALL) :] == ["ground"]
    assert not is_compiled(folder=path)


def test_what_does_not_compile_is_told_and_tried_again(folder):
    path, started = folder
    started.append("broken")
    assert not compile_kernels(folder=path)
    assert is_compiled(*SLAM[:2], folder=path)
    assert not is_compiled("loops", folder=path)
    started.remove("broken")
    assert compile_kernels(folder=path)
    assert started[-1] == "loops"


@pytest.mark.parametrize(
    ("line", "groups"),
    [
        (["explore", "--base", "kobuki"], DRIVE),
        (["explore", "--world", "lab"], (*DRIVE, "emulation")),
        (["explore", "--fast"], ()),
        (["replay", "{hallway}"], SLAM),
        (["replay", "{hallway}", "--map"], (*SLAM, "surfaces")),
        (["replay", "{hallway}", "--map", "--ros"], SLAM),
    ],
)
def test_a_command_waits_for_what_it_needs(line, groups, monkeypatch):
    if line[0] == "explore" and "--fast" not in line:
        pytest.importorskip("rospy")
    asked = []

    def compile_kernels(*names):
        asked.append(names)
        raise KeyboardInterrupt

    monkeypatch.setattr(f"vsx_ros.cli.{line[0]}.compile_kernels", compile_kernels)
    assert execute([word.format(hallway=HALLWAY) for word in line]) == STOPPED
    assert asked == [groups]


@pytest.mark.parametrize("cores", [1, 2, 4, 64])
def test_the_cores_share_the_work(cores):
    shares = compiled._shares(list(ALL), cores)
    assert len(shares) == min(cores, len(ALL))
    assert sorted(sum(shares, [])) == sorted(ALL)
    work = [sum(compiled._COSTS[group] for group in share) for share in shares]
    assert max(work) <= max(1.2 * sum(work) / len(work), max(compiled._COSTS.values()))


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_who_is_stopped_while_compiling_leaves_no_compiler_behind(tmp_path, number):
    """A program of its own: the signal must end it in one sentence, and its compilers with it."""
    (tmp_path / "loop.py").write_text("")
    program = (
        "import subprocess, sys\nfrom pathlib import Path\nfrom vsx_ros.cli import compiled, main\n"
        "def start(groups):\n"
        "    words = ['sh', '-c', 'sleep 600 & sleep 600']\n"
        "    one = subprocess.Popen(words, start_new_session=True, stdout=subprocess.PIPE)\n"
        "    compiled.os.set_blocking(one.stdout.fileno(), False)\n"
        "    return one\n"
        "def told(process, _said=compiled._said):\n"
        "    print(process.pid, flush=True)\n    return _said(process)\n"
        "compiled._started, compiled._said = start, told\ncompiled._shares = lambda groups, cores: [groups]\n"
        f"main.run = lambda _: compiled.compile_kernels(folder=Path({str(tmp_path)!r}))\n"
        "sys.exit(main.execute(['config']))\n"
    )
    pipe = subprocess.PIPE
    with subprocess.Popen([sys.executable, "-c", program], stdout=pipe, stderr=pipe, text=True) as running:
        group = int(running.stdout.readline())
        running.send_signal(number)
        said = running.communicate(timeout=120.0)[1]
    assert running.returncode == STOPPED
    assert "stopped by the operator" in said
    assert "Traceback" not in said
    states = [path.read_text().rpartition(")")[2].split() for path in Path("/proc").glob("[0-9]*/stat")]
    assert [state for state in states if int(state[2]) == group and state[0] != "Z"] == []
