"""The emulated docks and what the drivers make of their bytes: fields, characters, contacts, modes, battery."""

import math
import random

import pytest
from hw_docked import WheelsAtDock
from hw_wire import MS, Wire

from vsx_hw import dock_emulator as docks
from vsx_hw.bases import BASES
from vsx_hw.battery_emulator import CREATE_CELLS, KOBUKI_CELLS, EmulatedBattery
from vsx_hw.create.protocol import Mode, dock_character, encode_dock_character
from vsx_hw.dock_emulator import BaseAtDock, light
from vsx_hw.readings import DockBeam

KINDS = ["kobuki", "create", "create2"]
SEATED_M = 0.21


@pytest.fixture
def steady(monkeypatch):
    """No noise: what the geometry alone says."""
    for name in ("EDGE_RAD", "EDGE_SHARE", "DROPOUT", "GHOST"):
        monkeypatch.setattr(docks, name, 0.0)


def seen(dock, receivers, *pose, walls=()):
    return light(dock, receivers, BaseAtDock(*pose, walls=walls), random.Random(1))


def test_a_kobuki_before_its_dock_sees_the_field_it_stands_in(steady):
    kobuki = docks.KOBUKI_DOCK, docks.KOBUKI_RECEIVERS
    assert seen(*kobuki, 2.0, 0.0, math.pi) == (DockBeam.NONE, DockBeam.CENTER, DockBeam.NONE)
    assert seen(*kobuki, 0.7, 0.0, math.pi)[1] == DockBeam.CENTER | DockBeam.NEAR_CENTER
    assert seen(*kobuki, 1.2, 0.6, math.pi)[1] == DockBeam.LEFT
    assert seen(*kobuki, 1.2, -0.6, math.pi)[1] == DockBeam.RIGHT
    assert seen(*kobuki, 3.0, 0.0, math.pi) == (DockBeam.NONE,) * 3, "too far"
    assert seen(*kobuki, 1.2, 0.0, 0.0) == (DockBeam.NONE,) * 3, "looks away"


def test_a_kobuki_that_drives_across_the_axis_sees_the_dock_beside_it(steady):
    """As kobuki_dock_drive expects: in the left field heading for the axis, the right receiver sees it."""
    right, centre, left = seen(docks.KOBUKI_DOCK, docks.KOBUKI_RECEIVERS, 1.0, 0.6, -0.5 * math.pi)
    assert (right, centre, left) == (DockBeam.LEFT, DockBeam.NONE, DockBeam.NONE)
    right, centre, left = seen(docks.KOBUKI_DOCK, docks.KOBUKI_RECEIVERS, 1.0, -0.6, 0.5 * math.pi)
    assert (right, centre, left) == (DockBeam.NONE, DockBeam.NONE, DockBeam.RIGHT)


def test_a_home_base_shines_red_to_its_left_and_green_to_its_right_and_both_before_it(steady):
    create = docks.HOME_BASE, docks.CREATE_1_RECEIVERS
    assert seen(*create, 1.0, 0.0, math.pi) == (DockBeam.LEFT | DockBeam.RIGHT,)
    assert seen(*create, 1.0, 0.25, math.pi) == (DockBeam.LEFT,)
    assert seen(*create, 1.0, -0.25, math.pi) == (DockBeam.RIGHT,)
    assert seen(*create, 0.6, 0.0, math.pi) == (DockBeam.LEFT | DockBeam.RIGHT | DockBeam.HALO,)
    assert seen(*create, 0.0, 0.5, -0.5 * math.pi) == (DockBeam.HALO,), "beside it"
    assert seen(*create, 1.3, 0.0, math.pi) == (DockBeam.NONE,)
    right, _, left = seen(docks.HOME_BASE, docks.CREATE_2_RECEIVERS, 1.0, 0.0, math.pi + 0.32)
    assert (right, left) == (DockBeam.LEFT | DockBeam.RIGHT, DockBeam.NONE)


def test_a_wall_reflects_the_beams_over_half_their_range_and_hides_what_is_behind_it(steady):
    mirror = (0.2, 0.7, 1.6, 0.7)
    kobuki = docks.KOBUKI_DOCK, docks.KOBUKI_RECEIVERS
    towards_wall = (0.7, 0.3, 0.5 * math.pi)
    assert seen(*kobuki, *towards_wall) == (DockBeam.NONE,) * 3
    assert DockBeam.LEFT in seen(*kobuki, *towards_wall, walls=(mirror,))[1]
    assert seen(*kobuki, 1.2, 0.0, math.pi, walls=((0.6, -1.0, 0.6, 1.0),)) == (DockBeam.NONE,) * 3


def test_noise_loses_frames_and_makes_few_ghosts():
    rng = random.Random(7)
    frames = [light(docks.KOBUKI_DOCK, docks.KOBUKI_RECEIVERS, BaseAtDock(1.5, 0.0, math.pi), rng) for _ in range(4000)]
    centre = [frame[1] for frame in frames]
    assert 0.03 < sum(not beams & DockBeam.CENTER for beams in centre) / len(centre) < 0.07
    assert 0 < sum(bool(frame[0] | frame[2]) for frame in frames) < 30
    assert (
        light(docks.KOBUKI_DOCK, docks.KOBUKI_RECEIVERS, BaseAtDock(1.5, 0.0, math.pi, powered=False), rng) == (0,) * 3
    )


def test_the_characters_of_both_generations_come_back():
    documented = {242, 244, 246, 248, 250, 252, 254, 161, 164, 165, 168, 169, 172, 173}
    told = set()
    for first in (True, False):
        for mask in range(1, 8):
            lights = bool(mask & 4), bool(mask & 2), bool(mask & 1)
            value = encode_dock_character(*lights, first=first)
            told.add(value)
            assert dock_character(value) == lights
    assert told == documented
    assert (encode_dock_character(False, False, False, first=True), dock_character(255)) == (255, (False,) * 3)
    for value in set(range(256)) - documented - {240, 160}:
        assert dock_character(value) == (False,) * 3, value


@pytest.mark.parametrize("kind", KINDS)
def test_the_driver_reports_the_light_and_the_contact(kind, monkeypatch, steady):
    wire = Wire(kind, monkeypatch, WheelsAtDock(BASES[kind].wheel_base_m, 0.6))
    wire.serve(0.5)
    sight = wire.readings[-1].dock
    assert sight.kind == kind
    expected = DockBeam.CENTER if kind == "kobuki" else DockBeam.LEFT | DockBeam.RIGHT | DockBeam.HALO
    assert sight.center & ~DockBeam.NEAR_CENTER == expected
    assert not wire.readings[-1].battery.docked
    wire.plant.at = wire.plant.at._replace(x_m=SEATED_M)
    wire.serve(2.0)
    battery = wire.readings[-1].battery
    assert (battery.docked, battery.charging, battery.state) == (True, True, "charging")
    if kind != "kobuki":
        assert battery.current_a == pytest.approx(CREATE_CELLS.charge_a)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize(
    "change", [{"x_m": SEATED_M + 0.01}, {"y_m": 0.025}, {"heading_rad": math.pi + 0.2}], ids=["out", "beside", "askew"]
)
def test_a_base_that_stands_wrong_or_a_charger_that_does_not_engage_gives_nothing(kind, change, monkeypatch):
    wire = Wire(kind, monkeypatch, WheelsAtDock(BASES[kind].wheel_base_m, SEATED_M))
    wire.plant.at = wire.plant.at._replace(**change)
    wire.serve(0.5)
    assert not wire.readings[-1].battery.docked
    wire.plant.at = wire.plant.at._replace(x_m=SEATED_M, y_m=0.0, heading_rad=math.pi)
    wire.board.engages = False
    wire.serve(0.5)
    assert not wire.readings[-1].battery.docked
    wire.board.engages = True
    wire.serve(0.5)
    assert wire.readings[-1].battery.docked


@pytest.mark.parametrize("kind", KINDS)
def test_a_base_leaves_its_dock_backwards_and_obeys_again(kind, monkeypatch):
    wire = Wire(kind, monkeypatch, WheelsAtDock(BASES[kind].wheel_base_m, SEATED_M))
    wire.each_ms = lambda: wire.driver.drive(-0.1, 0.0)
    wire.serve(4.0)
    assert 0.4 < wire.plant.at.x_m < 0.62
    assert not wire.readings[-1].battery.docked
    if kind != "kobuki":
        assert wire.board.mode is Mode.SAFE
    wire.each_ms = lambda: wire.driver.drive(0.0, 0.5)
    before = wire.plant.at.heading_rad
    wire.serve(2.0)
    assert wire.plant.at.heading_rad - before > 0.5


@pytest.mark.parametrize("kind", ["create", "create2"])
def test_a_create_at_its_dock_stands_in_passive_whatever_else_it_is_told(kind, monkeypatch):
    wire = Wire(kind, monkeypatch, WheelsAtDock(BASES[kind].wheel_base_m, SEATED_M + 0.1))
    wire.each_ms = lambda: wire.driver.drive(0.1, 0.0)
    wire.serve(3.0)
    assert wire.board.mode is Mode.PASSIVE
    assert SEATED_M - 0.01 < wire.plant.at.x_m < SEATED_M + 0.01, "it fell from Safe and drove no farther"
    assert all(r.battery.charging for r in wire.readings[-20:])
    wire.each_ms = lambda: wire.driver.drive(0.0, 1.0)
    wire.serve(1.0)
    assert (wire.board.mode, wire.plant.at.heading_rad) == (Mode.PASSIVE, math.pi)
    log = len(wire.board.log)
    wire.serve(61.0)
    assert bytes(wire.board.log[log:]).count(b"\x80") >= 1, "a word each minute keeps it awake"


def test_batteries_drain_charge_and_stop_at_both_ends():
    for cells in (KOBUKI_CELLS, CREATE_CELLS):
        battery = EmulatedBattery(cells, fraction=1.0)
        for minute in range(61):
            battery.advance(minute * 60_000 * MS, 0.0, charger=False)
        assert battery.fraction == pytest.approx(1.0 - cells.idle_a / cells.capacity_ah, abs=1e-6)
        assert cells.empty_v < battery.voltage_v < cells.full_v
        battery.pace = 100.0
        battery.advance(7_200_000 * MS, 0.3, charger=False)
        assert (battery.fraction, battery.charge_mah) == (0.0, 0)
        battery.advance(10_800_000 * MS, 0.0, charger=True)
        assert (battery.fraction, battery.charge_mah) == (1.0, battery.capacity_mah)
        battery.voltage_v = 14.5
        assert battery.voltage_v == pytest.approx(14.5)
