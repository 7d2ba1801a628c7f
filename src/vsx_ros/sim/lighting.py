"""Light that is not the steady light of all lamps: what a world file says of it, named kinds of light, and which lamps
burn and where the sun stands at a moment. The same seed gives the same light."""

import math
from typing import Annotated

import numpy as np
from msgspec import Meta, Struct
from msgspec.structs import replace

from vsx_ros.arrays import BoolArray, FloatArray
from vsx_ros.errors import ConfigError, did_you_mean

Factor = Annotated[float, Meta(ge=0, le=10)]
Strength = Annotated[float, Meta(ge=0, le=100)]
SUN_ELEVATION_RAD = math.radians(32.0)  # of an afternoon; shines 3 m into a room
SUN_ASIDE_RAD = 0.5  # at most, at the beginning, from straight into the first window


class Lighting(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """The light of a world. lamps, ambient: factors on the strength of the lamps and of the light from everywhere.
    circuits: neighbouring lamps are switched together; lit: share of the circuits that are on at the beginning; then
    one is switched, on or off, at even intervals (switches_per_min), but one always stays on. windows: their number;
    each gives the strength ``daylight``, as a lamp does. sun: irradiance of sunlight, head on, through the windows; its
    patches wander as the sun turns. Strengths in units of full-scale reflectance."""

    seed: Annotated[int, Meta(ge=0)] = 0
    lamps: Factor = 1.0
    ambient: Factor = 1.0
    circuits: Annotated[int, Meta(ge=1, le=16)] = 4
    lit: Annotated[float, Meta(ge=0, le=1)] = 1.0
    switches_per_min: Annotated[float, Meta(ge=0, le=60)] = 0.0
    windows: Annotated[int, Meta(ge=0, le=20)] = 0
    daylight: Strength = 0.0
    sun: Strength = 0.0
    sun_deg_per_min: Annotated[float, Meta(ge=-60, le=60)] = 0.0


LIGHTS = {
    "switched": Lighting(lit=0.75, switches_per_min=1.0),
    "day": Lighting(lamps=0.0, ambient=0.7, windows=3, daylight=2.5, sun=1.5, sun_deg_per_min=1.0),
    "sun": Lighting(windows=3, sun=2.0, sun_deg_per_min=10.0),
    "evening": Lighting(lamps=0.5, ambient=0.3),
    "half": Lighting(lit=0.5),
    "night": Lighting(lit=0.25, ambient=0.15),
    "dim": Lighting(lamps=0.1, ambient=0.1),
}
"""Kinds of light by name: the world lab:night is a lab by night."""


def light_named(name: str, seed: int) -> Lighting:
    """One of ``LIGHTS``, with circuits, windows and sun by seed. Raises ConfigError for an unknown name."""
    if name not in LIGHTS:
        raise ConfigError(f"there is no light {name!r}; choose one of {', '.join(LIGHTS)}{did_you_mean(name, LIGHTS)}")
    return replace(LIGHTS[name], seed=seed)


def circuits_on(lighting: Lighting, switched: int) -> BoolArray:
    """(circuits,) which are on after so many have been switched."""
    count, rng = lighting.circuits, np.random.default_rng([lighting.seed, 11])
    on = np.zeros(count, np.bool_)
    on[rng.permutation(count)[: round(lighting.lit * count)]] = True
    for _ in range(switched):
        chosen = int(rng.integers(count))
        on[chosen] = not on[chosen]
        if not on.any():
            on[(chosen + 1) % count] = True
    return on


def times_switched(lighting: Lighting, time_s: float) -> int:
    """How often a circuit has been switched until then."""
    return int(time_s * lighting.switches_per_min / 60.0)


def sunbeam(lighting: Lighting, into_first_window_rad: float, time_s: float) -> FloatArray:
    """(3,) unit vector in which sunlight travels. into_first_window_rad: yaw of that window's view into the room."""
    aside = float(np.random.default_rng([lighting.seed, 12]).uniform(-SUN_ASIDE_RAD, SUN_ASIDE_RAD))
    yaw = into_first_window_rad + aside + math.radians(lighting.sun_deg_per_min) * time_s / 60.0
    level = math.cos(SUN_ELEVATION_RAD)
    return np.array([level * math.cos(yaw), level * math.sin(yaw), -math.sin(SUN_ELEVATION_RAD)])
