"""config.yaml of a run folder. A part of it is not used: the limits that it lacks would be the default ones."""

from collections.abc import Mapping
from typing import Any

import yaml

from vsx_ros.limits import yaml_tree

_FIRST, _LAST = "---", "..."  # around a document, which is then known to be whole
_LAST_ONCE = "    plan_ms_m: "  # the last parameter in files of older versions, which lack both


def config_text(tree: Mapping[str, Any]) -> str:
    """The file's text."""
    return str(yaml.safe_dump(dict(tree), sort_keys=False, explicit_start=True, explicit_end=True))


def config_tree(text: str) -> dict[str, Any]:
    """The inverse. Raises ValueError for what is no such file, and for a file cut short."""
    tree, lines = yaml_tree(text), text.rstrip().splitlines()
    if not isinstance(tree, dict) or "config" not in tree:
        raise ValueError("it holds no configuration")
    if not (lines[-1] == _LAST if lines[0] == _FIRST else lines[-1].startswith(_LAST_ONCE)):
        raise ValueError("it is cut short")
    return tree
