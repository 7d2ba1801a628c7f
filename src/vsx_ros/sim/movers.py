"""The movers that a world's hard things ask for."""

from collections.abc import Callable, Sequence

import numpy as np

from vsx_ros.sim.chairs import chairs
from vsx_ros.sim.doors import Door, doors
from vsx_ros.sim.emulated_world import EmulatedWorld
from vsx_ros.sim.moving import Mover
from vsx_ros.sim.people import people
from vsx_ros.sim.world import World


def _doors(world: EmulatedWorld, number: int, rng: np.random.Generator, _: Sequence[Door]) -> Sequence[Mover]:
    assert isinstance(world, World)  # others are refused where they are named
    return doors(world, number, rng)


MAKERS: dict[str, Callable[[EmulatedWorld, int, np.random.Generator, Sequence[Door]], Sequence[Mover]]] = {
    "doors": _doors, "chairs": chairs, "people": people,
}  # fmt: skip


def movers_of(world: EmulatedWorld, seed: int) -> list[Mover]:
    """All of them, by the run's seed; none in a world that names none."""
    movers: list[Mover] = []
    for child, (name, make) in enumerate(MAKERS.items()):
        if name in world.hard:
            hung = [mover for mover in movers if isinstance(mover, Door)]
            movers += make(world, round(world.hard[name]), np.random.default_rng([seed, 403, child]), hung)
    return movers
