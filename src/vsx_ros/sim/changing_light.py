"""The light of a generated world that does not burn steadily, and the scene in the light of a moment."""

import math

import numpy as np
from msgspec.structs import replace

from vsx_ros.arrays import Float32Array
from vsx_ros.kernels.sim.raycast_cull import Scene
from vsx_ros.sim.light_map import LIGHT_SPACING_M, Lights, Window, nodes_of, pack_light, sunlight
from vsx_ros.sim.lighting import Lighting, circuits_on, sunbeam, times_switched
from vsx_ros.sim.scene import glows, light_scale, quads
from vsx_ros.sim.world import Light, World

SUNNY_SPACING_M = 0.08  # between the nodes, to show the edges of patches of sunlight
SUN_STEP_S = 2.0  # patches move a millimetre or two meanwhile
WINDOW_M, SILL_M = (1.2, 1.2), 0.9  # width and height; height of the lower edge
DAYLIGHT_IN_M = 0.4  # a window shines like a lamp so far inside of it


class ChangingLight:
    """``at`` gives the light of a moment and the scene in it; the same objects until the light changes."""

    def __init__(self, world: World, lighting: Lighting, scene: Scene) -> None:
        """scene: of the world, with nodes ``node_spacing_m`` apart. Takes about a second."""
        self._lighting, self._scene = lighting, scene
        self.windows = windows_of(world, lighting)
        self._nodes = {
            k: nodes_of(quad.corner, quad.edge_u, quad.edge_v, (int(scene.places[k, 3]), int(scene.places[k, 4])))
            for k, quad in enumerate(quads(world))
            if not glows(quad, world)
        }
        factor, inside = lighting.lamps, _insides(self.windows)
        self._circuits = [
            [replace(lamp, strength=factor * lamp.strength) for lamp in circuit]
            for circuit in circuits_of(world.lights, lighting.circuits)
        ]
        lamps = [Light(x=x, y=y, z=z, strength=lighting.daylight) for x, y, z in inside]
        self._steady = Lights(lamps, lighting.ambient * world.ambient)
        layers = [self._steady, *(Lights(circuit) for circuit in self._circuits)]
        self._layers = [self._layer(lights) for lights in layers]
        self._moment, self._now = (-1, -1), (scene, self._steady)

    def at(self, stamp_ns: int) -> tuple[Scene, Lights]:
        """The scene in the light of that moment, and the light itself. Quads of movers stay as they are."""
        time_s, sunny = 1e-9 * stamp_ns, _shines_in(self.windows, self._lighting)
        moment = times_switched(self._lighting, time_s), int(time_s / SUN_STEP_S) if sunny else 0
        if moment != self._moment:
            on = circuits_on(self._lighting, moment[0]).tolist()
            lamps = [lamp for lit, circuit in zip(on, self._circuits) if lit for lamp in circuit]
            lights = self._steady._replace(lamps=[*self._steady.lamps, *lamps])
            lights = self._sunny(lights, moment[1] * SUN_STEP_S) if sunny else lights
            self._moment, self._now = moment, (self._lit([True, *on], lights), lights)
        return self._now

    def _layer(self, lights: Lights) -> dict[int, Float32Array]:
        """What these lights alone give to each quad."""
        return {k: lights.on(nodes).astype(np.float32) for k, nodes in self._nodes.items()}

    def _sunny(self, lights: Lights, time_s: float) -> Lights:
        inwards = self.windows[0].inwards
        beam = sunbeam(self._lighting, math.atan2(inwards[1], inwards[0]), time_s)
        return lights._replace(sun=self._lighting.sun, beam=beam, windows=self.windows)

    def _lit(self, on: list[bool], lights: Lights) -> Scene:
        """The scene with these layers on and the sunlight of the lights."""
        surfaces, packed = self._scene.surfaces.copy(), self._scene.light.copy()
        for k, nodes in self._nodes.items():
            light = np.asarray(sum(layer[k] for layer, lit in zip(self._layers, on) if lit), float)
            if lights.sun > 0.0:
                light = light + lights.sun * sunlight(nodes, lights.windows, lights.beam)
            surfaces[k, 4] = light_scale(light) / 255.0 / 255.0
            first = int(self._scene.places[k, 2])
            packed[first : first + light.size] = pack_light(light, light_scale(light))
        return self._scene._replace(surfaces=surfaces, light=packed)


def node_spacing_m(world: World) -> float:
    """Between the nodes of its light maps."""
    lighting = world.lighting
    sunny = lighting is not None and _shines_in(windows_of(world, lighting), lighting)
    return SUNNY_SPACING_M if sunny else LIGHT_SPACING_M


def _shines_in(windows: list[Window], lighting: Lighting) -> bool:
    return bool(windows) and lighting.sun > 0.0


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
