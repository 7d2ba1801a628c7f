"""Docking on emulated wires: bytes, contacts, tries, and why it gives up. The dock's frame is the world's."""

import math

import pytest
from docking_robot import AT_DOCK_M, DockingRobot, Room

from vsx_hw.readings import DockBeam as WireBeam
from vsx_ros.config import Config, DockingConfig
from vsx_ros.errors import ConfigError
from vsx_ros.exploration.decision import NavigationState
from vsx_ros.geometry.se2 import SE2, wrap_angle
from vsx_ros.navigation.dock_light import DOCK_LIGHTS, DockBeam, DockSight, dock_light
from vsx_ros.navigation.docking import Docking
from vsx_ros.navigation.docking_state import DockingSeen, DockingState
from vsx_ros.robot import STOP, Odometry

KINDS = ["kobuki", "create", "create2"]
SEAT_M = 0.21
AWAY, BACK_TURNED = Room(SE2(1.8, 0.7, 0.5)), Room(SE2(0.7, -0.3, 0.2))


@pytest.mark.parametrize("kind", KINDS)
def test_a_base_docks_charges_and_leaves_again(kind):
    robot = DockingRobot(kind, AWAY, 1)
    assert robot.dock() is DockingState.DOCKED, robot.docking.reason
    at = robot.at
    assert SEAT_M - 0.005 < at.x < SEAT_M + 0.007
    assert abs(at.y) < 0.023
    assert abs(wrap_angle(at.theta - math.pi)) < math.radians(10.5)
    before = robot.board.battery.fraction
    robot.wait(5.0)
    assert robot.reading.battery.charging
    assert robot.board.battery.fraction > before
    assert (robot.at.distance_to(at), robot.at.angle_to(at)) == pytest.approx((0.0, 0.0), abs=0.003), "it stands"
    assert robot.undock() is DockingState.UNDOCKED
    assert not robot.reading.battery.docked
    assert 0.40 < robot.at.x - at.x < 0.55
    assert robot.touches == 0


@pytest.mark.parametrize("kind", KINDS)
def test_a_dock_20_cm_and_20_deg_off_its_remembered_place_is_found(kind):
    remembered = SE2(-0.1, 0.17, math.radians(20.0))
    robot = DockingRobot(kind, BACK_TURNED._replace(remembered=remembered), 2)
    assert robot.dock() is DockingState.DOCKED, robot.docking.reason
    assert robot.touches == 0
    found = robot.docking.T_odom_dock()
    true = robot.reading.odometry
    seen_from_base = SE2(true.x_m, true.y_m, true.heading_rad).inverse() @ found
    assert 0.1 < seen_from_base.x < 0.3
    assert abs(seen_from_base.y) < 0.03


def test_before_an_exploration_it_turns_away_from_the_dock():
    robot = DockingRobot("create", Room(SE2(0.35, 0.0, math.pi)), 6)
    assert robot.dock() is DockingState.DOCKED, robot.docking.reason
    assert robot.undock(30.0, turn_rad=math.pi) is DockingState.UNDOCKED
    assert abs(wrap_angle(robot.at.theta)) < 0.3
    assert 0.55 < robot.at.x < 0.8


def test_a_charger_that_does_not_engage_is_tried_again_and_given_up_with_the_reason():
    robot = DockingRobot("kobuki", BACK_TURNED, 3, Config(docking=DockingConfig(tries=2)))
    robot.board.engages = False
    assert robot.dock() is DockingState.FAILED
    assert "the contacts do not touch" in robot.docking.reason
    assert "after 2 tries" in robot.docking.reason
    states = [state for _, state, _ in robot.states]
    assert states.count(DockingState.VERIFYING) == 2
    assert states.count(DockingState.BACKING_OFF) == 1
    assert (robot.reading.odometry.v_m_s, robot.touches) == (pytest.approx(0.0, abs=0.01), 0)


def test_a_charger_that_engages_at_the_second_try_charges():
    robot = DockingRobot("create2", BACK_TURNED, 4)
    robot.board.engages = False
    robot.docking.dock(robot.now_ns, robot.kind, SE2())
    while robot.docking.state is not DockingState.BACKING_OFF:
        robot.wait(0.1)
    robot.board.engages = True
    assert robot.run(120.0) is DockingState.DOCKED
    assert robot.docking.tries == 1


def test_a_dock_without_power_is_looked_for_from_three_places_and_not_found():
    robot = DockingRobot("kobuki", BACK_TURNED, 5)
    robot.plant.at_dock = robot.plant.at_dock._replace(powered=False)
    assert robot.dock() is DockingState.FAILED
    assert "not to be seen from any place" in robot.docking.reason
    assert [state for _, state, _ in robot.states].count(DockingState.SEARCHING) == 3
    assert math.hypot(robot.at.x, robot.at.y) > AT_DOCK_M


def seen(**changes) -> DockingSeen:
    now = DockingSeen(
        odometry=Odometry(0, SE2(1.0, 0.0, math.pi)), sight=DockSight(), docked=False, charging=False, hazard="",
        T_map_base=SE2(1.0, 0.0, math.pi), navigation=NavigationState.ACTIVE,
    )  # fmt: skip
    return now._replace(**changes)


def begun() -> Docking:
    docking = Docking(DockingConfig(), 0)
    docking.dock(0, "kobuki", SE2())
    return docking


def test_it_asks_navigation_for_a_place_before_the_dock_and_leaves_the_wheels_to_it():
    docking = begun()
    act = docking.step(1, seen())
    assert act.command is None
    assert (act.goal.x, act.goal.y, wrap_angle(act.goal.theta)) == pytest.approx((0.8, 0.0, -math.pi))
    assert docking.step(2, seen()) == (None, None)
    docking.step(3, seen(navigation=NavigationState.ABORTED))
    other = docking.step(4, seen()).goal
    assert math.hypot(other.x, other.y) == pytest.approx(0.8)
    assert other.y == pytest.approx(0.8 * math.sin(math.radians(35.0)))


def test_a_dock_that_moves_with_the_map_is_driven_to_and_looked_for_where_it_is_now():
    docking = begun()
    seat = dock_light("kobuki").seat
    first = docking.step(1, seen(seat=seat(SE2()))).goal
    assert docking.step(2, seen(seat=seat(SE2(0.02, 0.01, 0.02)))).goal is None, "a centimetre is no other place"
    goal = docking.step(3, seen(seat=seat(SE2(0.0, 0.6, 0.0)))).goal
    assert (goal.x - first.x, goal.y - first.y) == pytest.approx((0.0, 0.6))
    arrived = seen(navigation=NavigationState.SUCCEEDED, T_map_base=goal, odometry=Odometry(4, goal))
    docking.step(4, arrived._replace(seat=seat(SE2(0.0, 0.6, 0.0))))
    docking.step(5, arrived)
    assert docking.state is DockingState.SEARCHING
    assert docking.T_odom_dock().distance_to(SE2(0.0, 0.6, 0.0)) < 0.05


def test_without_a_way_to_any_place_it_tells_the_planners_reason():
    docking, now_ns = begun(), 0
    while docking.state is DockingState.APPROACHING and now_ns < 100:
        now_ns += 1
        docking.step(now_ns, seen(navigation=NavigationState.ABORTED, navigation_reason="the goal is not free"))
    assert docking.reason == "no way to the dock: the goal is not free"


@pytest.mark.parametrize("navigation", [NavigationState.CANCELLED, NavigationState.REPLACED])
def test_who_ends_the_drive_to_the_dock_ends_the_docking(navigation):
    docking = begun()
    assert docking.step(1, seen()).goal is not None
    act = docking.step(2, seen(navigation=navigation, navigation_reason="by somebody"))
    assert (docking.state, act.goal) == (DockingState.FAILED, None)
    assert docking.reason == "somebody else has ended the drive to the dock: by somebody"


def test_a_base_that_cannot_leave_its_dock_gives_up():
    docking, now_ns = Docking(DockingConfig(), 0), 0
    docking.undock(0)
    while docking.state is DockingState.UNDOCKING and now_ns < 100_000_000_000:
        now_ns += 1_000_000_000
        docking.step(now_ns, seen(docked=True))
    assert docking.state is DockingState.FAILED
    assert "took too long" in docking.reason
    assert docking.in_vain


def test_a_way_off_the_dock_that_others_have_ended_was_not_in_vain():
    docking = Docking(DockingConfig(), 0)
    docking.undock(0)
    docking.step(1, seen(docked=True))
    docking.cancel(2, "the operator holds the wheels")
    assert (docking.state, docking.in_vain) == (DockingState.FAILED, False)
    docking.undock(3)
    docking.step(4, seen(docked=True))
    docking.step(5, seen(docked=True, odometry=Odometry(5, SE2(), odom_epoch=1)))
    assert (docking.state, docking.in_vain) == (DockingState.FAILED, False)


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        ({"T_map_base": None}, "does not know where it is"),
        ({"odometry": Odometry(2, SE2(), odom_epoch=1)}, "restarted its odometry"),
    ],
)
def test_it_gives_up_when_it_no_longer_knows_where_things_are(change, reason):
    docking = begun()
    docking.step(1, seen())
    assert docking.step(2, seen(**change)).command == STOP
    assert docking.state is DockingState.FAILED
    assert reason in docking.reason


@pytest.mark.parametrize("pressed", [lambda backs: True, lambda backs: not backs], ids=["stays", "again"])
def test_a_bumper_that_stays_pressed_or_is_pressed_again_does_not_drive_it_back_for_long(pressed):
    docking, start, now_ns = begun(), SE2(1.0, 0.0, math.pi), 0
    at, farthest_m = start, 0.0
    docking.step(0, seen())
    docking.step(0, seen(navigation=NavigationState.SUCCEEDED))
    while not docking.state.rests and now_ns < 700_000_000_000:
        now_ns += 33_000_000
        hazard = "bumper left" if pressed(docking.state is DockingState.BACKING_OFF) else ""
        here = seen(odometry=Odometry(now_ns, at), hazard=hazard, navigation=NavigationState.SUCCEEDED)
        v, omega = docking.step(now_ns, here).command or STOP
        at = at @ SE2.exp(min(v, 0.0) * 0.033, omega * 0.033)
        farthest_m = max(farthest_m, at.distance_to(start))
    assert docking.state is DockingState.FAILED
    assert "bumper left" in docking.reason
    assert farthest_m <= 0.5


def test_what_ends_it_from_outside_stands_and_a_base_without_a_dock_is_refused():
    docking = begun()
    docking.cancel(5, "cancelled by the operator")
    assert (docking.state, docking.step(6, seen()).command) == (DockingState.FAILED, STOP)
    docking.cancel(7, "again")
    assert docking.reason == "cancelled by the operator"
    with pytest.raises(ConfigError, match="base 'ros' has no dock"):
        docking.dock(8, "ros", SE2())


def test_a_base_on_its_dock_that_is_to_dock_only_checks_the_current():
    docking = begun()
    states = []
    for k in range(80):
        act = docking.step(1 + k * 20_000_000, seen(docked=True, charging=True))
        states.append(docking.state)
        assert act.command in (None, STOP)
    assert states[0] is DockingState.VERIFYING
    assert states[-1] is DockingState.DOCKED


def test_contact_without_current_is_no_success():
    docking, now_ns = begun(), 0
    while docking.state is not DockingState.BACKING_OFF and now_ns < 20_000_000_000:
        now_ns += 20_000_000
        docking.step(now_ns, seen(docked=True))
    assert "no current flows" in docking.reason
    assert 9.0 < now_ns * 1e-9 < 12.0


class Driven:
    """A docking whose base drives exactly as told, without a map; the dock is at dock in the odometry. It touches the
    contacts near its seat; no current flows in the first 11 s."""

    def __init__(self, docking: Docking, dock: SE2, base: SE2) -> None:
        self.docking, self.dock, self.base, self.now_ns, self.begun_ns = docking, dock, base, 10**12, 10**12

    def step(self, **changes) -> DockingState:
        """A thirtieth of a second."""
        light, self.now_ns = dock_light("kobuki"), self.now_ns + 33_000_000
        chances = light.chances((self.base.inverse() @ self.dock).as_array()[None])[0]
        bits = [sum(int(beam.bit) for beam, p in zip(light.beams, row) if p > 0.5) for row in chances]
        touches = self.base.distance_to(light.seat(self.dock)) < 0.03
        now = seen(
            odometry=Odometry(self.now_ns, self.base, odom_epoch=3), sight=DockSight(*bits), docked=touches,
            charging=touches and self.now_ns - self.begun_ns > 11e9, T_map_base=None,
        )  # fmt: skip
        self.act = self.docking.step(self.now_ns, now._replace(**changes))
        v, omega = self.act.command or STOP
        self.base = self.base @ SE2.exp(v * 0.033, omega * 0.033)
        return self.docking.state


def search(docking: Docking) -> None:
    """Begin one; it arrives before a dock at the origin of the odometry."""
    docking.dock(0, "kobuki", SE2())
    docking.step(1, seen())
    docking.step(2, seen(navigation=NavigationState.SUCCEEDED))
    docking.step(3, seen())


@pytest.mark.parametrize("before", [lambda docking: None, search], ids=["first", "after another docking"])
def test_a_base_on_a_dock_without_current_tries_again_there(before):
    """It drove by light to where no dock was ever seen: the origin of the odometry, or the dock of the last time."""
    docking, dock = Docking(DockingConfig(), 0), SE2(3.0, 2.0, math.pi)
    before(docking)
    driven = Driven(docking, dock, dock_light("kobuki").seat(dock))
    docking.dock(driven.now_ns, "kobuki", SE2(-1.0, 4.0, 0.0))
    states, farthest_m = [docking.state], 0.0
    while not docking.state.rests and driven.now_ns - driven.begun_ns < 120e9:
        if driven.step() is not states[-1]:
            states.append(docking.state)
            if docking.state is DockingState.ALIGNING:
                assert docking.T_odom_dock().distance_to(dock) < 0.3
        farthest_m = max(farthest_m, driven.base.distance_to(dock))
    assert states[:4] == [
        DockingState.APPROACHING, DockingState.VERIFYING, DockingState.BACKING_OFF, DockingState.SEARCHING
    ]  # fmt: skip
    assert states[-1] is DockingState.DOCKED, docking.reason
    assert 1 <= docking.tries <= 3
    assert 0.5 < farthest_m < 1.0


@pytest.mark.parametrize("state", [DockingState.APPROACHING, DockingState.SEARCHING, DockingState.ALIGNING])
def test_a_contact_that_comes_unawares_tells_where_the_dock_is(state):
    docking = begun()
    driven = Driven(docking, SE2(), SE2(1.0, 0.0, math.pi))
    driven.step(T_map_base=driven.base)
    if state is not DockingState.APPROACHING:
        driven.step(T_map_base=driven.base, navigation=NavigationState.SUCCEEDED)
    while docking.state is not state:
        driven.step()
    dock = dock_light("kobuki").dock_at(driven.base)
    assert driven.step(docked=True) is DockingState.VERIFYING
    assert docking.T_odom_dock().distance_to(dock) < 0.02


def test_odometry_that_restarts_just_as_it_arrives_before_the_dock_ends_the_docking():
    docking = begun()
    docking.step(1, seen())
    docking.step(2, seen(navigation=NavigationState.SUCCEEDED))
    docking.step(3, seen(odometry=Odometry(3, SE2(), odom_epoch=1)))
    assert (docking.state, docking.reason) == (DockingState.FAILED, "the base has restarted its odometry")


@pytest.mark.parametrize("believed", [SE2(4.0, 0.0, math.pi), SE2(1.0, 5.0, 2.0), SE2(0.0, -4.0, 1.0)])
def test_wherever_the_light_leads_it_goes_no_farther_without_the_map_and_tries_another_place(believed):
    docking, start = begun(), SE2(0.8, 0.0, math.pi)
    driven, farthest_m = Driven(docking, SE2(), start), 0.0
    driven.step(T_map_base=start)
    driven.step(T_map_base=start, navigation=NavigationState.SUCCEEDED)
    while docking.state is not DockingState.ALIGNING:
        driven.step()
    docking._filter.restart(believed, 0.0, 0.0)
    docking._filter.seen = 4
    while driven.step(sight=None) is not DockingState.APPROACHING and driven.now_ns - driven.begun_ns < 300e9:
        farthest_m = max(farthest_m, driven.base.distance_to(start))
    assert "too far" in docking.reason
    assert driven.act.command == STOP
    assert 1.3 < farthest_m < 1.42
    driven.step(T_map_base=driven.base)
    assert math.hypot(driven.act.goal.x, driven.act.goal.y) == pytest.approx(0.8)


def test_the_bits_on_the_topic_are_those_of_the_drivers_and_both_know_the_same_bases():
    assert {beam.name: int(beam) for beam in DockBeam} == {beam.name: int(beam) for beam in WireBeam if beam}
    assert set(DOCK_LIGHTS) == set(KINDS)
