"""What a bag holds for PlotJuggler and rqt_plot, read by ROS's own rosbag."""

from pathlib import Path

import numpy as np
import rosbag

from vsx_ros.arrays import FloatArray
from vsx_ros.ros import topics

STATS = tuple(f"/{topics.STATS}/{name}" for name in topics.STAT_TYPES)
WITH_EACH_IMAGE = ("tracked_ratio", "tracked", "attempted", "fps", "latency_ms")
NEVER_ZERO = ("latency_ms", "keyframes", "points", "map_mib", "plan_ms", "coverage")
NUMBERS = (*STATS, f"/{topics.PLAN_MS}", f"/{topics.COVERAGE}")


def numbers(bag: Path) -> dict[str, FloatArray]:
    """Topic -> rows of time [s] and value, in the order of the file's index."""
    found: dict[str, list[tuple[float, float]]] = {}
    with rosbag.Bag(str(bag)) as opened:
        for topic, msg, stamp in opened.read_messages(topics=list(NUMBERS)):
            found.setdefault(topic, []).append((stamp.to_sec(), float(msg.data)))
    return {topic: np.array(rows) for topic, rows in found.items()}


def check(found: dict[str, FloatArray]) -> None:
    """Every number worth plotting is there, finite, at rising times, and what belongs to one image comes with it."""
    assert found.keys() == set(NUMBERS)
    for topic, rows in found.items():
        assert np.isfinite(rows).all(), topic
        assert (np.diff(rows[:, 0]) > 0.0).all(), topic
    values = {topic.rsplit("/", 1)[1]: rows[:, 1] for topic, rows in found.items()}
    series = [found[f"/{topics.STATS}/{name}"][:, 0] for name in WITH_EACH_IMAGE]
    begin_s, end_s = max(times_s[0] for times_s in series), min(times_s[-1] for times_s in series)
    images = [int(np.count_nonzero((times_s >= begin_s) & (times_s <= end_s))) for times_s in series]
    assert min(images) > 5
    assert max(images) - min(images) <= 2  # of the first and the last image some may be heard a moment too late
    assert ((values["tracked_ratio"] >= 0.0) & (values["tracked_ratio"] <= 1.0)).all()
    assert values["tracked_ratio"].max() > 0.0
    assert all((values[name] > 0.0).all() for name in NEVER_ZERO)
