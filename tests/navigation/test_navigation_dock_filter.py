"""The filter finds the dock from the light along a path; what it believes of the light keeps the dock's symmetry."""

import math

import numpy as np
import pytest

from vsx_ros.config import DockingConfig
from vsx_ros.geometry.se2 import SE2, wrap_angle
from vsx_ros.navigation.dock_filter import DockFilter
from vsx_ros.navigation.dock_light import DOCK_LIGHTS, DockBeam, DockLight, DockSight
from vsx_ros.navigation.dock_moves import LookAround, creep, towards

KINDS = sorted(DOCK_LIGHTS)
MIRRORED = {DockBeam.LEFT: DockBeam.RIGHT, DockBeam.NEAR_LEFT: DockBeam.NEAR_RIGHT}
MIRRORED |= {right: left for left, right in MIRRORED.items()}


def sight(light: DockLight, T_odom_dock: SE2, base: SE2, rng: np.random.Generator) -> DockSight:
    """One reading that the light allows."""
    dock = base.inverse() @ T_odom_dock
    chances = light.chances(dock.as_array()[None])[0]
    bits = [0, 0, 0]
    for receiver, row in zip(light.receivers, chances):
        bits[receiver.number] = sum(int(b.bit) for b, p in zip(light.beams, row) if rng.random() < p)
    return DockSight(*bits)


def along(light: DockLight, found: DockFilter, dock: SE2, rng: np.random.Generator) -> None:
    """Look to both sides at 0.8 m, then drive 0.4 m towards the dock."""
    headings = np.concatenate([np.linspace(0.0, 0.9, 20), np.linspace(0.9, -0.9, 40), np.linspace(-0.9, 0.0, 20)])
    for turned in headings:
        base = dock @ SE2(0.8, 0.1, math.pi + turned)
        for _ in range(5):
            found.add(base, sight(light, dock, base, rng))
    for ahead in np.linspace(0.0, 0.4, 30):
        base = dock @ SE2(0.8 - ahead, 0.1 - 0.2 * ahead, math.pi)
        for _ in range(5):
            found.add(base, sight(light, dock, base, rng))


@pytest.mark.parametrize("kind", KINDS)
def test_a_dock_20_cm_and_15_deg_off_is_found(kind):
    light, rng = DOCK_LIGHTS[kind], np.random.default_rng(4)
    dock, errors = SE2(3.0, -1.0, 2.0), []
    for seed in range(6):
        found = DockFilter(light, np.random.default_rng(seed))
        found.restart(dock @ SE2(0.14, -0.14, 0.26), 0.15, 0.25)
        along(light, found, dock, rng)
        off = dock.inverse() @ found.estimate().T_odom_dock
        errors.append((abs(off.y), abs(off.theta)))
        assert found.seen > 20
    beside, askew = np.median(np.array(errors), axis=0)
    assert 0.001 < beside < (0.09 if kind == "create" else 0.05), "a Create 1 has no receiver that tells a direction"
    assert 0.001 < askew < 0.2


def test_readings_of_one_place_count_once_however_many_they_are():
    light = DOCK_LIGHTS["kobuki"]
    found = DockFilter(light, np.random.default_rng(1))
    found.restart(SE2(), 0.2, 0.3)
    before = found.estimate()
    for _ in range(500):
        found.add(SE2(1.0, 0.0, math.pi), DockSight(centre=int(DockBeam.CENTER)))
    assert found.estimate().T_odom_dock == before.T_odom_dock
    assert found.seen == 0
    found.add(SE2(0.97, 0.0, math.pi), DockSight())
    assert found.seen == 1
    assert found.estimate().sigma_rad < before.sigma_rad


def test_a_contact_tells_the_distance():
    found = DockFilter(DOCK_LIGHTS["create"], np.random.default_rng(2))
    found.restart(SE2(-0.1, 0.0, 0.0), 0.1, 0.1)
    found.touched(SE2(0.21, 0.0, math.pi), 0.21)
    near = found.estimate().T_odom_dock
    assert math.hypot(near.x - 0.21, near.y) == pytest.approx(0.21)


@pytest.mark.parametrize("kind", KINDS)
def test_the_light_is_symmetric_about_the_axis(kind):
    light, rng = DOCK_LIGHTS[kind], np.random.default_rng(3)
    docks = rng.uniform([-1.0, -1.0, -3.0], [2.0, 1.0, 3.0], (200, 3))
    there = light.chances(docks)
    mirrored = light.chances(docks * [1.0, -1.0, -1.0])
    numbers = [receiver.number for receiver in light.receivers]
    receivers = [numbers.index(2 - number) for number in numbers]
    bits = [beam.bit for beam in light.beams]
    beams = [bits.index(MIRRORED.get(bit, bit)) for bit in bits]
    assert there == pytest.approx(mirrored[:, receivers][:, :, beams], abs=1e-12)
    assert 0.0 <= there.min() < 0.01
    assert 0.9 < there.max() <= 1.0


def test_the_seat_and_the_dock_of_a_seated_base_are_inverse():
    light, dock = DOCK_LIGHTS["create2"], SE2(1.0, 2.0, 0.7)
    back = light.dock_at(light.seat(dock))
    assert (back.x, back.y, wrap_angle(back.theta - dock.theta)) == pytest.approx((1.0, 2.0, 0.0), abs=1e-12)


def test_looking_around_turns_to_both_sides_then_once_around_also_over_the_wrap():
    look, heading, turned = LookAround(3.0, 0.9), 3.0, [0.0]
    for _ in range(3000):
        command = look.step(wrap_angle(heading), 0.5)
        if command is None and look.circled:
            break
        if command is None:
            assert abs(turned[-1]) < 0.05
            look.circle()
            continue
        heading += 0.02 * command.omega
        turned.append(heading - 3.0)
    assert max(turned[: turned.index(min(turned))]) == pytest.approx(0.9, abs=0.05)
    assert min(turned) == pytest.approx(-0.9, abs=0.05)
    assert turned[-1] == pytest.approx(math.tau, abs=0.05)


def test_moves_turn_first_when_askew_and_slow_down_before_the_seat():
    assert towards(SE2(0.0, 1.0, 0.0), 0.1, 0.5).v == 0.0
    assert towards(SE2(1.0, 0.0, 0.0), 0.1, 0.5) == (0.1, 0.0)
    config = DockingConfig()
    far, near = creep(SE2(0.8, 0.0, math.pi), 0.6, config), creep(SE2(0.3, 0.0, math.pi), 0.1, config)
    assert far == pytest.approx((config.v_m_s, 0.0))
    assert near == pytest.approx((config.creep_m_s, 0.0))
    assert creep(SE2(0.8, 0.1, math.pi), 0.6, config).v == 0.0
    assert creep(SE2(0.8, 0.02, math.pi), 0.6, config).omega > 0.0, "left of the axis, seen from the dock: turn left"
