"""Goals of users in other frames than the map."""

from vsx_ros.control.localization import LocalizationState
from vsx_ros.errors import InputError
from vsx_ros.geometry.se2 import SE2
from vsx_ros.robot import BASE_FRAME, BODY_FRAME, MAP_FRAME, ODOM_FRAME


def in_map(pose: SE2, frame: str, where: LocalizationState) -> SE2:
    """The pose in the map, from where the robot is now. frame: map, odom, base_footprint or base_link. Raises
    InputError for any other frame, and while the robot does not know where it is in the map."""
    if frame == MAP_FRAME:
        return pose
    if frame not in (ODOM_FRAME, BASE_FRAME, BODY_FRAME):
        raise InputError(f"goals are in map, odom, base_footprint or base_link, not in frame {frame!r}")
    T_map_base, T_frame_base = where.T_map_base, where.T_odom_base if frame == ODOM_FRAME else SE2()
    if T_map_base is None or T_frame_base is None:
        raise InputError(
            f"a goal in frame {frame!r} is planned in the map, and the robot does not know yet where it is there; wait "
            "until the camera tracks, or drive by hand"
        )
    return T_map_base @ T_frame_base.inverse() @ pose
