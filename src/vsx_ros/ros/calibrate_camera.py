"""``vsx calibrate camera --live``."""

import signal
import sys
import threading

import numpy as np
import rospy
from sensor_msgs.msg import Image
from sensor_msgs.srv import SetCameraInfo

from vsx_ros.arrays import Pixels
from vsx_ros.calibration.board import Board
from vsx_ros.calibration.camera import MIN_VIEWS, BoardView, ViewChooser, calibrate_camera
from vsx_ros.calibration.verdict import Grade
from vsx_ros.errors import InputError
from vsx_ros.robot import Frame
from vsx_ros.ros import calls, headers, images, operator_command, topics
from vsx_ros.ros.callbacks import image_subscriber, refusal
from vsx_ros.runs.process import DONE, FAILED, Progress, SignalFlag

_STILL_PX, _STILL_S = 2.0, 0.5  # more motion between looks: the hand moves; longer gaps tell nothing
_FIRST_IMAGE_S, _SERVICE_S = 10.0, 5.0  # a driver may still be starting; set_camera_info writes a file


class BoardWatcher:
    """Checks the newest image repeatedly. Keeps views in which the board is still and which add something new."""

    def __init__(self, board: Board) -> None:
        self._board, self._frames = board, images.Frames()
        self._arrived = threading.Condition()
        self._newest: Frame | None = None
        self._before: tuple[int, Pixels] | None = None
        self.chooser: ViewChooser | None = None
        self.size = (0, 0)
        image_subscriber(self._on_image)

    def _on_image(self, msg: Image) -> None:
        frame = self._frames.of(msg)
        with self._arrived:
            self._newest = frame
            self._arrived.notify()

    def look(self, wait_s: float) -> str:
        """Describes in words what the next image shows. Raises InputError when none comes within ``wait_s``."""
        with self._arrived:
            if not self._arrived.wait_for(lambda: self._newest is not None, wait_s) or self._newest is None:
                topic = rospy.resolve_name(topics.IMAGE)
                silent = f"no image arrives on {topic}; is the camera running? 'vsx status' tells"
                raise InputError(refusal(topics.IMAGE) or silent)
            frame, self._newest = self._newest, None
        height, width = frame.image.shape
        if self.chooser is None or (width, height) != self.size:
            self.size, self.chooser = (width, height), ViewChooser(self._board, width, height)
        pixels = self._board.find(frame.image, quick=True)
        if pixels is None:
            self._before = None
            return "no board in sight"
        before, self._before = self._before, (frame.stamp_ns, pixels)
        recent = before is not None and frame.stamp_ns - before[0] <= _STILL_S * 1e9
        if before is None or not recent or np.abs(pixels - before[1]).max() > _STILL_PX:
            return "hold it still"
        name = f"view {len(self.chooser.views) + 1}"
        return f"{name} taken" if self.chooser.offer(BoardView(name, pixels)) else "seen like this before"


@operator_command.command
def calibrate(board: Board, model: str) -> int:
    """Collect views until none is missing or Ctrl-C; calibrate and store through the camera node."""
    operator_command.join("calibrate")
    ended = SignalFlag(signal.SIGINT, signal.SIGTERM)
    progress = Progress(sys.stderr)
    watcher = BoardWatcher(board)
    while not ended.came and not rospy.is_shutdown():
        said = watcher.look(_FIRST_IMAGE_S)
        assert watcher.chooser is not None
        missing, count = watcher.chooser.missing(), len(watcher.chooser.views)
        if said.endswith("taken"):
            progress.say(f"{said}; still wanted: {', '.join(missing) or 'nothing'}")
        elif progress.is_due:
            progress.show(f"{count} views, {said}. Show it {missing[0] if missing else ''}; Ctrl-C ends")
        if not missing:
            break
    if watcher.chooser is None or len(watcher.chooser.views) < MIN_VIEWS:
        raise InputError(f"ended with too few views of the board, {MIN_VIEWS} are needed; nothing is stored")
    result = calibrate_camera(board, watcher.chooser.views, *watcher.size, model)
    sys.stdout.write("\n  ".join([f"{len(watcher.chooser.views)} views", *result.report()]) + f"\n{result.verdict}\n")
    if result.verdict.grade is Grade.BAD:
        sys.stdout.write("  it is not stored\n")
        return FAILED
    info = images.camera_info(result.camera, headers.now_ns(), topics.OPTICAL_FRAME)
    service = rospy.resolve_name(topics.SET_CAMERA_INFO)
    try:
        answer = calls.service(service, SetCameraInfo, info, within_s=_SERVICE_S)
    except (rospy.ROSException, rospy.ServiceException) as error:
        raise InputError(f"{service} does not store it ({error}); record a bag and calibrate from that") from error
    if not answer.success:
        raise InputError(f"{service} does not store it: {answer.status_message}")
    sys.stdout.write(f"  the camera node has {answer.status_message} and uses it now; start vslam anew if it runs\n")
    return DONE
