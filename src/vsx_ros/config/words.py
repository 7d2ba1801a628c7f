"""What is wrong with a parameter, in words."""

import re
from collections.abc import Iterable
from typing import Any

import msgspec
from msgspec.inspect import BoolType, FloatType, IntType, StrType

from vsx_ros.errors import did_you_mean

_KINDS: dict[Any, str] = {
    BoolType: "true or false", StrType: "a word", IntType: "a whole number", FloatType: "a number",
}  # fmt: skip
_SIGNS = (("above", "gt"), ("of at least", "ge"), ("below", "lt"), ("of at most", "le"))


def in_words(struct: type, known: Iterable[str], tree: Any, message: str) -> str:
    """A message of msgspec in words: the entry, its value, and what to give. struct: what the tree was to become.
    known: all names of parameters."""
    names = [name for name in message.partition(" - at `$")[2].rstrip("`").split(".") if name]
    if unknown := re.search("unknown field `(.*?)`", message):
        return no_parameter(".".join([*names, unknown[1]]), known)
    kind: Any = msgspec.inspect.type_info(struct)
    for name in names:
        kind, tree = next(field.type for field in kind.fields if field.name == name), tree[name]
    return f"{'.'.join(names) or 'the whole'} is {tree!r:.80}; give {_asked(kind)}; 'vsx config' prints every default"


def no_parameter(name: str, known: Iterable[str]) -> str:
    """That there is none of this name, and the one that resembles it."""
    return f"there is no parameter {name!r:.80}{did_you_mean(name, known)}; 'vsx config' prints every name"


def _asked(kind: Any) -> str:
    """What a value of this type is, e.g. "a number from 0.01 to 0.7"."""
    if type(kind) not in _KINDS:
        return "a tree of names and values"
    low, high = getattr(kind, "ge", None), getattr(kind, "le", None)
    if low is not None and high is not None:
        return f"{_KINDS[type(kind)]} from {low:g} to {high:g}"
    limits = [f"{sign} {getattr(kind, name):g}" for sign, name in _SIGNS if getattr(kind, name, None) is not None]
    return " ".join([_KINDS[type(kind)], " and ".join(limits)]).strip()
