"""Kinds of things by name: bases, cameras, planners, view rankers. A user's module adds its own on import.

``VSX_PLUGINS=my_base,my_ranker vsx explore --base mine``: the modules are imported by the command and by every node
before the first name is looked up (docs/how-to/extend.md)."""

import importlib
import os
from collections.abc import Iterator
from types import ModuleType
from typing import TypeVar

from vsx_ros.errors import ConfigError, did_you_mean

PLUGINS = "VSX_PLUGINS"  # Environment variable: modules to import, separated by commas

T = TypeVar("T")


class Registry(dict[str, T]):
    """Entries by name. what: the kind of entry, for error messages. kind: the type of all entries, if it is one."""

    def __init__(self, what: str, entries: dict[str, T], kind: type = object) -> None:
        super().__init__(entries)
        self._what, self._kind = what, kind

    def add(self, name: str, entry: T) -> None:
        """Add an entry. Raises ConfigError for a name that is taken, and for an entry of another type."""
        if name in self:
            raise ConfigError(f"there is a {self._what} named {name!r} already; give this one another name")
        if not isinstance(entry, self._kind):
            kind = self._kind.__name__
            raise ConfigError(
                f"the {self._what} {name!r} is added as {entry!r}; give {kind}(...), see docs/how-to/extend.md"
            )
        self[name] = entry

    def __missing__(self, name: str) -> T:
        near = did_you_mean(name, self)
        raise ConfigError(f"there is no {self._what} named {name!r}{near}; give one of {', '.join(self)}")


class Kinds:
    """Choices of a command-line option: the names in a registry, compared with the word before a colon, and the names
    that plug-ins add. The registry is imported when a word is checked, because help must be quick."""

    def __init__(self, registry: str, *more: str) -> None:
        """registry: MODULE:NAME. more: names that are not in it."""
        self._registry, self._more = registry, more

    def __iter__(self) -> Iterator[str]:
        module, _, name = self._registry.partition(":")
        return iter([*getattr(importlib.import_module(module), name), *self._more])

    def __contains__(self, word: object) -> bool:
        return bool(os.environ.get(PLUGINS)) or str(word).partition(":")[0] in iter(self)


def load_plugins() -> list[ModuleType]:
    """Import the modules in ``VSX_PLUGINS``. Raises ConfigError for a module that cannot be imported."""
    modules = []
    for module in filter(None, (name.strip() for name in os.environ.get(PLUGINS, "").split(","))):
        try:
            modules.append(importlib.import_module(module))
        except Exception as error:
            raise ConfigError(
                f"the module {module!r} named in {PLUGINS} cannot be imported ({type(error).__name__}: {error}); "
                "add its folder to PYTHONPATH, or leave it out"
            ) from error
    return modules
