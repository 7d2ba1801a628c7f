"""Which view to drive to next: utility U = v / d (paper eq. 12) over candidate views.

v is the unknown area that a view would show. It is found by ray casting within the camera's field of view, weighted by
the probability that nothing unknown hides it and by the information in it (``unknown_ground.py``).
d is the length of the motion-bounded path plus the cost of a stop. A view with too few known landmarks counts less,
because the tracker needs them there."""

import math
from collections.abc import Callable
from enum import Enum
from typing import NamedTuple, Protocol

import cv2
import numpy as np

from vsx_ros.arrays import BoolArray, FloatArray, IntArray, Points2
from vsx_ros.config import ExplorationConfig
from vsx_ros.geometry.se2 import SE2
from vsx_ros.kernels.occupancy.visibility import Looks, unknown_area_by_bearing
from vsx_ros.occupancy.distance import landmarks_in_view
from vsx_ros.occupancy.grid import OccupancyGrid
from vsx_ros.occupancy.unknown_ground import looks_so_far, opaque_walls
from vsx_ros.registry import Registry

BEARINGS = 72  # every 5 deg; at 3 m rays are 26 cm apart
HEADINGS = 24  # of candidates, every 15 deg; a divisor of BEARINGS
_LANDMARK_RANGE, _MOST_LANDMARKS = (0.5, 6.0), 2000  # m at which points are matched; of more, an even sample
_FEWER, _MOST_ROUNDS = 3, 5  # divides min_landmarks when no view has enough; most rounds of max_ranked_views


class View(NamedTuple):
    """A candidate goal: pose, v [m2], d [m], landmarks in view, U [m2 per m]."""

    pose: SE2
    gain_m2: float
    distance_m: float
    landmarks: int
    utility: float

    def ahead(self, way_m: float) -> FloatArray:
        """(2,) x and y of the place so far before it [m]."""
        theta = self.pose.theta
        return np.array([self.pose.x + way_m * math.cos(theta), self.pose.y + way_m * math.sin(theta)])

    def landmark_factor(self, stop_cost_m: float) -> float:
        """The share of v / d that is left to a view with few known landmarks: U = v / d times this."""
        return self.utility * (self.distance_m + stop_cost_m) / self.gain_m2 if self.gain_m2 > 0.0 else 0.0


class Rejection(Enum):
    """Why a candidate was rejected."""

    NO_ROOM = "no standing room"
    NO_GAIN = "gain too small"
    BLACKLISTED = "blacklisted"
    LOOKED = "looked from already"
    UNREACHABLE = "unreachable"
    NOT_WORTH = "not worth the way"
    FEW_LANDMARKS = "too few known landmarks in view"


_ELSEWHERE = Rejection.UNREACHABLE, Rejection.NO_ROOM, Rejection.FEW_LANDMARKS


class Ranking(NamedTuple):
    """Views by falling utility, and the number of rejected candidates for each reason."""

    views: list[View]
    rejected: dict[Rejection, int]

    def why(self) -> str:
        """Why candidates were rejected, for people."""
        return ", ".join(f"{count} {name.value}" for name, count in self.rejected.items() if count) or "no candidates"

    def boxed_in(self) -> bool:
        """Whether there are views that cannot be driven to from here, but perhaps from elsewhere."""
        return any(self.rejected[reason] for reason in _ELSEWHERE)


TravelCosts = Callable[[FloatArray], FloatArray]  # (N, 3) poses to (N,) path lengths [m], infinite where no path exists

TravelCostsFrom = Callable[[SE2, OccupancyGrid, float, FloatArray], FloatArray]
"""The same from a start pose, in a grid, with a clearance beside the body [m]."""

BlacklistedPoses = Callable[[FloatArray], BoolArray]  # (N, 3) poses to (N,) True where a goal failed a while ago


class RankingInput(NamedTuple):
    """Input of a ranking.

    radius_m: of the robot with its clearance. landmarks_world: (M, 2) or (M, 3) map points [m]. looked_from: (L, 3)
    poses from which the camera has looked. travel_costs: path lengths from here. blacklist: poses near failed goals.
    config: with the camera's field of view (``geometry.view.with_view``)."""

    grid: OccupancyGrid
    radius_m: float
    landmarks_world: FloatArray
    looked_from: FloatArray
    travel_costs: TravelCosts
    blacklist: BlacklistedPoses
    config: ExplorationConfig


class Ranker(Protocol):
    """A strategy: which view to drive to next."""

    def __call__(self, asked: RankingInput, /) -> Ranking:
        """Views by falling utility, and the number of rejected candidates for each reason."""


def traversable_cells(grid: OccupancyGrid, radius_m: float) -> BoolArray:
    """(H, W) cells where a round robot of this radius [m] stands on known free ground only, outside closed zones."""
    free = grid.drivable.astype(np.uint8)
    padded = cv2.copyMakeBorder(free, 1, 1, 1, 1, cv2.BORDER_CONSTANT, value=0)
    clearance = cv2.distanceTransform(padded, cv2.DIST_L2, cv2.DIST_MASK_PRECISE)[1:-1, 1:-1] * grid.resolution
    return np.asarray(clearance - 0.5 * grid.resolution > radius_m)


def near_poses(poses: FloatArray, others: FloatArray, radius_m: float, angle: float) -> BoolArray:
    """(N,) which of the poses (N, 3) lie within radius [m] and angle [rad] of any of the others (M, 3)."""
    near = np.zeros(len(poses), np.bool_)
    for x, y, theta in others.tolist():
        rows = np.flatnonzero(np.abs(poses[:, 0] - x) < radius_m)
        offset = poses[rows] - (x, y, theta)
        turn = (offset[:, 2] + np.pi) % (2 * np.pi) - np.pi
        near[rows[(np.hypot(offset[:, 0], offset[:, 1]) < radius_m) & (np.abs(turn) < angle)]] = True
    return near


def view_gain(grid: OccupancyGrid, positions: Points2, looks: Looks, config: ExplorationConfig) -> FloatArray:
    """(N, BEARINGS) unknown area [m2], weighted by the looks so far, in the field of view from each position (N, 2)
    [m], looking at each bearing k * 2 pi / BEARINGS."""
    bearings: FloatArray = np.arange(BEARINGS, dtype=np.float64) * (2 * math.pi / BEARINGS)
    per_bearing = unknown_area_by_bearing(
        grid.data, looks, grid.resolution, grid.origin_x, grid.origin_y, positions, bearings,
        config.sensor_range_m, config.mean_free_path_m,
    )  # fmt: skip
    return window_sums(per_bearing, max(1, round(config.sensor_fov_rad / (2 * math.pi) * BEARINGS)))


def window_sums(per_bearing: FloatArray, window: int) -> FloatArray:
    """(N, B) sums over ``window`` neighbouring bearings (cyclic) centred on each: the field of view."""
    b = per_bearing.shape[1]
    extended = np.concatenate([per_bearing, per_bearing[:, :window]], axis=1)
    cumulative = np.concatenate([np.zeros((len(per_bearing), 1)), np.cumsum(extended, axis=1)], axis=1)
    sums = cumulative[:, window : window + b] - cumulative[:, :b]
    return np.roll(sums, window // 2, axis=1)


def gain_at(
    grid: OccupancyGrid, radius_m: float, pose: SE2, looked_from: FloatArray, config: ExplorationConfig
) -> float:
    """v of one pose [m2]; arguments as of ``RankingInput``."""
    opaque, place = opaque_walls(grid, 2.0 * radius_m, config.wall_gap_m), np.array([[pose.x, pose.y]])
    near = np.hypot(*(looked_from[:, :2] - place).T) < config.sensor_range_m + config.look_range_m + grid.resolution
    gains = view_gain(opaque, place, looks_so_far(opaque, looked_from[near], config), config)[0]
    return float(gains[round(pose.theta / (2 * math.pi) * BEARINGS) % BEARINGS])


def rank_views(asked: RankingInput) -> Ranking:
    """Rank views on a raster over the cells where the robot can stand (eq. 12)."""
    config = asked.config
    opaque = opaque_walls(asked.grid, 2.0 * asked.radius_m, config.wall_gap_m)
    rejected = dict.fromkeys(Rejection, 0)
    candidates, gains = _candidates(asked, opaque, rejected)
    if len(candidates) == 0:
        return Ranking([], rejected)
    looked = near_poses(candidates, asked.looked_from, config.look_spacing_m, config.look_spacing_m)
    failed = asked.blacklist(candidates)
    rejected[Rejection.LOOKED], rejected[Rejection.BLACKLISTED] = int(looked.sum()), int((failed & ~looked).sum())
    candidates, gains = candidates[~looked & ~failed], gains[~looked & ~failed]
    distances = asked.travel_costs(candidates) if len(candidates) else np.zeros(0)
    reachable = np.isfinite(distances)
    rejected[Rejection.UNREACHABLE] = int((~reachable).sum())
    worthy = reachable & (gains >= config.min_utility_m * (distances + config.stop_cost_m))
    rejected[Rejection.NOT_WORTH] = int((reachable & ~worthy).sum())
    views = _with_landmarks(asked, opaque, candidates[worthy], gains[worthy], distances[worthy])
    enough = [view for view in views if view.landmarks >= config.min_landmarks]
    rejected[Rejection.FEW_LANDMARKS] = len(views) - len(enough)
    # If nothing better is left, few landmarks are better than to stop.
    enough = enough or [view for view in views if _FEWER * view.landmarks >= config.min_landmarks]
    return Ranking(sorted(enough, key=lambda view: -view.utility), rejected)


def _with_landmarks(
    asked: RankingInput, opaque: OccupancyGrid, candidates: FloatArray, gains: FloatArray, distances: FloatArray
) -> list[View]:
    """Views from the candidates (N, 3), most promising first, until no remaining one can be better than the best."""
    config = asked.config
    hopes = gains / (distances + config.stop_cost_m)
    order = np.argsort(-hopes, kind="stable")
    views: list[View] = []
    for number, chosen in enumerate(_rounds(order, config.max_ranked_views)):
        best = max((view.utility for view in views if view.landmarks >= config.min_landmarks), default=0.0)
        if best >= hopes[chosen[0]] or (best and number == _MOST_ROUNDS):
            break
        seen = count_landmarks(opaque, candidates[chosen], asked.landmarks_world, config)
        for i, count in zip(chosen.tolist(), seen.tolist(), strict=True):
            utility = float(hopes[i]) * min(1.0, count / config.good_landmarks)
            pose, gain_m2, distance_m = SE2(*map(float, candidates[i])), float(gains[i]), float(distances[i])
            views.append(View(pose, gain_m2=gain_m2, distance_m=distance_m, landmarks=count, utility=utility))
    return views


def _rounds(order: IntArray, most: int) -> list[IntArray]:
    """Rounds of ``most`` from the beginning of the order, then one spread over the rest: in a bare hall none of the
    first may have landmarks in view, but one elsewhere may."""
    rest = order[_MOST_ROUNDS * most :]
    rounds = [order[first : first + most] for first in range(0, len(order) - len(rest), most)]
    return [*rounds, rest[:: -(-len(rest) // most)]] if len(rest) else rounds


def count_landmarks(
    grid: OccupancyGrid, poses: FloatArray, landmarks_world: FloatArray, config: ExplorationConfig
) -> IntArray:
    """(N,) known landmarks that each pose (N, 3) would have in view, estimated from a sample of them."""
    half_fov_rad = 0.5 * config.sensor_fov_rad
    return landmarks_in_view(grid, poses, landmarks_world, half_fov_rad, _LANDMARK_RANGE, _MOST_LANDMARKS)


def _candidates(
    asked: RankingInput, opaque: OccupancyGrid, rejected: dict[Rejection, int]
) -> tuple[FloatArray, FloatArray]:
    """(N, 3) poses and (N,) gains [m2] with enough gain: headings at raster cells where the robot can stand, best
    first."""
    grid, config = asked.grid, asked.config
    room = traversable_cells(grid, asked.radius_m + config.view_margin_m)
    stride = max(1, round(config.view_spacing_m / grid.resolution))
    cells = np.argwhere(room)
    cells = cells[(cells[:, 0] % stride == 0) & (cells[:, 1] % stride == 0)]
    if len(cells) == 0:
        rejected[Rejection.NO_ROOM] = int(room.size)
        return np.zeros((0, 3)), np.zeros(0)
    positions = grid.centres(cells)
    looks = looks_so_far(opaque, asked.looked_from, config)
    gain = view_gain(opaque, positions, looks, config)[:, :: BEARINGS // HEADINGS]
    enough = gain >= config.min_gain_m2
    rejected[Rejection.NO_GAIN] = int((~enough).sum())
    i, k = np.nonzero(enough)
    order = np.argsort(-gain[i, k], kind="stable")
    poses = np.column_stack([positions[i], k * (2 * math.pi / HEADINGS)])[order]
    return poses, gain[i, k][order]


RANKERS: Registry[Ranker] = Registry("view ranker", {"views": rank_views})
"""Rankers by the names that ``exploration.ranker`` may have."""
