"""Kinds by name, and modules of users that add some."""

from pathlib import Path

import pytest

from vsx_ros.config import Config, overridden
from vsx_ros.errors import ConfigError
from vsx_ros.exploration.view_selector import ViewSelector
from vsx_ros.registry import PLUGINS, Registry, load_plugins


def test_a_name_that_nobody_added_is_told_with_those_there_are() -> None:
    kinds = Registry("camera", {"kinect": 1, "v4l": 2})
    kinds.add("mine", 3)
    assert kinds["mine"] == 3
    assert list(kinds) == ["kinect", "v4l", "mine"]
    with pytest.raises(ConfigError, match=r"named 'kinekt' \(did you mean 'kinect'\?\); give one of kinect, v4l, mine"):
        kinds["kinekt"]
    with pytest.raises(ConfigError, match="already"):
        kinds.add("v4l", 4)
    with pytest.raises(ConfigError, match=r"the base 'mine' is added as 1.5; give int\(\.\.\.\), see docs"):
        Registry("base", {"kobuki": 1}, int).add("mine", 1.5)


def test_a_plugin_that_cannot_be_imported_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(PLUGINS, "no_such_module")
    with pytest.raises(ConfigError, match=r"'no_such_module' named in VSX_PLUGINS.*PYTHONPATH"):
        load_plugins()


def test_a_ranker_of_a_user_s_module_is_found_by_name(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "my_ranker.py").write_text(
        "from vsx_ros.exploration.utility import RANKERS, Ranking\n"
        "def nothing(asked):\n"
        "    return Ranking([], {})\n"
        "RANKERS.add('nothing', nothing)\n"
    )
    config = overridden(Config(), {"exploration.ranker": "nothing"})
    with pytest.raises(ConfigError, match="no view ranker named 'nothing'"):
        ViewSelector(config, lambda start, grid, clearance_m, poses: poses[:, 0])
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.setenv(PLUGINS, "my_ranker")
    load_plugins()
    ViewSelector(config, lambda start, grid, clearance_m, poses: poses[:, 0])
