"""A gyro whose drift grows slowly, as in a sensor that warms up: it is told, and never learned as a trait of the
wheels."""

import math

import pytest

from vsx_hw.plausibility import CheckedMotion, MotionCheck

PERIOD_S, WHEEL_BASE_M = 0.02, 0.23
LEARNED_S = 30.0  # of driving before the drift begins
MOTIONS = {
    "line": (0.2, 0.0),
    "reverse": (-0.2, 0.0),
    "left arc": (0.2, 0.4),
    "right arc": (0.2, -0.4),
    "left arc in reverse": (-0.2, 0.4),
    "right arc in reverse": (-0.2, -0.4),
    "spot turn": (0.0, 0.4),
    "fast line": (0.4, 0.0),
    "standing": (0.0, 0.0),
}


class DriftingBase:
    """A check that is fed with a steady motion (v [m/s], omega [rad/s]) and a gyro that drifts.

    off_rad: error of the trusted heading. scales: (left, right) counted per rolled way."""

    def __init__(self, v: float, omega: float, scales: tuple[float, float] = (1.0, 1.0)) -> None:
        self.check, self.omega, self._steps = MotionCheck(WHEEL_BASE_M), omega, 0
        self.check.command(v, omega)
        half = 0.5 * WHEEL_BASE_M * omega
        self._left_m, self._right_m = scales[0] * (v - half) * PERIOD_S, scales[1] * (v + half) * PERIOD_S
        self.off_rad = 0.0

    def step(self, drift_rad_s: float) -> CheckedMotion:
        self._steps += 1
        gyro_rad = (self.omega + drift_rad_s) * PERIOD_S
        told = self.check.step(round(self._steps * PERIOD_S * 1e9), self._left_m, self._right_m, gyro_rad)
        self.off_rad += 0.0 if told.doubt else told.turn_rad - self.omega * PERIOD_S
        return told

    def told_at(self, rad_s_per_s: float, seconds: float) -> float | None:
        """The drift [rad/s] at which it is told; None if never. It grows after ``LEARNED_S``."""
        for k in range(round((LEARNED_S + seconds) / PERIOD_S)):
            drift_rad_s = max(0.0, k * PERIOD_S - LEARNED_S) * rad_s_per_s
            if self.step(drift_rad_s).doubt:
                return drift_rad_s
        return None


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize(("deg_s_per_s", "most_deg_s", "most_deg"), [(0.3, 5.0, 40.0), (1.0, 4.0, 8.0)])
@pytest.mark.parametrize("motion", MOTIONS)
def test_a_growing_drift_is_told(motion, deg_s_per_s, most_deg_s, most_deg, sign):
    base = DriftingBase(*MOTIONS[motion])
    drift_rad_s = base.told_at(sign * math.radians(deg_s_per_s), 60.0)
    assert drift_rad_s is not None
    assert abs(drift_rad_s) < math.radians(most_deg_s)
    assert abs(base.off_rad) < math.radians(most_deg)


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize(
    ("motion", "most_deg_s"), [("line", 5.0), ("left arc", 10.0), ("right arc", 10.0), ("fast line", 14.0)]
)
def test_what_is_learned_has_a_limit_however_slowly_it_comes(motion, most_deg_s, sign):
    base = DriftingBase(*MOTIONS[motion])
    drift_rad_s = base.told_at(sign * math.radians(0.1), 150.0)
    assert drift_rad_s is not None
    assert abs(drift_rad_s) < math.radians(most_deg_s)


@pytest.mark.parametrize("scales", [(1.1, 1.0), (1.0, 1.1), (0.95, 1.05), (1.1, 1.1), (0.9, 0.9)])
@pytest.mark.parametrize("motion", ["fast line", "left arc", "right arc in reverse", "spot turn"])
def test_wheels_that_are_off_by_a_tenth_are_learned(motion, scales):
    assert DriftingBase(*MOTIONS[motion], scales).told_at(0.0, 30.0) is None


@pytest.mark.parametrize(("deg_s", "within_s"), [(0.2, None), (-0.2, None), (0.6, 8.0), (1.0, 3.0), (-1.5, 2.0)])
def test_a_small_drift_is_told_while_the_base_stands(deg_s, within_s):
    base = DriftingBase(0.0, 0.0)
    doubts = [base.step(math.radians(deg_s)).doubt for _ in range(round(60.0 / PERIOD_S))]
    if within_s is None:
        assert set(doubts) == {""}
        return
    first = next(k for k, doubt in enumerate(doubts) if doubt)
    assert first * PERIOD_S < within_s
    assert all(doubts[first:]), "nothing has shown since that it is right"


@pytest.mark.parametrize("omega", [0.0, 0.4])
def test_a_gyro_left_out_stays_left_out_however_fast_it_turns(omega):
    """Until each report contradicts the wheels: they are not what jumps."""
    base = DriftingBase(0.2 if omega else 0.0, omega)
    doubted = []
    for k in range(round(40.0 / PERIOD_S)):
        told = base.step(math.radians(10.0) * k * PERIOD_S)
        if told.doubt:
            doubted.append(told)
    assert len(doubted) > 1000
    assert not any("counters" in told.doubt for told in doubted)
    assert not any(told.gyro for told in doubted)
    assert all(told.turn_rad == pytest.approx(omega * PERIOD_S) for told in doubted)
