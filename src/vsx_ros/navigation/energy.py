"""How long the battery lasts, when to drive to the dock, and when the base is charged enough to go on."""

import math
from enum import Enum

from vsx_ros.config import DockingConfig
from vsx_ros.navigation.docking_state import DockingState

_PRIOR_S = 1200.0  # the expected consumption counts as much as so long a measurement
_LONGEST_S = 3600.0  # older consumption is gradually forgotten
_FAR_M, _MEAN_M_S = 5.0, 0.15  # assumed way while none is known; speed over stops and turns
_TRY_AGAIN_NS = 60_000_000_000


class EnergyMeter:
    """Learns the consumption. drain_per_s: share of the battery; left_s: until it is empty, None before the first
    reading or while it charges."""

    def __init__(self, config: DockingConfig) -> None:
        self._measured_s, self._dropped = _PRIOR_S, _PRIOR_S / (3600.0 * config.battery_h)
        self._begun: tuple[int, float] | None = None  # time and fraction since which it discharges
        self._now = (0, math.nan)
        self._charges = False

    def add(self, now_ns: int, fraction: float, charging: bool) -> None:
        """A reading of the battery; NaN is ignored."""
        if math.isnan(fraction):
            return
        if charging or self._begun is None or self._charges:
            self._learn()
            self._begun = None if charging else (now_ns, fraction)
        self._now, self._charges = (now_ns, fraction), charging

    def _learn(self) -> None:
        """Take over what was measured until now: a discharge has ended."""
        self._measured_s, self._dropped = self._total()
        share = min(1.0, _LONGEST_S / self._measured_s)
        self._measured_s, self._dropped = share * self._measured_s, share * self._dropped
        self._begun = None

    def _total(self) -> tuple[float, float]:
        if self._begun is None:
            return self._measured_s, self._dropped
        then_ns, fraction = self._begun
        # The voltage falls and rises with the load: a battery that seems to fill while it drains tells nothing.
        # And a clock that is set back must not shorten what was measured.
        measured_s, dropped = max(0.0, 1e-9 * (self._now[0] - then_ns)), max(0.0, fraction - self._now[1])
        return self._measured_s + measured_s, self._dropped + dropped

    @property
    def drain_per_s(self) -> float:
        """Share of the battery per second."""
        measured_s, dropped = self._total()
        return dropped / measured_s

    @property
    def left_s(self) -> float | None:
        """See above."""
        fraction = self._now[1]
        return None if self._charges or math.isnan(fraction) else fraction / self.drain_per_s


class Errand(Enum):
    """What the battery wants."""

    DOCK = "dock"
    UNDOCK = "undock"


class ChargeKeeper:
    """Sends the base to its dock in time, with a reserve, and off it when it is charged. A base that somebody else has
    docked stays there. reason: of the last errand. sent: whether the base docks, or stands docked, for the battery;
    whoever has it docked for another reason sets it to False."""

    def __init__(self, config: DockingConfig) -> None:
        self._config, self.meter = config, EnergyMeter(config)
        self._fraction, self._charging = math.nan, False
        self._not_before_ns = 0
        self.reason, self.sent = "", False

    def add(self, now_ns: int, fraction: float, charging: bool) -> None:
        """A reading of the battery. charging: current flows, or it is full."""
        self._fraction, self._charging = fraction, charging
        self.meter.add(now_ns, fraction, charging)

    def needed_s(self, way_m: float | None) -> float:
        """Time to keep for the way to the dock [m] (None: unknown), with the reserve."""
        return self._config.reserve_s + 1.5 * (_FAR_M if way_m is None else way_m) / _MEAN_M_S

    def put_off(self, now_ns: int) -> None:
        """Somebody has another use for the base: the battery waits a minute."""
        self._not_before_ns = now_ns + _TRY_AGAIN_NS

    def errand(self, now_ns: int, state: DockingState, way_m: float | None) -> Errand | None:
        """What to begin now, if anything. state: of the docking."""
        if math.isnan(self._fraction):
            return None
        if state is DockingState.DOCKED:
            self._not_before_ns = 0
            if not self.sent or self._fraction < self._config.charged_ratio:
                return None
            self.sent, self.reason = False, f"charged to {self._fraction:.0%}"
            return Errand.UNDOCK
        self.sent = self.sent and not state.rests  # else the docking has failed or was ended
        left_s = self.meter.left_s
        if self._charging or left_s is None or not state.rests or now_ns < self._not_before_ns:
            return None
        usable_s = left_s - self._config.reserve_ratio / self.meter.drain_per_s
        if usable_s > self.needed_s(way_m):
            return None
        self.sent, self._not_before_ns = True, now_ns + _TRY_AGAIN_NS
        left_min, way_min = left_s / 60.0, self.needed_s(way_m) / 60.0
        self.reason = f"the battery lasts {left_min:.0f} min ({self._fraction:.0%}); {way_min:.0f} min are for the way"
        return Errand.DOCK
