"""The rviz configuration shows topics that exist, with displays that can show them; the real rviz agrees."""

from __future__ import annotations

import shutil
import subprocess
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

pytest.importorskip("rospy")

import numpy as np
import rosgraph
import screen
import yaml

from vsx_ros.ros import topics

if TYPE_CHECKING:
    from conftest import Stack

CHECKOUT = Path(__file__).resolve().parents[2]

SHOWS = {
    "rviz/Map": "nav_msgs/OccupancyGrid",
    "rviz/PointCloud2": "sensor_msgs/PointCloud2",
    "rviz/PoseArray": "geometry_msgs/PoseArray",
    "rviz/Path": "nav_msgs/Path",
    "rviz/MarkerArray": "visualization_msgs/MarkerArray",
    "rviz/PoseWithCovariance": "geometry_msgs/PoseWithCovarianceStamped",
    "rviz/Odometry": "nav_msgs/Odometry",
    "rviz/Image": "sensor_msgs/Image",
}

FRONTIER, PANEL = (0, 0, 255), (239, 239, 239)
STATUS_OK, STATUS_ERROR = (40, 120, 197), (192, 32, 32)
"""How rviz writes the name of a display that shows its topic, and of one that cannot."""
PANEL_WIDTH_PX = 330


@pytest.fixture
def manager() -> dict[str, Any]:
    text = (CHECKOUT / "config" / "vsx_ros.rviz").read_text(encoding="utf-8")
    return dict(yaml.safe_load(text)["Visualization Manager"])


def displayed(manager: dict[str, Any]) -> Iterator[tuple[str, str]]:
    for display in manager["Displays"]:
        for key in ("Topic", "Marker Topic", "Image Topic"):
            if key in display:
                yield display[key], display["Class"]


def enabled(manager: dict[str, Any], topic: str) -> bool:
    return any(display["Enabled"] for display in manager["Displays"] if topic in display.values())


def test_every_display_shows_a_topic_of_its_kind(manager: dict[str, Any]) -> None:
    published = {topic: kind for node in topics.PUBLISHED.values() for topic, kind in node.items()}
    shown = dict(displayed(manager))
    assert {topic: SHOWS[display] for topic, display in shown.items()} == {
        topic: published.get(topic) for topic in shown
    }
    wanted = {topics.MAP, topics.MAP_POINTS, topics.KEYFRAMES, topics.GLOBAL_PLAN, topics.FRONTIERS, topics.POSE}
    assert wanted <= shown.keys()


def test_goals_go_where_the_planner_listens(manager: dict[str, Any]) -> None:
    tools = {tool["Class"]: tool for tool in manager["Tools"]}
    assert tools["rviz/SetGoal"]["Topic"] == topics.SIMPLE_GOAL
    assert manager["Global Options"]["Fixed Frame"] == topics.MAP_FRAME


def amount_of(colour: tuple[int, int, int], pixels: np.ndarray) -> int:
    return int(np.count_nonzero((np.abs(pixels.astype(int) - colour) <= 3).all(axis=2)))


def is_drawn(pixels: np.ndarray) -> bool:
    """The panel is there, with displays that show their topics and none that cannot, and a frontier in the map beside
    it."""
    well, ill = (amount_of(status, pixels[:, :PANEL_WIDTH_PX]) for status in (STATUS_OK, STATUS_ERROR))
    return amount_of(PANEL, pixels) > 10_000 and amount_of(FRONTIER, pixels) > 100 and well > 100 and ill == 0


@pytest.mark.ros
@pytest.mark.skipif(shutil.which("rviz") is None, reason="rviz is not installed (apt install rviz)")
@pytest.mark.skipif(screen.EXECUTABLE is None, reason="there is no Xvfb to show rviz on (apt install xvfb)")
def test_rviz_shows_the_running_robot(stack: Stack, manager: dict[str, Any], tmp_path: Path) -> None:
    stack.wait_until_driving()
    wanted = {f"/{topic}" for topic, kind in displayed(manager) if enabled(manager, topic)} | {"/tf", "/tf_static"}

    def listens() -> bool:
        _, subscribed, _ = rosgraph.Master("/observer").getSystemState()
        return wanted <= {topic for topic, nodes in subscribed if any(node.startswith("/rviz") for node in nodes)}

    with screen.Screen(tmp_path, 1400, 900) as shown, (tmp_path / "rviz.txt").open("w") as words:
        display = {"DISPLAY": shown.display, "HOME": str(tmp_path), "LIBGL_ALWAYS_SOFTWARE": "1"}
        config = (CHECKOUT / "config" / "vsx_ros.rviz").read_text(encoding="utf-8")
        assert "Frame Rate: 15" in config
        slower = tmp_path / "slower.rviz"  # what would be drawn by a graphics card costs the stack its processor
        slower.write_text(config.replace("Frame Rate: 15", "Frame Rate: 2"), encoding="utf-8")
        rviz = subprocess.Popen(
            ["rviz", "-d", str(slower)], env={**stack.environment, **display}, stdout=words, stderr=words
        )
        try:
            stack.wait(listens, f"rviz to listen to {wanted}")
            stack.wait(lambda: is_drawn(shown.pixels()), "frontiers on the screen, and no display with an error", 60.0)
        finally:
            rviz.kill()
            rviz.wait()
