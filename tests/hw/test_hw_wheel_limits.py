"""No wheel is told more than its robot drives, and the odometry knows what the wheels were told."""

import struct

import pytest

from vsx_hw.bases import BASES
from vsx_hw.create.driver import Create1Dialect
from vsx_hw.create.protocol import Mode, Opcode
from vsx_hw.kobuki.driver import KobukiDialect
from vsx_hw.kobuki.protocol import WHEEL_BASE_M, BaseControl, FrameScanner, sub_payloads, twist_of

ROUNDING_M_S = 0.003
MS = 1_000_000


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


@pytest.mark.parametrize("kind", ["create", "create2"])
@pytest.mark.parametrize(("v", "omega"), [(0.5, 1.5), (-0.5, 1.0), (0.0, 6.0), (0.3, 0.5)])
def test_a_create_s_odometry_hears_what_its_wheels_were_told(kind, v, omega, told):
    dialect, base_m = BASES[kind].dialect(1.0, 1.0), BASES[kind].wheel_base_m
    heard = told(dialect)
    dialect._mode = Mode.SAFE
    data = dialect.drive(v, omega)
    assert data[0] == Opcode.DRIVE_DIRECT
    right, left = (0.001 * speed for speed in struct.unpack_from(">hh", data, 1))
    assert heard == [pytest.approx((0.5 * (left + right), (right - left) / base_m), abs=0.005)]


def test_a_create_1_turns_in_its_odometry_as_its_saturated_wheels_do():
    dialect = Create1Dialect()
    list(dialect.hello())
    dialect._mode = Mode.SAFE
    right, left = struct.unpack_from(">hh", dialect.drive(0.5, 1.5), 1)
    assert dialect.odometry.reading(20 * MS).omega_rad_s == pytest.approx(0.001 * (right - left) / 0.258, rel=0.02)
