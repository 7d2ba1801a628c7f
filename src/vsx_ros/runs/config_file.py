"""config.yaml of a run folder. A part of it is not used: the limits that it lacks would be the default ones."""

import os
from collections.abc import Mapping
from typing import Any

import yaml

from vsx_ros.limits import yaml_tree

_FIRST, _LAST = "---", "..."  # around a document, which is then known to be whole
_LAST_ONCE = "    plan_ms_m: "  # the last parameter in files of older versions, which lack both


def config_text(tree: Mapping[str, Any]) -> str:
    """The file's text; names that are not UTF-8 are kept as bytes, for which YAML has a type."""
    stored = {name: _stored(value) for name, value in tree.items()}
    return str(yaml.safe_dump(stored, sort_keys=False, explicit_start=True, explicit_end=True))


def config_tree(text: str) -> dict[str, Any]:
    """The inverse. Raises ValueError for what is no such file, and for a file cut short."""
    tree, lines = yaml_tree(text), text.rstrip().splitlines()
    if not isinstance(tree, dict) or "config" not in tree:
        raise ValueError("it holds no configuration")
    if not (lines[-1] == _LAST if lines[0] == _FIRST else lines[-1].startswith(_LAST_ONCE)):
        raise ValueError("it is cut short")
    return {name: os.fsdecode(value) if isinstance(value, bytes) else value for name, value in tree.items()}


def _stored(value: Any) -> Any:
    name = os.fsencode(value) if isinstance(value, str) else b""
    try:
        name.decode("utf-8")
    except UnicodeDecodeError:
        return name
    return value
