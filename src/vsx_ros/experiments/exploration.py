"""Whole explorations: as a task of a sweep, and looked at while they go on."""

from collections.abc import Callable
from typing import Any, NamedTuple

from vsx_ros.occupancy.grid import OccupancyGrid
from vsx_ros.registry import load_plugins
from vsx_ros.runs.lockstep import STOPPED_BY_OPERATOR, FastRun
from vsx_ros.runs.parameters import load
from vsx_ros.runs.world import open_world

Look = Callable[[int, OccupancyGrid], None]
_LOOK_EVERY_NS = 2_000_000_000
_SHARES = (0.5, 0.9, 0.95)


class ExplorationTask(NamedTuple):
    """settings: NAME=VALUE by which the configuration is changed, as --set takes them."""

    world: str
    seed: int
    planner: str
    time_s: float
    settings: tuple[str, ...] = ()


def run_whole(run: FastRun, limit_s: float, look: Look | None = None) -> str:
    """Why the run ended, as ``FastRun.run`` says it. look: told stamp and map every two seconds, once there is a map.
    Ctrl-C, which ends a run with what there is, interrupts an experiment: half a run is no result."""
    due_ns = 0

    def watch(stamp_ns: int) -> None:
        nonlocal due_ns
        if look is not None and stamp_ns >= due_ns and run.system.grid is not None:
            due_ns = stamp_ns + _LOOK_EVERY_NS
            look(stamp_ns, run.system.grid)

    reason = run.run(limit_s, watch)
    if reason == STOPPED_BY_OPERATOR:
        raise KeyboardInterrupt
    return reason


def explore(task: ExplorationTask) -> dict[str, Any]:
    """The summary of the run, and its way to shares of what can be seen (known and right)."""
    load_plugins()  # in a process of its own nobody has
    run = FastRun(open_world(task.world, task.seed), task.seed, task.planner, load(None, task.settings))
    reached: dict[str, float] = {}

    def look(_: int, grid: OccupancyGrid) -> None:
        assert run.judge is not None
        right = run.judge.quality(grid).coverage_correct or 0.0
        for name in [f"way_to_{100 * share:.0f}_m" for share in _SHARES if right >= share]:
            reached.setdefault(name, run.robot.truth.path_length_m)

    reason = run_whole(run, task.time_s, look)
    summary = run.summary(reason, world=task.world, seed=task.seed, planner=task.planner).as_dict()
    return {**summary, **reached}
