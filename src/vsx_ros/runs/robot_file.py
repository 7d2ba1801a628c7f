"""The robot's own file of parameters: what calibrations found, for ``--config`` and ``config:=``."""

import os
import sys
from pathlib import Path
from typing import Any

import yaml

from vsx_ros.config import from_dict
from vsx_ros.errors import ConfigError, explained
from vsx_ros.io.atomic import write_text
from vsx_ros.limits import file_text, yaml_tree


def ros_home() -> Path:
    """Where ROS keeps what belongs to this machine."""
    return Path(os.environ.get("ROS_HOME") or Path.home() / ".ros")


def default_robot_file() -> Path:
    """Where a robot's parameters go when nobody says otherwise."""
    return ros_home() / "vsx_ros" / "robot.yaml"


def robot_file_here() -> Path | None:
    """The file of the robot that this machine belongs to, which is said on stderr; None where there is none."""
    file = default_robot_file()
    if not file.exists():
        return None
    print(f"vsx: this robot's own parameters: {file}", file=sys.stderr)
    return file


def update_robot_file(path: Path, branch: str, values: dict[str, float], remark: str) -> None:
    """Replace entries of ``robot.BRANCH`` in the file; the rest of it stays, each branch with its remark on top. Raises
    ConfigError when what is there holds no parameters, or the file cannot be written."""
    remarks, tree = _known(path)
    robot = tree.setdefault("robot", {})
    robot[branch] = {**robot.get(branch, {}), **values}
    from_dict(tree)
    kept = [line for line in remarks if not line.startswith(f"# {branch}: ")]
    text = "\n".join([*kept, f"# {branch}: {remark}", yaml.safe_dump(tree, sort_keys=False)])
    with explained(ConfigError, f"{path} cannot be written", "give another file with --out", OSError):
        path.parent.mkdir(parents=True, exist_ok=True)
        write_text(path, text)


def _known(path: Path) -> tuple[list[str], dict[str, Any]]:
    """The remarks on top of the file and its tree; nothing where there is none."""
    if not path.exists():
        return [], {}
    with explained(ConfigError, f"{path} cannot be read", "give another file with --out"):
        text = file_text(path)
        tree = yaml_tree(text) or {}
    from_dict(tree)
    return [line for line in text.splitlines() if line.startswith("# ")], tree
