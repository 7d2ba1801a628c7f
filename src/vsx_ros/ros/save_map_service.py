"""The service of the node vslam that saves its map while it goes on."""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from pathlib import Path

import rospy
from std_srvs.srv import Trigger, TriggerRequest, TriggerResponse

from vsx_ros.errors import MapFileError
from vsx_ros.io.slam_map_file import save_slam_map
from vsx_ros.ros import topics
from vsx_ros.slam.slam_map import SlamMap


class SaveMapService:
    """Services: vslam/save_map (Trigger: saves the SLAM map, the answer says where)."""

    def __init__(self, slam_map: Callable[[], SlamMap | None]) -> None:
        self._default = Path(str(rospy.get_param("~run_dir", "")) or tempfile.gettempdir()) / "map.vsxmap"
        self._slam_map = slam_map
        rospy.Service(topics.SAVE_MAP, Trigger, self._on_save_map)

    def _on_save_map(self, _: TriggerRequest) -> TriggerResponse:
        slam_map = self._slam_map()
        if slam_map is None:
            return TriggerResponse(False, "there is no map yet: it starts with the first straight drive")
        path = Path(str(rospy.get_param("~save_map_to", "")) or self._default)
        try:
            save_slam_map(slam_map, path)
        except MapFileError as error:
            return TriggerResponse(False, str(error))
        return TriggerResponse(True, str(path))
