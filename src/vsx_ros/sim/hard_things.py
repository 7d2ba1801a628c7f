"""Hard things: what makes a building hard for a robot with one camera. Each has a name, an amount and bounds, and is
off unless a world names it under ``hard:`` or a command with ``--with``."""

from collections.abc import Iterable, Mapping
from typing import NamedTuple

from vsx_ros.errors import ConfigError
from vsx_ros.registry import Registry


class HardThing(NamedTuple):
    """unit and bounds of its amount. usual: the amount if only the name is given. generated: it needs a building that a
    generator has made; others go with Gazebo's files, too."""

    unit: str
    bounds: tuple[float, float]
    usual: float
    about: str
    generated: bool = False


HARD_THINGS: Registry[HardThing] = Registry(
    "hard thing",
    {
        "white-walls": HardThing("share", (0.0, 1.0), 1.0, "walls that are white, without pictures", generated=True),
        "repeated-texture": HardThing("m", (0.3, 5.0), 1.0, "period of the one pattern on all walls", generated=True),
        "thin-legs": HardThing("cm", (0.5, 5.0), 1.5, "tables with such legs, also for plain boxes", generated=True),
        "glossy-floor": HardThing("share", (0.01, 0.9), 0.15, "light that the floor mirrors", generated=True),
        "glass-walls": HardThing("share", (0.0, 1.0), 1.0, "free-standing walls of glass", generated=True),
        "mirrors": HardThing("mirrors", (1, 50), 3, "in place of pictures", generated=True),
        "windows": HardThing("windows", (1, 50), 3, "before a bright outside, in place of pictures", generated=True),
        "people": HardThing("people", (1, 20), 3, "walk about; half of them stop before the robot"),
        "doors": HardThing("doors", (1, 20), 1, "open and close", generated=True),
        "chairs": HardThing("chairs", (1, 20), 3, "are moved while the robot does not look"),
        "robot-error": HardThing("times", (0.0, 3.0), 1.0, "usual errors of mount, wheels, gyro, shutter and noise"),
        "sticky-wheel": HardThing("s", (1.0, 600.0), 20.0, "until a wheel sticks for a moment, on average"),
        "dropped-frames": HardThing("%", (0.0, 50.0), 3.0, "images that are lost"),
        "latency": HardThing("ms", (0.0, 1000.0), 150.0, "from an image to the stack that sees it"),
        "fingerprints": HardThing("share", (0.0, 0.9), 0.3, "smeared part of the lens"),
    },
)


def checked_things(things: Mapping[str, float], where: str) -> dict[str, float]:
    """The amounts by name; zero takes away what a world has. where: what names them, for messages. Raises ConfigError
    for an unknown name or an amount outside its bounds."""
    for name, amount in things.items():
        low, high = HARD_THINGS[name].bounds
        if amount != 0.0 and not low <= amount <= high:
            bounds = f"{low:g} to {high:g} {HARD_THINGS[name].unit}"
            raise ConfigError(f"{where}: {name} is {amount:g}; give {bounds}, or leave it out")
    return {name: float(amount) for name, amount in things.items()}


def named_things(words: Iterable[str], where: str) -> dict[str, float]:
    """The amounts by name of words NAME or NAME=AMOUNT, several of them with commas between. Raises ConfigError as
    ``checked_things``, and for an amount that is no number."""
    things: dict[str, float] = {}
    for word in (part.strip() for text in words for part in text.split(",") if part.strip()):
        name, equals, amount = word.partition("=")
        try:
            things[name] = float(amount) if equals else HARD_THINGS[name].usual
        except ValueError as error:
            if isinstance(error, ConfigError):
                raise
            raise ConfigError(f"{where} {word}: the amount is no number; write {name}=AMOUNT or {name}") from None
    return checked_things(things, where)
