"""Bootstrapping: which frames are tried before there is a map, and what is said meanwhile."""

from __future__ import annotations

from collections.abc import Callable

from vsx_ros.config import InitializationConfig
from vsx_ros.geometry.se3 import SE3
from vsx_ros.slam.initialization import Initializer
from vsx_ros.slam.keyframe import FrameData
from vsx_ros.slam.two_view_reconstruction import InitialPair

BLURRED = "the image is blurred: not used to start; move more slowly or add light"
TRIED = "a map is being made of two frames"


class Bootstrap:
    """One pair of frames is tried at a time, however long that takes; corners are followed all the while.

    refuse: told (stamp_ns, reason) when it is another reason than before.
    """

    def __init__(
        self, T_base_cam: SE3 | None, config: InitializationConfig, refuse: Callable[[int, str], None]
    ) -> None:
        self._initializer = Initializer(T_base_cam, config)
        self._refuse = refuse
        self._refusal, self._verdict = "", TRIED
        self._tried: InitialPair | None = None

    def next_pair(self, data: FrameData) -> tuple[str, InitialPair | None]:
        """(why there is no map yet, the pair to make it of)."""
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
        """The pair that was tried, and is no longer."""
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
