"""The parent's end of the rendering process, see ``render_process``."""

from __future__ import annotations

import contextlib
import json
import os
import subprocess
import sys
import threading
from collections.abc import Callable
from typing import Any

import msgspec
import rospy

from vsx_ros.ros.emulation import BodyState
from vsx_ros.ros.render_process import POSE, RenderSettings


class RenderChild:
    """Gets ``move``, gives one dictionary for each image to ``on_frame``, on a thread of its own. When the child ends
    without being asked, so does the node."""

    def __init__(self, settings: RenderSettings, on_frame: Callable[[dict[str, Any]], None]) -> None:
        self._on_frame = on_frame
        self._closing = False
        environment = {**os.environ, "PYTHONPATH": os.pathsep.join(p for p in sys.path if p)}
        command = [sys.executable, "-m", "vsx_ros.ros.render_process", msgspec.json.encode(settings).decode()]
        pipe = subprocess.PIPE
        self._process = subprocess.Popen(command, stdin=pipe, stdout=pipe, env=environment, bufsize=0)
        assert self._process.stdin is not None
        self._poses = self._process.stdin
        threading.Thread(target=self._listen, name="frames", daemon=True).start()

    def move(self, state: BodyState) -> None:
        """Tell the camera where the base is."""
        pose = state.T_world_base
        with contextlib.suppress(OSError):
            self._poses.write(POSE.pack(state.time_ns, pose.x, pose.y, pose.theta, state.path_length_m))

    def _listen(self) -> None:
        assert self._process.stdout is not None
        for line in iter(self._process.stdout.readline, b""):
            self._on_frame(json.loads(line))
        if not self._closing:
            rospy.logfatal("the rendering process has ended")
            rospy.signal_shutdown("no camera")

    def close(self) -> None:
        """End the child."""
        self._closing = True
        self._poses.close()
        try:
            self._process.wait(timeout=2.0)
        except subprocess.TimeoutExpired:
            self._process.kill()
