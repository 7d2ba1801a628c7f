"""After which silence somebody who wants motion counts as gone."""

import math
import statistics
from collections import deque

LEASE_S = 0.3  # A client must renew its wish for motion again and again; after this silence it counts as gone
_MOST_S = 0.7  # longest lease of vslam
_USUAL_S = 0.1  # between two images; the limits of the speed are for this
_SLOW_S = 0.16  # between two images: only a slower computer needs a longer lease, and others stop as fast as promised
_REMEMBERED, _LEAST = 12, 4  # last times between images; the mean of their third quarter counts, so single ones do not
_LATE, _GONE = 1.3, 2.5  # times the usual time between images: one is late; a second one, too
_BRAKING_S = 0.25  # about what a gentle stop takes from the speeds at such rates
_ALIKE = 1.2  # Smaller changes of the rate do not change the speed


class ImageLease:
    """The lease of vslam, which renews it with every image that it uses.

    At 6 images a second and more it ends after LEASE_S. A slow computer needs longer for an image. Then the lease
    lasts for two and a half images, at most 0.7 s, and the base brakes gently before its end. It drives so slowly that
    its way between two images is about the same as at 10 a second."""

    def __init__(self) -> None:
        self._periods_s: deque[float] = deque(maxlen=_REMEMBERED)
        self._renewed_ns, self._age_s = -1, math.inf
        self.speed_share = 1.0
        """The speed that is safe, as a share of the planned one."""

    def see(self, now_ns: int, age_s: float) -> None:
        """age_s: of the newest renewal [s]; infinite before the first. Call it 10 times a second or more, or with each
        image."""
        is_renewed, self._age_s = age_s <= self._age_s and math.isfinite(age_s), age_s
        if not is_renewed:
            return
        before_ns, self._renewed_ns = self._renewed_ns, now_ns - round(1e9 * age_s)
        if 0 <= before_ns < self._renewed_ns:
            self._periods_s.append(1e-9 * (self._renewed_ns - before_ns))
        share = _USUAL_S / self._period_s
        if share == 1.0 or not 1.0 / _ALIKE < share / self.speed_share < _ALIKE:
            self.speed_share = share

    @property
    def _period_s(self) -> float:
        if len(self._periods_s) < _LEAST:
            return _USUAL_S
        in_order, n = sorted(self._periods_s), len(self._periods_s)
        return max(_USUAL_S, statistics.fmean(in_order[n // 2 : n - n // 4]))

    @property
    def length_s(self) -> float:
        """After this silence the base must stand [s]."""
        return LEASE_S if self._period_s < _SLOW_S else min(_MOST_S, _GONE * self._period_s)

    @property
    def is_late(self) -> bool:
        """Whether the base has to brake gently now, to stand when the lease ends."""
        return self._age_s > max(LEASE_S, min(_LATE * self._period_s, self.length_s - _BRAKING_S))

    @property
    def is_over(self) -> bool:
        """Whether vslam counts as gone."""
        return self._age_s > self.length_s
