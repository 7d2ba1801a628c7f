"""Chooses two frames of a straight drive for a new map: follows corners until the second frame is far enough."""

import math
from collections.abc import Callable
from functools import partial

import cv2
import numpy as np

from vsx_ros.arrays import BoolArray, GrayImage, IntArray, Pixels
from vsx_ros.config.maps import InitializationConfig
from vsx_ros.geometry.se3 import SE3
from vsx_ros.geometry.two_view_certainty import pure_rotation
from vsx_ros.kernels.geometry import unproject_pixels
from vsx_ros.robot import SILENCE_NS
from vsx_ros.slam.keyframe import FrameData, KeyFrame, Observations
from vsx_ros.slam.odometry import motion_by_odometry
from vsx_ros.slam.point_creation import candidates_in
from vsx_ros.slam.two_view_reconstruction import TRAIL_SIGMA_PX, InitialPair

TRAILS = 600  # corners followed from the first frame on: several times min_matches, because many get lost
STILL_PX = 2.0  # median motion of the corners; less is noise and vibration
BLURRED = "the image is blurred: not used to start; move more slowly or add light"
TRIED = "a map is being made of two frames"


class Initializer:
    """``add`` takes frames and returns a pair that may make a map, or the reason why there is none yet."""

    def __init__(self, T_base_cam: SE3 | None, config: InitializationConfig) -> None:
        self._T_base_cam, self._config = T_base_cam, config
        self._reference: FrameData | None = None

    def add(self, data: FrameData) -> InitialPair | str:
        """Follow the reference frame's corners into this frame and propose the two when they are far enough apart."""
        reference = self._reference
        if reference is None:
            return self._restart(data, "the first frame was taken; drive straight ahead")
        self._follow(reference, data)
        silence = self._silence(reference, data)
        if silence:
            return silence
        wanted = max(self._config.min_matches, len(self._candidates.uv) // 4)
        if len(self._index) < wanted:
            return self._restart(data, f"sees too little: {len(self._index)} corners followed, {wanted} needed")
        motion = motion_by_odometry(self._T_base_cam, data, reference)
        before, now = reference.T_odom_base, data.T_odom_base
        if motion is None or before is None or now is None:
            refusal = self._too_early(data)
        else:
            refusal = self._odometry_refuses(data, before.distance_to(now), math.degrees(abs(before.angle_to(now))))
        return refusal or self._pair(reference, data, motion)

    def _silence(self, reference: FrameData, data: FrameData) -> str:
        """Why to wait or restart when only one of two frames has odometry (no scale); empty otherwise."""
        had, has = reference.T_odom_base is not None, data.T_odom_base is not None
        if has:
            self._heard_ns = data.stamp_ns
        if self._T_base_cam is None or had == has:
            return ""
        if has:
            return self._restart(data, "odometry is heard again: starting again from here")
        if data.stamp_ns - self._heard_ns > SILENCE_NS:
            return self._restart(data, "odometry is silent: starting again without it, and without scale")
        return "odometry is silent: waiting for it"

    def _restart(self, data: FrameData, reason: str) -> str:
        keyframe = KeyFrame(
            id=0, data=data, T_world_cam=SE3.identity(), observations=Observations.none(), median_depth=0.0
        )
        self._reference = self._last = data
        self._heard_ns = data.stamp_ns
        self._candidates = candidates_in(keyframe, TRAILS)
        self._index: IntArray = np.arange(len(self._candidates.uv))
        self._positions: Pixels = self._candidates.uv.copy()
        return reason

    def _follow(self, reference: FrameData, data: FrameData) -> None:
        """Follow the corners into this frame, then match them with the reference frame so that they do not drift."""
        before, now = self._last.pyramid.level(0), data.pyramid.level(0)
        moved, ok = _flow(before, now, self._positions, self._positions)
        self._index, moved = self._index[ok], moved[ok]
        start = self._candidates.uv[self._index]
        direct, sure = _flow(reference.pyramid.level(0), now, start, moved)
        sure &= np.linalg.norm(direct - moved, axis=1) < 3.0
        self._positions = np.where(sure[:, None], direct, moved)
        self._sure: BoolArray = sure
        self._last = data

    def _odometry_refuses(self, data: FrameData, driven: float, turned: float) -> str:
        config = self._config
        if turned > config.max_turn_deg:
            return self._restart(data, f"turns: {turned:.0f} deg over {driven:.2f} m; drive straight to start")
        if driven > config.baseline_max_m:
            return self._restart(data, f"no start: {driven:.2f} m driven straight in vain; trying again from here")
        if driven < 0.01:
            return "stands still: the wheels have not moved; drive straight ahead to start"
        if driven < config.baseline_m:
            return f"not far enough: has driven {driven:.2f} m of the {config.baseline_m:.2f} m needed to start"
        return ""

    def _too_early(self, data: FrameData) -> str:
        """Why the corners have no parallax yet (they rest, or a rotation explains their motion); else empty."""
        shift = float(np.median(np.linalg.norm(self._positions - self._candidates.uv[self._index], axis=1)))
        if shift < STILL_PX:
            return f"camera stands still: corners moved {shift:.1f} px in all; move it sideways or ahead"
        rays = unproject_pixels(data.camera, np.ascontiguousarray(self._positions))
        R, left = pure_rotation(self._candidates.rays[self._index], rays)
        turned = math.degrees(SE3.identity().rotation_angle_to(SE3(R, np.zeros(3))))
        flow, wanted = float(np.median(left)) * float(data.camera[0]), self._config.min_flow_sigmas * TRAIL_SIGMA_PX
        if turned > self._config.max_turn_deg:
            return self._restart(data, f"turns: {turned:.0f} deg and not aside; move the camera sideways to start")
        if flow < wanted:
            told = f"corners moved {flow:.1f} px of the {wanted:.1f} px needed beyond a turn by {turned:.0f} deg"
            return f"too little motion: {told}; the camera turns in place or has not moved far enough"
        return ""

    def _pair(self, reference: FrameData, data: FrameData, odometry: SE3 | None) -> InitialPair | str:
        index = self._index[self._sure]
        if len(index) < self._config.min_matches:
            return f"sees too little: {len(index)} corners match the first frame"
        T_world_first = SE3.identity()
        if self._T_base_cam is not None and reference.T_odom_base is not None:
            T_world_first = SE3.from_se2(reference.T_odom_base) @ self._T_base_cam
        uv = np.ascontiguousarray(self._positions[self._sure])
        return InitialPair(
            first=reference,
            second=data,
            T_world_first=T_world_first,
            odometry=odometry,
            candidates=self._candidates,
            chosen=index,
            uv=uv,
        )


def _flow(before: GrayImage, now: GrayImage, start: Pixels, guess: Pixels) -> tuple[Pixels, BoolArray]:
    """Pyramidal Lucas-Kanade with a backward check: (positions (N, 2), kept (N,))."""
    if not len(start):
        return guess, np.zeros(0, np.bool_)
    enough, flags = (cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, 20, 0.01), cv2.OPTFLOW_USE_INITIAL_FLOW
    flow = partial(cv2.calcOpticalFlowPyrLK, winSize=(15, 15), maxLevel=3, criteria=enough, flags=flags)
    a, b = start.astype(np.float32), guess.astype(np.float32)
    forward, ok, _ = flow(before, now, a, b.copy())
    back, ok_back, _ = flow(now, before, forward, a.copy())
    height, width = now.shape
    inside = (forward >= 4).all(axis=1) & (forward[:, 0] < width - 5) & (forward[:, 1] < height - 5)
    close = np.linalg.norm(back - a, axis=1) < 0.7
    return forward.astype(np.float64), (ok.ravel() > 0) & (ok_back.ravel() > 0) & inside & close


class Bootstrap:
    """Tries one pair of frames at a time, and follows corners meanwhile.

    refuse: called with (stamp_ns, reason) when the reason changes."""

    def __init__(
        self, T_base_cam: SE3 | None, config: InitializationConfig, refuse: Callable[[int, str], None]
    ) -> None:
        self._new_initializer = partial(Initializer, T_base_cam, config)
        self._refuse = refuse
        self._tried: InitialPair | None = None
        self.begin_again()

    def begin_again(self) -> None:
        """Use the next frame as the first one."""
        self._initializer = self._new_initializer()
        self._refusal, self._verdict = "", TRIED

    def next_pair(self, data: FrameData) -> tuple[str, InitialPair | None]:
        """(why there is no map yet, the pair to make one from or None)."""
        outcome = BLURRED if data.blurred else self._initializer.add(data)
        if self._tried is not None:
            return self._verdict, None
        if isinstance(outcome, str):
            self._say(data.stamp_ns, outcome)
            return outcome, None
        return self._verdict, self.claim(outcome)

    def claim(self, pair: InitialPair | None) -> InitialPair | None:
        """The pair, unless another one is being tried."""
        if self._tried is not None:
            return None
        self._tried = pair
        return pair

    def done(self) -> InitialPair:
        """End the trial of the pair and return it."""
        pair, self._tried = self._tried, None
        assert pair is not None
        return pair

    def refused(self, reason: str) -> None:
        """The pair that was tried did not become a map."""
        self._verdict = reason
        self._say(self.done().second.stamp_ns, reason)

    def _say(self, stamp_ns: int, reason: str) -> None:
        if reason.split(":")[0] != self._refusal.split(":")[0]:
            self._refuse(stamp_ns, reason)
        self._refusal = reason
