"""The rviz configuration shows topics that exist, with displays that can show them."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("rospy")

import yaml

from vsx_ros.ros import topics

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


@pytest.fixture
def manager() -> dict[str, Any]:
    text = (CHECKOUT / "config" / "vsx_ros.rviz").read_text(encoding="utf-8")
    return dict(yaml.safe_load(text)["Visualization Manager"])


def displayed(manager: dict[str, Any]) -> Iterator[tuple[str, str]]:
    for display in manager["Displays"]:
        for key in ("Topic", "Marker Topic", "Image Topic"):
            if key in display:
                yield display[key], display["Class"]


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
