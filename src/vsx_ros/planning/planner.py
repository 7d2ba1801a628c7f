"""Plans a path in a map, or gives the reason why there is none."""

import math

import msgspec
import numpy as np

from vsx_ros.arrays import FloatArray
from vsx_ros.config import LimitsConfig, PlannerConfig, RobotConfig
from vsx_ros.errors import PlanningError
from vsx_ros.geometry.se2 import SE2
from vsx_ros.kernels.planning.flood import flood, flood_costs
from vsx_ros.occupancy.distance import joined_distance
from vsx_ros.occupancy.grid import OccupancyGrid
from vsx_ros.planning.coarse_path import ArcBounds, free_words, nanometres, shortened, shortest_word
from vsx_ros.planning.corridor import REVERSE_SLACK_M, Corridor, Visibility, build_corridor
from vsx_ros.planning.joint_qp import check_question, connections, same_pose
from vsx_ros.planning.lattice_ways import OCTILE, coarse_lattice, search
from vsx_ros.planning.path import Path, Plan, Refusal, RefusalKind, certified
from vsx_ros.planning.pieces import turn_piece
from vsx_ros.planning.sliding_fit import smoothed
from vsx_ros.planning.time_scaling import estimated_s

_TIGHT = 0.9  # of phi, for arcs and lines: smoothing needs the rest
_DIRECT = 4  # connections compared by the landmarks they see, or by their legs in reverse
_SHORTENINGS = 3  # random shortcuts give different paths; the best of so many is smoothed first
_NEAR_BOUND = 1.15  # times the least possible length: no search would find a much shorter path
_ANOTHER = 1.002  # a path hardly longer than the previous one is most likely the same
_MOST_BLIND_M, _SAME_PLACE_M = 1.5, 0.02  # for the first drive or backing out; a goal so near is at the base's place
_LIMITS = LimitsConfig()  # for comparing the times of two drives: their ratio hardly depends on them


class Planner:
    """Plans whose change of view is bounded by config.phi_rad_m everywhere (paper 4)."""

    def __init__(self, config: PlannerConfig, robot: RobotConfig) -> None:
        self._config, self._robot = config, robot
        preferred_m = max(config.clearance_m, config.preferred_clearance_m)
        self._wide, self._half = (
            msgspec.structs.replace(config, clearance_m=wider_m) for wider_m in (preferred_m, config.medium_clearance_m)
        )

    def plan(
        self, start: SE2, goal: SE2, grid: OccupancyGrid, rng: np.random.Generator, visibility: Visibility | None = None
    ) -> Plan | Refusal:
        """A collision-free plan to the exact goal pose over known free ground, or a refusal with its reason.

        The path keeps config.preferred_clearance_m, or less down to config.clearance_m if that drive is much shorter in
        time.

        With ``visibility``, stretches with too few landmarks in view cost extra, so that a path which keeps the map in
        view is preferred to a shorter one that loses it. ``Plan.blind_spans`` lists the stretches that remain; a path
        with one longer than config.max_blind_m is not used. The same input with the same state of rng gives the same
        plan to the last bit. Raises PlanningError for poses that are not finite."""
        check_question(start, goal, self._config.phi_rad_m)
        corridor = build_corridor(grid, start, goal, self._config, self._robot)
        if isinstance(corridor, Refusal):
            return corridor
        if same_pose(start, goal):
            nothing = certified(start, goal, (), "start and goal are the same")
            return Plan(goal, corridor.measured(nothing), "fov")
        wide = build_corridor(grid, start, goal, self._wide, self._robot, corridor.clearance)
        plan = self._at_once(start, goal, wide, grid, visibility) if isinstance(wide, Corridor) else None
        if plan is not None:
            return plan
        half = build_corridor(grid, start, goal, self._half, self._robot, corridor.clearance)
        corridors = [width for width in (wide, half, corridor) if isinstance(width, Corridor)]
        return self._chosen(start, goal, corridors, grid, rng, visibility)

    def _chosen(
        self, start: SE2, goal: SE2, corridors: list[Corridor], grid: OccupancyGrid, rng: np.random.Generator,
        visibility: Visibility | None,
    ) -> Plan | Refusal:  # fmt: skip
        """The plan with the widest clearance, unless there is none or it takes too much longer. corridors: the widest
        first."""
        everywhere = joined_distance(corridors[-1].margin, (goal.x, goal.y))
        cell = corridors[-1].margin.cell(start.x, start.y)
        least_m = self._least_m(start, goal, float(everywhere[cell]))
        chosen: Plan | Refusal | None = None
        for corridor in corridors:
            is_last = corridor is corridors[-1]
            remaining = everywhere if is_last else joined_distance(corridor.margin, (goal.x, goal.y))
            if not is_last and remaining[cell] >= self._config.detour_ratio * everywhere[cell] + self._config.detour_m:
                continue
            plan = self._in_corridor(start, goal, corridor, remaining, grid, rng, visibility)
            if isinstance(plan, Plan):
                if not isinstance(chosen, Plan) or self._is_slow(chosen.path, plan.path):
                    chosen = plan
                if not self._is_detour(chosen.path, least_m):
                    return chosen
            elif chosen is None or (isinstance(chosen, Refusal) and chosen.kind is not RefusalKind.BLIND):
                chosen = plan
        assert chosen is not None  # of the last corridor
        return chosen

    def _least_m(self, start: SE2, goal: SE2, remaining_m: float) -> float:
        """No path is shorter [m]. remaining_m: travel distance from the start to the goal in the widest ground."""
        return max(OCTILE * remaining_m, shortest_word(start, goal, self._config.phi_rad_m).length_m)

    def _is_detour(self, path: Path, least_m: float) -> bool:
        """Whether a path is so long that one with less clearance may be a better choice."""
        return path.cost_m(self._config) > self._config.detour_ratio * least_m + self._config.detour_m

    def _is_slow(self, wide: Path, short: Path) -> bool:
        """Whether a drive with more clearance takes too much longer than one with less."""
        wide_s, short_s = (estimated_s(path, _LIMITS) for path in (wide, short))
        return wide_s > self._config.detour_ratio * short_s + self._config.detour_m / _LIMITS.v_m_s

    def _in_corridor(
        self, start: SE2, goal: SE2, corridor: Corridor, remaining: FloatArray, grid: OccupancyGrid,
        rng: np.random.Generator, visibility: Visibility | None,
    ) -> Plan | Refusal:  # fmt: skip
        """remaining: travel distance from each cell to the goal [m]."""
        config = self._config

        def cost(path: Path) -> float:
            blind_m = visibility.blind_m(path, grid) if visibility is not None else 0.0
            return path.cost_m(config) + config.blind_cost_ratio * blind_m

        plan = self._at_once(start, goal, corridor, grid, visibility)
        if plan is not None:
            return plan
        if not math.isfinite(remaining[corridor.margin.cell(start.x, start.y)]):
            return Refusal(
                RefusalKind.DISCONNECTED,
                f"no way of {2 * (self._robot.radius_m + self._config.clearance_m):.2f} m width over known free ground "
                f"joins ({start.x:.2f}, {start.y:.2f}) and ({goal.x:.2f}, {goal.y:.2f})",
            )
        direct = self._direct(start, goal, corridor, enough=1 if visibility is None else _DIRECT)
        found = direct + self._through_map(start, goal, corridor, remaining, rng)
        if not found:
            return Refusal(
                RefusalKind.BUDGET,
                f"the goal is connected, but no path with phi {self._config.phi_rad_m:g} rad/m and reverse legs of at "
                f"most {self._config.max_reverse_m:g} m was found within the search budget",
            )
        ways = (self._plan(path, goal, corridor, visibility, grid) for path in sorted(found, key=cost))
        best = next(ways)
        return best if isinstance(best, Plan) else next((way for way in ways if isinstance(way, Plan)), best)

    def plan_blind(self, start: SE2, goal: SE2) -> Plan | Refusal:
        """A plan without a map (the first drive, backing along the trail). It assumes free space, but drives at most
        1.5 m. A goal within 2 cm that no such path can bend to is reached by a turn on the spot, which touches nothing
        new."""
        phi = self._config.phi_rad_m
        check_question(start, goal, phi)
        if same_pose(start, goal):
            return Plan(goal, certified(start, goal, (), "start and goal are the same"), "fov")
        way_m, turn = start.distance_to(goal), start.angle_to(goal)
        if way_m < _SAME_PLACE_M and abs(turn) > phi * way_m:
            return Plan(goal, certified(start, goal, (turn_piece(start, turn),), "a turn on the spot"), "fov")
        limit = self._config.max_reverse_m
        near = way_m <= _MOST_BLIND_M
        paths = connections(start, goal, phi, enough=_DIRECT, config=self._config) if near else []
        short = [path for path in paths if path.length_m <= _MOST_BLIND_M]
        if not short:
            return Refusal(RefusalKind.INFEASIBLE, f"without a map at most {_MOST_BLIND_M:g} m is driven")
        allowed = [path for path in short if path.longest_reverse_m <= limit + REVERSE_SLACK_M]
        if allowed:
            return Plan(goal, allowed[0], "fov")
        return Refusal(RefusalKind.INFEASIBLE, f"every short connection needs a reverse leg longer than {limit:g} m")

    def travel_costs(self, start: SE2, grid: OccupancyGrid, clearance_m: float, poses: FloatArray) -> FloatArray:
        """(N,) estimated travel lengths [m] from start to poses (N, 3) around the obstacles; inf where unreachable, and
        where the clearance is less than the radius plus clearance_m, although ``plan`` reaches some such poses.

        One search over positions and headings with arcs of curvature phi, forwards and in reverse, serves all poses.
        Raises PlanningError for poses that are not finite."""
        phi = self._config.phi_rad_m
        check_question(start, start, phi)
        poses = np.ascontiguousarray(poses, float).reshape(-1, 3)
        if not np.all(np.isfinite(poses)):
            raise PlanningError("travel_costs was given a pose that is not finite; drop it before asking")
        config = msgspec.structs.replace(self._config, clearance_m=clearance_m)
        corridor = build_corridor(grid, start, None, config, self._robot)
        if isinstance(corridor, Refusal):
            return np.full(len(poses), np.inf)
        m, lattice = corridor.margin, coarse_lattice(phi)
        level, step = flood(m, start.as_array(), phi, lattice, self._config.max_reverse_m)
        # The estimate uses cells around a pose, perhaps behind a thin wall: use it only on connected ground.
        joined = np.isfinite(joined_distance(m, (start.x, start.y)))
        return flood_costs(level, step, start.theta, m, lattice.cell_m, phi, joined, poses)

    def _at_once(
        self, start: SE2, goal: SE2, corridor: Corridor, grid: OccupancyGrid, visibility: Visibility | None
    ) -> Plan | Refusal | None:
        """The best connection computed without the map, if it is free and keeps the landmarks in view."""
        direct = self._direct(start, goal, corridor, enough=1 if visibility is None else _DIRECT)
        if direct and (visibility is None or visibility.blind_m(direct[0], grid) == 0.0):
            return self._plan(direct[0], goal, corridor, visibility, grid)
        return None

    def _direct(self, start: SE2, goal: SE2, corridor: Corridor, enough: int) -> list[Path]:
        """The best connections computed without the map, if they are free."""
        phi, limit = self._config.phi_rad_m, self._config.max_reverse_m
        # If no shortest curve is free, hardly any smooth one is, and computing those costs a hundred times as much.
        if not any(free_words(start, goal, ArcBounds(corridor.margin, bend, limit)) for bend in (phi, _TIGHT * phi)):
            return []
        best = connections(start, goal, phi, enough, self._config)[:enough]
        return [path for path in best if corridor.allows(path, limit)]

    def _plan(
        self, path: Path, goal: SE2, corridor: Corridor, visibility: Visibility | None, grid: OccupancyGrid
    ) -> Plan | Refusal:
        if visibility is None:
            return Plan(goal, corridor.measured(path), "fov")
        spans = visibility.blind_spans(path, grid)
        longest = max((last - first for first, last in spans.tolist()), default=0.0)
        if longest > self._config.max_blind_m:
            return Refusal(
                RefusalKind.BLIND,
                f"of the best way, {path.length_m:.1f} m long, {longest:.1f} m in one go would be driven with fewer "
                f"than {visibility.least} of the {len(visibility.landmarks_world)} landmarks in view or all on "
                f"one side (limit {self._config.max_blind_m:g} m)",
            )
        return Plan(goal, corridor.measured(path), "fov", spans)

    def _through_map(
        self, start: SE2, goal: SE2, corridor: Corridor, remaining: FloatArray, rng: np.random.Generator
    ) -> list[Path]:
        """Paths along a few coarse paths: a free Reeds-Shepp word, or the result of a search."""
        config = self._config
        phi, limit = config.phi_rad_m, config.max_reverse_m
        tight = ArcBounds(corridor.margin, _TIGHT * phi, limit)
        coarse_paths = free_words(start, goal, tight)[:1]
        least_m = OCTILE * float(remaining[tight.margin.cell(start.x, start.y)])
        if not coarse_paths or coarse_paths[0].length_m > _NEAR_BOUND * least_m + config.stop_cost_m:
            raw = search(start, goal, tight, remaining)
            if raw is not None:
                coarse_paths += [shortened(raw, start, tight, config.cusp_cost_m, rng) for _ in range(_SHORTENINGS)]
        found: list[Path] = []
        before_m = 0.0
        costs = sorted((nanometres(way.cost_m(config.cusp_cost_m)), k) for k, way in enumerate(coarse_paths))
        for coarse in (coarse_paths[k] for _, k in costs):
            coarse_m = coarse.cost_m(config.cusp_cost_m)
            if coarse_m < _ANOTHER * before_m:
                continue
            before_m = coarse_m
            found += [p for p in smoothed(coarse, start, goal, config, corridor) if corridor.allows(p, limit)]
            best = min(found, key=lambda path: path.cost_m(config), default=None)
            if best is not None and not best.jumps and best.cost_m(config) < coarse_m + 2.0 * config.stop_cost_m:
                break
        return found
