"""Which Mitsuba is used, and what is said when there is none; without Mitsuba itself."""

import importlib.util

import pytest

from vsx_ros.cli.main import execute
from vsx_ros.errors import ConfigError
from vsx_ros.sim import mitsuba_variant
from vsx_ros.sim.mitsuba_variant import FAST, PLAIN

DIES = "import os, signal; os.kill(os.getpid(), signal.SIGSEGV)"
DIES_IF_FAST = f"import sys\nif sys.argv[1] == {FAST!r}: {DIES}"


@pytest.fixture(autouse=True)
def without_library(monkeypatch):
    monkeypatch.delenv("DRJIT_LIBLLVM_PATH", raising=False)
    mitsuba_variant.mitsuba.cache_clear()
    yield
    mitsuba_variant.mitsuba.cache_clear()


def test_a_missing_mitsuba_is_told_in_one_sentence(monkeypatch, capsys, tmp_path):
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    assert execute(["explore", "--fast", "--eye", "mitsuba", "--out", str(tmp_path / "run")]) == 1
    said = capsys.readouterr().err
    assert "pip install 'vsx_ros[mitsuba]'" in said
    assert said.count("\n") == 1
    assert not (tmp_path / "run").exists()


def test_an_eye_needs_lock_step(capsys):
    assert execute(["explore", "--world", "lab", "--eye", "mitsuba"]) == 1
    assert "add --fast" in capsys.readouterr().err


def test_a_library_that_kills_the_process_is_passed_over(monkeypatch):
    monkeypatch.setattr(mitsuba_variant, "libraries", lambda: ["libLLVM-15.so", "libLLVM-14.so"])
    monkeypatch.setattr(mitsuba_variant, "_PROBE", DIES_IF_FAST)
    assert mitsuba_variant._working() == (PLAIN, "")
    monkeypatch.setattr(mitsuba_variant, "_PROBE", "")
    assert mitsuba_variant._working() == (FAST, "libLLVM-15.so")


def test_a_library_that_was_named_and_dies_is_told(monkeypatch):
    monkeypatch.setenv("DRJIT_LIBLLVM_PATH", "libLLVM-15.so")
    monkeypatch.setattr(mitsuba_variant, "_PROBE", DIES)
    with pytest.raises(ConfigError, match=r"DRJIT_LIBLLVM_PATH libLLVM-15.so.*signal 11.*version 19"):
        mitsuba_variant._working()


def test_a_mitsuba_that_draws_nothing_is_told(monkeypatch):
    monkeypatch.setattr(mitsuba_variant, "libraries", list)
    monkeypatch.setattr(mitsuba_variant, "_PROBE", "raise SystemError('no processor')")
    with pytest.raises(ConfigError, match="draws nothing: SystemError: no processor"):
        mitsuba_variant._working()
