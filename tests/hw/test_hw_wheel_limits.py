"""No wheel is told more than its robot drives, and the odometry knows what the wheels were told."""

import struct

import pytest

from vsx_hw.kobuki.driver import KobukiDialect
from vsx_hw.kobuki.protocol import WHEEL_BASE_M, BaseControl, FrameScanner, sub_payloads, twist_of

ROUNDING_M_S = 0.003


@pytest.fixture
def told(monkeypatch):
    """The latest (v, omega) that the odometry of a dialect heard of."""

    def listen(dialect) -> list[tuple[float, float]]:
        heard = []
        monkeypatch.setattr(dialect.odometry, "command", lambda v, omega: heard.append((v, omega)))
        return heard

    return listen


@pytest.mark.parametrize(("v", "omega"), [(0.7, 1.5), (0.5, 1.5), (-0.7, 3.2), (0.0, 8.0), (2.0, 0.0)])
def test_a_kobuki_keeps_its_0_7_m_s_and_the_curve(v, omega, told):
    dialect = KobukiDialect()
    heard = told(dialect)
    for _ in range(20):
        (payload,) = FrameScanner().feed(dialect.drive(v, omega))
        driven_v, driven_omega = twist_of(BaseControl(*struct.unpack("<hh", dict(sub_payloads(payload))[1])))
        assert abs(driven_v) + 0.5 * WHEEL_BASE_M * abs(driven_omega) <= 0.7 + ROUNDING_M_S
        assert (driven_v, driven_omega) == pytest.approx(heard[-1], abs=0.03)
    assert heard[-1][0] * omega == pytest.approx(heard[-1][1] * v)
