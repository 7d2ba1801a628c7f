"""The scene of a generated world in the light of a moment."""

import math

import numpy as np
from numpy.typing import NDArray

from vsx_ros.arrays import Float32Array
from vsx_ros.kernels.sim.raycast_cull import Scene
from vsx_ros.sim.light_map import LIGHT_SPACING_M, Nodes, Window, irradiance, nodes_of, pack_light, sunlight
from vsx_ros.sim.lighting import Lighting, circuits_on, sunbeam, times_switched
from vsx_ros.sim.scene import compile_scene, light_scale, quads
from vsx_ros.sim.world import Light, World

SUNNY_SPACING_M = 0.08  # between the nodes, to show the edges of patches of sunlight
SUN_STEP_S = 2.0  # patches move a millimetre or two meanwhile
WINDOW_M, SILL_M = (1.2, 1.2), 0.9  # width and height; height of the lower edge
DAYLIGHT_IN_M = 0.4  # a window shines like a lamp so far inside of it


class ChangingScene:
    """``at`` gives the scene of a moment; the same object until the light changes."""

    def __init__(self, world: World, lighting: Lighting) -> None:
        """Takes about two seconds. Raises ConfigError for a world that is too large."""
        self._lighting = lighting
        self.windows = windows_of(world, lighting)
        sunny = bool(self.windows) and lighting.sun > 0.0
        self._scene = compile_scene(world, SUNNY_SPACING_M if sunny else LIGHT_SPACING_M)
        self._nodes = [
            nodes_of(quad.corner, quad.edge_u, quad.edge_v, (int(place[3]), int(place[4])))
            for quad, place in zip(quads(world), self._scene.places)
        ]
        circuits = circuits_of(world.lights, lighting.circuits)
        lamps = [Light(x=x, y=y, z=z, strength=lighting.daylight) for x, y, z in _insides(self.windows)]
        steady = self._layer(lamps, lighting.ambient * world.ambient)
        self._layers = [steady, *(self._layer(circuit, 0.0) for circuit in circuits)]
        self._moment = (-1, -1)

    def at(self, stamp_ns: int) -> Scene:
        """The scene in the light of that moment."""
        time_s, sunny = 1e-9 * stamp_ns, bool(self.windows) and self._lighting.sun > 0.0
        moment = times_switched(self._lighting, time_s), int(time_s / SUN_STEP_S) if sunny else 0
        if moment != self._moment:
            self._moment = moment
            self._scene = self._lit(moment[0], moment[1] * SUN_STEP_S if sunny else None)
        return self._scene

    def _layer(self, lamps: list[Light], ambient: float) -> list[Float32Array]:
        return [irradiance(nodes, lamps, ambient).astype(np.float32) for nodes in self._nodes]

    def _lit(self, switched: int, sun_s: float | None) -> Scene:
        on = [True, *circuits_on(self._lighting, switched)]
        factors = [1.0, *[self._lighting.lamps] * self._lighting.circuits]
        surfaces, maps = self._scene.surfaces.copy(), []
        for k, nodes in enumerate(self._nodes):
            light = np.asarray(sum(f * layer[k] for f, layer, lit in zip(factors, self._layers, on) if lit), float)
            if sun_s is not None:
                light = light + self._sun(nodes, sun_s)
            surfaces[k, 4] = light_scale(light) / 255.0 / 255.0
            maps.append(pack_light(light, light_scale(light)))
        return self._scene._replace(surfaces=surfaces, light=np.concatenate(maps))

    def _sun(self, nodes: Nodes, time_s: float) -> NDArray[np.float64]:
        inwards = self.windows[0].inwards
        beam = sunbeam(self._lighting, math.atan2(inwards[1], inwards[0]), time_s)
        return self._lighting.sun * sunlight(nodes, self.windows, beam)


def circuits_of(lamps: list[Light], circuits: int) -> list[list[Light]]:
    """The lamps of each circuit: rows across the building."""
    order = sorted(range(len(lamps)), key=lambda k: (lamps[k].x, lamps[k].y))
    return [[lamps[int(k)] for k in part] for part in np.array_split(np.array(order, np.int64), circuits)]


def windows_of(world: World, lighting: Lighting) -> list[Window]:
    """Windows in the outer walls, at places drawn by seed; none where walls are too short."""
    rng, (width, height) = np.random.default_rng([lighting.seed, 13]), WINDOW_M
    ends = np.array([(*a, *b) for o in world.outlines for a, b in zip(o.points, [*o.points[1:], o.points[0]])])
    length = np.hypot(ends[:, 2] - ends[:, 0], ends[:, 3] - ends[:, 1])
    if not (length > width).any():
        return []
    shares = np.where(length > width, length, 0.0)
    found = []
    for k in rng.choice(len(ends), lighting.windows, p=shares / shares.sum()):
        along = np.array([*(ends[k, 2:] - ends[k, :2]) / length[k], 0.0])
        at = rng.uniform(0.5 * width, length[k] - 0.5 * width)
        middle = np.array([*ends[k, :2], SILL_M + 0.5 * height]) + at * along
        found.append(Window(middle, along, np.array([-along[1], along[0], 0.0]), WINDOW_M))
    return found


def _insides(windows: list[Window]) -> list[tuple[float, float, float]]:
    places = [window.middle + DAYLIGHT_IN_M * window.inwards for window in windows]
    return [(float(x), float(y), float(z)) for x, y, z in places]
