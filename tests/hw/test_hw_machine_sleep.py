"""The machine is kept awake while a base is driven."""

import logging
import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from waiting import wait_for

from vsx_hw.machine_sleep import SleepWatch, asleep_ns, keep_awake

INHIBITOR = """#!/bin/sh
echo "$@" > {folder}/asked
while [ "${{1#--}}" != "$1" ]; do shift; done
"$@"
touch {folder}/ended
"""
REFUSAL = """#!/bin/sh
echo "Failed to inhibit: Access denied" >&2
exit 1
"""
NODE = "import sys, time; from vsx_hw.machine_sleep import keep_awake; keep_awake(sys.argv[1]); time.sleep(600)"


def install(folder: Path, script: str, monkeypatch: pytest.MonkeyPatch) -> None:
    program = folder / "systemd-inhibit"
    program.write_text(script.format(folder=folder))
    program.chmod(0o755)
    monkeypatch.setenv("PATH", f"{folder}{os.pathsep}{os.environ['PATH']}")


@pytest.mark.parametrize("end", [signal.SIGKILL, signal.SIGTERM])
def test_the_machine_is_kept_awake_as_long_as_the_node_lives(
    end: signal.Signals, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    install(tmp_path, INHIBITOR, monkeypatch)
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(p for p in sys.path if p)}
    with subprocess.Popen([sys.executable, "-c", NODE, str(tmp_path / "ttyUSB0")], env=environment) as node:
        try:
            asked = wait_for(lambda: (tmp_path / "asked").exists() and (tmp_path / "asked").read_text())
            assert "--what=sleep:idle:handle-lid-switch --mode=block " in asked
            assert not (tmp_path / "ended").exists()
        finally:
            node.send_signal(end)
    wait_for(lambda: (tmp_path / "ended").exists(), "the inhibitor to end with the node")


@pytest.mark.parametrize(("script", "reason"), [(REFUSAL, "Access denied"), ("", "systemd-inhibit")])
def test_who_may_not_keep_the_machine_awake_says_so_with_the_remedy(
    script: str, reason: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    if script:
        install(tmp_path, script, monkeypatch)
    else:
        monkeypatch.setenv("PATH", str(tmp_path))
    keep_awake(str(tmp_path / "ttyUSB0"))
    (told,) = wait_for(lambda: list(caplog.records))
    assert told.levelno == logging.WARNING
    assert reason in told.getMessage()
    assert "HandleLidSwitch=ignore in /etc/systemd/logind.conf" in told.getMessage()


def test_an_emulated_base_keeps_nobody_awake(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("vsx_hw.machine_sleep.threading.Thread", lambda **_: pytest.fail("it does"))
    (tmp_path / "ttyUSB0").symlink_to("/dev/pts/0")
    keep_awake(str(tmp_path / "ttyUSB0"))


def test_a_sleep_is_told_once_and_reading_two_clocks_is_none() -> None:
    slept_ns = [5_000_000_000]
    watch = SleepWatch(lambda: slept_ns[0])
    assert watch.slept_s() == 0.0
    slept_ns[0] += 1_000_000
    assert watch.slept_s() == 0.0
    slept_ns[0] += 2_500_000_000
    assert watch.slept_s() == 2.5
    assert watch.slept_s() == 0.0


def test_a_machine_that_is_awake_does_not_sleep() -> None:
    watch, before_ns = SleepWatch(), asleep_ns()
    assert before_ns >= -1_000_000
    assert [watch.slept_s() for _ in range(1000)] == [0.0] * 1000
