"""Entries of the configuration that may be changed while a node runs, by any client of dynamic_reconfigure."""

import math
from collections.abc import Callable, Sequence
from types import SimpleNamespace
from typing import Any, NamedTuple

import rospy
from dynamic_reconfigure.encoding import Config as Values
from dynamic_reconfigure.server import Server

from vsx_ros.config import Config, overridden
from vsx_ros.errors import ConfigError


class Adjustable(NamedTuple):
    """One number. entry: its dotted name in the configuration; value: as configured."""

    entry: str
    value: float
    low: float
    high: float
    meaning: str

    @property
    def name(self) -> str:
        """What clients call it, and the private parameter that remembers it across a restart of the node."""
        return self.entry.rpartition(".")[2]


def adjustable_of_plans(config: Config) -> list[Adjustable]:
    """What move_base lets be changed for the plans to come: slower than configured, but never faster."""
    v, omega, phi = config.limits.v_m_s, config.limits.omega_rad_s, config.planner.phi_rad_m
    return [
        Adjustable("limits.v_m_s", v, 0.05, v, "speed [m/s]"),
        Adjustable("limits.omega_rad_s", omega, 0.1, omega, "turn rate [rad/s]"),
        Adjustable("planner.phi_rad_m", phi, 0.1, 10.0, "bound on the change of view per metre [rad/m]"),
    ]


def serve_adjustable(config: Config, on_change: Callable[[Config], None]) -> Server:
    """Services: ~set_parameters. Publishers: ~parameter_descriptions, ~parameter_updates (latched).

    ``on_change`` gets the whole configuration, on a thread of its own: at once when a private parameter was set
    before, and whenever a client asks. Values beyond the bounds are clamped. Raises ConfigError for a private
    parameter that is no number.
    """
    numbers = adjustable_of_plans(config)
    applied = {number.name: number.value for number in numbers}
    for number in numbers:
        _check_stored(number)

    def change(values: Any, _: int) -> Any:
        wanted = {number.name: float(values[number.name]) for number in numbers}
        if wanted != applied:
            applied.update(wanted)
            on_change(overridden(config, {number.entry: wanted[number.name] for number in numbers}))
            rospy.loginfo("from now on %s", ", ".join(f"{name} = {value:g}" for name, value in wanted.items()))
        values.update(wanted)
        return values

    return Server(_described(numbers), change)


def _check_stored(number: Adjustable) -> None:
    stored: Any = rospy.get_param(f"~{number.name}", None)
    if stored is None:
        return
    if type(stored) not in (int, float) or not math.isfinite(stored):
        name = rospy.resolve_name(f"~{number.name}")
        raise ConfigError(f"parameter {name} is {stored!r}; give a number from {number.low:g} to {number.high:g}")
    rospy.set_param(f"~{number.name}", float(stored))


def _described(numbers: Sequence[Adjustable]) -> SimpleNamespace:
    """What a module generated from a .cfg file would hold."""
    parameters = [
        {"name": number.name, "type": "double", "level": 1, "description": number.meaning, "edit_method": ""}
        for number in numbers
    ]
    group = {"name": "Default", "type": "", "id": 0, "parent": 0, "parameters": parameters, "groups": []}
    return SimpleNamespace(
        config_description=group,
        defaults=Values({number.name: number.value for number in numbers}),
        min=Values({number.name: number.low for number in numbers}),
        max=Values({number.name: number.high for number in numbers}),
    )
