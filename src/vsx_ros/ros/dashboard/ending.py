"""The end of a run in the live view: what was reached, and what can be done with it. The run's own process serves it
where the node ``dashboard`` was, as long as somebody looks."""

import contextlib
import threading
import time
from collections.abc import Callable
from typing import Any, NamedTuple

from vsx_ros.errors import ConfigError, InputError, MapFileError, VsxError
from vsx_ros.io.room_file import load_rooms, room_file, room_tree
from vsx_ros.ros import convert, topics
from vsx_ros.ros.dashboard import feed
from vsx_ros.ros.dashboard.feed import Board
from vsx_ros.ros.dashboard.server import LOOPBACK, Answer, Command, ViewServer
from vsx_ros.runs.folder import RunFolder
from vsx_ros.runs.places import zones_beside
from vsx_ros.runs.report import one_line_facts
from vsx_ros.runs.saved_map import save_map_of

_COME_S, _GONE_S, _TICK_S = 4.0, 5.0, 0.1  # a page asks again every second
_WAY_POINTS = 2000  # more would not be visible


class Ended(NamedTuple):
    """A run that has ended. ended_well: as it should."""

    folder: RunFolder
    summary: dict[str, Any]
    ended_well: bool


def show_end(
    ended: Ended, token: str, port: int, stopped: Callable[[], bool] = lambda: False, *, stay: bool = True
) -> bool:
    """Serve the end until nobody looks, or until ``stopped``. Returns whether a viewer wants the exploration to go on.
    Without a viewer it returns soon, if the port is taken at once. stay: false: return when the viewers have it. Raises
    VsxError when the results cannot be read."""
    board, on, looking = Board(), threading.Event(), [0]
    post(board, ended)
    try:
        server = ViewServer(board, commands(ended.folder, on), lambda n: looking.append(n), token, LOOPBACK, port)
    except ConfigError:
        return False
    server.report = lambda: (ended.folder.path / "report.html").read_bytes()
    threading.Thread(target=server.serve_forever, name="end", daemon=True).start()
    left_s = _COME_S  # counted in ticks: on a machine that is late, the viewers are, too
    while not (on.is_set() or stopped()) and left_s > 0.0:
        left_s = _GONE_S if looking[-1] and stay else left_s - _TICK_S
        time.sleep(_TICK_S)
    time.sleep(_TICK_S)  # the answer to the last command is under way
    server.close()
    return on.is_set()


def post(board: Board, ended: Ended) -> None:
    """The verdict, the figures, the map and the way."""
    reason, facts = str(ended.summary.get("stop_reason")), one_line_facts(ended.summary)
    report = (ended.folder.path / "report.html").exists()
    told = {"reason": reason, "ok": ended.ended_well, "facts": facts, "folder": str(ended.folder.path)}
    board.post("end", feed.text({**told, "report": report}))
    grid = ended.folder.read_map()
    if grid is not None:
        board.post("map", feed.text(feed.grid(convert.grid_msg(grid, topics.MAP_FRAME, 0))))
    for subject, places in places_of(ended.folder).items():
        board.post(subject, feed.text(places))
    way = [pose.T.translation[:2].round(2).tolist() for pose in ended.folder.read_poses("trajectory")]
    board.post("way", feed.text(way[:: 1 + len(way) // _WAY_POINTS]))


def places_of(folder: RunFolder) -> dict[str, Any]:
    """The zones and rooms beside the map of a run, as on their topics; without those that cannot be read."""
    file, found = folder.path / "map.yaml", {}
    with contextlib.suppress(MapFileError, InputError):
        found["zones"] = {"zones": [zone.tree() for zone in zones_beside(file)]}
    with contextlib.suppress(MapFileError):
        rooms = load_rooms(room_file(file))
        found["rooms"] = {"rooms": []} if rooms is None else room_tree(rooms)
    return found


def commands(folder: RunFolder, on: threading.Event) -> dict[str, Command]:
    """What the buttons of the end do."""

    def save() -> Answer:
        path = folder.path / "map.vsxmap"
        try:
            save_map_of(folder, path)
        except VsxError as error:
            return Answer(False, str(error))
        return Answer(True, f"the map is saved: {path}")

    def explore() -> Answer:
        if not folder.checkpoint.exists:
            return Answer(False, f"{folder.path} holds no map to go on with")
        on.set()
        return Answer(True, "the exploration goes on in this map; the nodes start")

    return {"save_map": save, "explore_on": explore}
