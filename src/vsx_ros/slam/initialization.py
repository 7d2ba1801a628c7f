"""Chooses two frames of a straight drive for a new map: follows corners until the second frame is far enough."""

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from vsx_ros.arrays import Pixels
from vsx_ros.config.maps import InitializationConfig
from vsx_ros.geometry.se3 import SE3
from vsx_ros.geometry.two_view_certainty import pure_rotation
from vsx_ros.kernels.geometry import unproject_pixels
from vsx_ros.robot import SILENCE_NS
from vsx_ros.slam.keyframe import FrameData
from vsx_ros.slam.odometry import motion_by_odometry
from vsx_ros.slam.point_creation import Candidates
from vsx_ros.slam.trails import Reference, Trails
from vsx_ros.slam.two_view_reconstruction import TRAIL_SIGMA_PX, InitialPair

STILL_PX = 2.0  # median motion of the corners; less is noise and vibration
BLURRED = "the image is blurred: not used to start; move more slowly or add light"
TRIED = "a map is being made of two frames"


class _Turn(NamedTuple):
    """The best pure rotation since a reference [deg], and the median flow that it leaves unexplained [px]."""

    reference: Reference
    turned_deg: float
    flow_px: float


class Initializer:
    """``add`` takes frames and returns a pair that may make a map, or the reason why there is none yet.

    needs_scale: with T_base_cam, wait for odometry however long it is silent; else begin without it after a second."""

    def __init__(self, T_base_cam: SE3 | None, config: InitializationConfig, *, needs_scale: bool = False) -> None:
        self._T_base_cam, self._config, self._needs_scale = T_base_cam, config, needs_scale
        self._trails: Trails | None = None
        self._heard_ns: int | None = None  # stamp of the newest frame with odometry; of the first frame before that
        self._tried = -1  # stamp of the reference that was proposed last

    def add(self, data: FrameData) -> InitialPair | str:
        """Follow the corners into this frame and propose it with an earlier one when they are far enough apart."""
        trails = self._trails
        if trails is None:
            return self._restart(data, "the first frame was taken; drive straight ahead")
        trails.follow(data)
        silence = self._silence(trails.references[0].data, data)
        if silence:
            return silence
        few = self._too_few(trails)
        if few:
            return self._restart(data, few)
        first = trails.references[0]
        motion = motion_by_odometry(self._T_base_cam, data, first.data)
        before, now = first.data.T_odom_base, data.T_odom_base
        if motion is None or before is None or now is None:
            outcome = self._by_images(trails, data)
            if self._trails is trails:
                trails.extend()
            return outcome
        sure = trails.straighten(first)
        refusal = self._odometry_refuses(data, before.distance_to(now), math.degrees(abs(before.angle_to(now))))
        return refusal or self._pair(trails.corners(first, sure), first.data, data, motion)

    def _silence(self, reference: FrameData, data: FrameData) -> str:
        """Why to wait or restart while one of two frames or both have no odometry (no scale); empty when both have it,
        or when it has been silent for so long that a map may begin without it."""
        had, has = reference.T_odom_base is not None, data.T_odom_base is not None
        heard_ns = reference.stamp_ns if self._heard_ns is None else self._heard_ns
        self._heard_ns = data.stamp_ns if has else heard_ns
        if self._T_base_cam is None or (had and has):
            return ""
        if has:
            return self._restart(data, "odometry is heard: starting again from here")
        waits = "odometry is silent: waiting for it"
        if data.stamp_ns - heard_ns <= SILENCE_NS:
            return waits
        if had:
            without = "odometry is silent: starting again without it, and without scale"
            return self._restart(data, waits if self._needs_scale else without)
        return waits if self._needs_scale else ""

    def _restart(self, data: FrameData, reason: str) -> str:
        self._trails = Trails(data)
        return reason

    def _too_few(self, trails: Trails) -> str:
        """Forget references that have lost their corners; the reason when none is left."""
        counts = [(len(r.rows), max(self._config.min_matches, r.began // 4)) for r in trails.references]
        followed, wanted = max(counts, key=lambda count: count[0] - count[1])
        if followed < wanted:
            return f"sees too little: {followed} corners followed, {wanted} needed"
        trails.references = [r for r, (n, least) in zip(trails.references, counts, strict=True) if n >= least]
        return ""

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

    def _by_images(self, trails: Trails, data: FrameData) -> InitialPair | str:
        """The pair with the reference that a rotation explains least, or why no reference has enough parallax yet: the
        corners rest, or a rotation explains their motion."""
        shift = max(trails.shift_px(reference) for reference in trails.references)
        if shift < STILL_PX:
            return f"camera stands still: corners moved {shift:.1f} px in all; move it sideways or ahead"
        turns = [_turn(trails, reference, data) for reference in trails.references]
        within = [turn for turn in turns if turn.turned_deg <= self._config.max_turn_deg]
        if not within:
            least = min(turn.turned_deg for turn in turns)
            return self._restart(data, f"turns: {least:.0f} deg and not aside; move the camera sideways to start")
        best = max(within, key=lambda turn: turn.flow_px)
        sure = trails.straighten(best.reference)
        wanted = self._config.min_flow_sigmas * TRAIL_SIGMA_PX
        if best.flow_px < wanted:
            trails.references = [turn.reference for turn in within]
            told = f"corners moved {best.flow_px:.1f} px of the {wanted:.1f} px needed beyond a turn by"
            why = "the camera turns in place or has not moved far enough"
            return f"too little motion: {told} {best.turned_deg:.0f} deg; {why}"
        chosen = best.reference
        if self._tried == chosen.data.stamp_ns:  # others in turn: it may be blurred, or show one plane
            chosen = min(
                within, key=lambda turn: (turn.flow_px < wanted, turn.reference.tried, -turn.flow_px)
            ).reference
            sure = trails.straighten(chosen)
        self._tried = chosen.data.stamp_ns
        trails.references = [
            turn.reference._replace(tried=turn.reference.tried + (turn.reference is chosen)) for turn in within
        ]
        return self._pair(trails.corners(chosen, sure), chosen.data, data, None)

    def _pair(
        self, corners: tuple[Candidates, Pixels], first: FrameData, data: FrameData, odometry: SE3 | None
    ) -> InitialPair | str:
        candidates, uv = corners
        if len(uv) < self._config.min_matches:
            return f"sees too little: {len(uv)} corners match an earlier frame"
        T_world_first = SE3.identity()
        if self._T_base_cam is not None and first.T_odom_base is not None:
            T_world_first = SE3.from_se2(first.T_odom_base) @ self._T_base_cam
        return InitialPair(
            first=first, second=data, T_world_first=T_world_first, odometry=odometry, candidates=candidates, uv=uv
        )


def _turn(trails: Trails, reference: Reference, data: FrameData) -> _Turn:
    rows = reference.rows
    rays = unproject_pixels(data.camera, np.ascontiguousarray(trails.positions[rows]))
    R, left = pure_rotation(reference.rays[rows], rays)
    turned_deg = math.degrees(SE3.identity().rotation_angle_to(SE3(R, np.zeros(3))))
    return _Turn(reference, turned_deg, float(np.median(left) * data.camera[:2].min()))


class Bootstrap:
    """Tries one pair of frames at a time, and follows corners meanwhile.

    tell: called with (stamp_ns, "refused", reason) when the reason changes."""

    def __init__(self, new_initializer: Callable[[], Initializer], tell: Callable[[int, str, str], None]) -> None:
        self._new_initializer, self._tell = new_initializer, tell
        self._tried: InitialPair | None = None
        self.begin_again()

    def begin_again(self) -> None:
        """Use the next frame as the first one."""
        self._initializer = self._new_initializer()
        self._refusal, self._verdict = "", TRIED

    @property
    def is_trying(self) -> bool:
        """Whether a pair is being tried."""
        return self._tried is not None

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
            self._tell(stamp_ns, "refused", reason)
        self._refusal = reason
