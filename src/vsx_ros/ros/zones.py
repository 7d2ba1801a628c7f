"""Zones on topics: the node vslam keeps them in its map and takes changes; others lay them over the map they get."""

import json
import threading
from collections.abc import Callable, Sequence

import rospy
from nav_msgs.msg import OccupancyGrid as OccupancyGridMsg
from std_msgs.msg import ColorRGBA, String
from visualization_msgs.msg import MarkerArray

from vsx_ros.config import Config
from vsx_ros.dense.mapped_ground import MappedGround
from vsx_ros.errors import InputError
from vsx_ros.geometry.se2 import SE2
from vsx_ros.limits import json_tree
from vsx_ros.occupancy.grid import OccupancyGrid
from vsx_ros.occupancy.zoned_grid import entered, with_zones
from vsx_ros.occupancy.zones import MAX_ZONES, Zone, ZoneKind, zone_of
from vsx_ros.ros import convert, headers, topics
from vsx_ros.ros.callbacks import json_object, offer_text, subscribe
from vsx_ros.ros.outlines import Outline, outline_markers
from vsx_ros.slam.snapshot import MapSnapshot

_COLORS = {
    ZoneKind.NO_GO: ColorRGBA(0.9, 0.1, 0.1, 1.0),
    ZoneKind.WALL: ColorRGBA(0.9, 0.1, 0.1, 1.0),
    ZoneKind.ONLY: ColorRGBA(0.1, 0.6, 0.2, 1.0),
    ZoneKind.SLOW: ColorRGBA(1.0, 0.6, 0.1, 1.0),
    ZoneKind.LOOK: ColorRGBA(0.2, 0.4, 1.0, 1.0),
}


class ZoneServer:
    """Publishers: zones, zones/markers (both latched). Services: zones/change (AddDiagnostics:
    JSON {"add": zone}, {"remove": name} or {"clear": true}).

    lock: guards the ground's zones; hold it around everything that reads or moves them."""

    def __init__(
        self, ground: MappedGround, snapshot: Callable[[], MapSnapshot], base: Callable[[], SE2 | None], config: Config
    ) -> None:
        """snapshot: of the present map. base: T_map_base; None while unknown."""
        self.lock = threading.RLock()
        self._ground, self._snapshot, self._base = ground, snapshot, base
        self._told, self._radius_m, self._cell_m = "", config.robot.radius_m, config.ground_map.resolution_m
        self._entered: tuple[str, ...] = ()
        self._zones_pub = rospy.Publisher(topics.ZONES, String, queue_size=1, latch=True)
        self._markers_pub = rospy.Publisher(topics.ZONE_MARKERS, MarkerArray, queue_size=1, latch=True)
        self.publish(snapshot())
        offer_text(topics.CHANGE_ZONES, self._change)

    def publish(self, snapshot: MapSnapshot) -> None:
        """Publish the zones in the map of a snapshot, if they changed or moved, and which of them the body reaches
        into: under the operator's hand it may."""
        with self.lock:
            zones, version = self._ground.zones_in(snapshot), self._ground.zones.version
            if (base := self._base()) is not None:
                now = entered(zones, base.x, base.y, self._radius_m, self._cell_m)
                for name in sorted(set(now) - set(self._entered)):
                    rospy.logwarn("the robot reaches into the zone %r", name)
                self._entered = now
            trees = [zone.tree() for zone in zones]
            tree = {"version": version, "frame": topics.MAP_FRAME, "zones": trees, "entered": self._entered}
            if (text := json.dumps(tree)) != self._told:
                self._told = text
                self._zones_pub.publish(text)
                self._markers_pub.publish(zone_markers(zones, headers.now_ns()))

    def _change(self, text: str) -> str:
        with self.lock:
            said = changed(self._ground, text)
            self.publish(self._snapshot())
        rospy.loginfo("%s", said)
        return said


def changed(ground: MappedGround, text: str) -> str:
    """Make the change that a text in JSON describes; returns it in words. Raises InputError for anything else."""
    try:
        tree = json_tree(text)
    except ValueError as error:
        raise InputError(f"{text[:80]!r} is not JSON: {error}") from error
    if not isinstance(tree, dict) or len(tree) != 1 or not tree.keys() <= {"add", "remove", "clear"}:
        raise InputError(f'{text[:80]!r} is no change of zones; give {{"add": zone}}, {{"remove": name}} or "clear"')
    if "add" in tree:
        zone = zone_of(tree["add"])
        ground.zones.add(zone)
        return f"zone {zone.name!r} is drawn: {zone.kind.value}, {len(zone.points)} corners"
    if "remove" in tree:
        ground.zones.remove(str(tree["remove"]))
        return f"zone {tree['remove']!r} is removed"
    ground.zones.clear()
    return "all zones are removed"


def heard_zones(msg: String) -> tuple[list[Zone], int]:
    """Zones and their version. Raises InputError for a message that no ``ZoneServer`` has published."""
    tree = json_object(msg, "zones", "version")
    if not isinstance(tree["zones"], list) or len(tree["zones"]) > MAX_ZONES or not isinstance(tree["version"], int):
        raise InputError(f"{msg.data[:80]!r} lists no zones")
    return [zone_of(entry) for entry in tree["zones"]], tree["version"]


class ZonedMap:
    """Subscribers: map, zones. Passes each map, and the newest map with each change of the zones, with the zones laid
    over it, and the map's stamp [ns]; one call at a time."""

    def __init__(self, config: Config, take: Callable[[OccupancyGrid, int], None]) -> None:
        self._margin_m, self._radius_m, self._take = config.planner.zone_margin_m, config.robot.radius_m, take
        self._lock = threading.Lock()
        self._map: tuple[OccupancyGrid, int] | None = None
        self._zones: tuple[list[Zone], int] = [], 0
        subscribe(topics.ZONES, String, self._on_zones, queue_size=1, tcp_nodelay=True)
        subscribe(topics.MAP, OccupancyGridMsg, self._on_map, queue_size=1)

    def _on_map(self, msg: OccupancyGridMsg) -> None:
        grid = convert.grid(msg)
        with self._lock:
            self._map = grid, msg.header.stamp.to_nsec()
            self._pass_on()

    def _on_zones(self, msg: String) -> None:
        zones = heard_zones(msg)
        with self._lock:
            if zones != self._zones:
                self._zones = zones
                self._pass_on()

    def _pass_on(self) -> None:
        if self._map is not None:
            (grid, stamp_ns), (zones, version) = self._map, self._zones
            self._take(with_zones(grid, zones, self._margin_m, self._radius_m, version), stamp_ns)


def zone_markers(zones: Sequence[Zone], stamp_ns: int) -> MarkerArray:
    """The border and the name of each zone."""
    outlines = [
        Outline(
            name=zone.name, points=zone.points, closed=zone.kind is not ZoneKind.WALL, color=_COLORS[zone.kind],
            place=zone.points[0],
        )
        for zone in zones
    ]  # fmt: skip
    return outline_markers("zones", outlines, stamp_ns)
