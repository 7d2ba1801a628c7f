"""The Create 1's questions and answers: what is lost, late or slipped, and the gyro of the TurtleBot 1's board."""

import math
import struct

import pytest

from vsx_hw.create.driver import LONGEST_REST, Create1Dialect, Create2Dialect
from vsx_hw.create.odometry import BoardGyro, counts_of
from vsx_hw.create.protocol import Mode, Opcode, encode_packets, single_packets

MS = 1_000_000


def answer(
    question: bytes, distance_mm: int = 0, angle_deg: int = 0, bump: int = 0, gyro: int = 512, mode: Mode = Mode.SAFE
) -> bytes:
    """What the robot says to the query at the end of these bytes."""
    values = dict.fromkeys(range(7, 36), 0)
    values |= {7: bump, 22: 16000, 25: 2000, 26: 2700, 35: mode, 33: gyro, 19: distance_mm, 20: angle_deg}
    return encode_packets({p: values[p] for p in asked(question)})


def asked(question: bytes) -> list[int]:
    """The single packets in the query at the end of these bytes."""
    at = question.index(Opcode.QUERY_LIST) + 2
    assert len(question) == at + question[at - 1]
    return single_packets(question[at:])


def asks_motion(question: bytes) -> bool:
    return {19, 20} <= set(asked(question))


def converse(dialect: Create1Dialect, cycles: int, now_ns: int = 0, **values: int) -> list:
    readings = []
    for k in range(cycles):
        question = dialect.drive(0.0, 0.0)
        readings += dialect.receive(answer(question, **values), now_ns + k * 20 * MS)
    return readings


def test_a_lost_answer_with_the_motion_is_a_gap_that_is_told():
    dialect = Create1Dialect()
    assert len(converse(dialect, 25)) == 25
    assert asks_motion(dialect.drive(0.1, 0.0))
    assert Opcode.QUERY_LIST not in dialect.drive(0.1, 0.0), "a question now would be answered by late bytes"
    question = dialect.drive(0.1, 0.0)
    assert asks_motion(question), "what the robot has not read out is still inside"
    (measured,) = dialect.receive(answer(question, distance_mm=12), 600 * MS)
    assert measured.odometry.gaps == 1
    assert dialect.counters() == {"frames": 26, "refused_frames": 1}


def test_until_the_next_measurement_the_odometry_is_not_trusted():
    dialect = Create1Dialect()
    converse(dialect, 25)
    lost = dialect.drive(0.1, 0.0)
    dialect.drive(0.1, 0.0)
    dialect._commands = 1
    (reading,) = dialect.receive(answer(dialect.drive(0.1, 0.0)), 580 * MS)
    assert not reading.odometry.trusted
    dialect._commands = 0
    question = dialect.drive(0.1, 0.0)
    (reading,) = dialect.receive(answer(question, distance_mm=12), 600 * MS)
    assert asks_motion(lost)
    assert not reading.odometry.trusted
    assert converse(dialect, 60, 620 * MS)[-1].odometry.trusted, "a second after that"


class Driven:
    """A Create 1 that drives as commanded and is asked every ``cycle_ms``; gyro: whether its board has power."""

    def __init__(self, cycle_ms: int = 20, gyro: bool = False) -> None:
        self.dialect, self.cycle_ms, self.gyro = Create1Dialect(), cycle_ms, gyro
        self.way_m = self.turn_rad = 0.0
        self.now_ns, self._told = 1500 * MS, [0, 0]
        self.readings: list = []
        converse(self.dialect, 75, gyro=512 if gyro else 0)

    def drive(self, v_m_s: float, omega_rad_s: float, seconds: float, heard: bool | None = None) -> None:
        """heard, unless None: the first answer with motion is lost; whether the robot heard the question. If not, it
        counts on."""
        for _ in range(round(1000 * seconds / self.cycle_ms)):
            self.now_ns += self.cycle_ms * MS
            self.way_m += v_m_s * self.cycle_ms * 1e-3
            self.turn_rad += omega_rad_s * self.cycle_ms * 1e-3
            question = self.dialect.drive(v_m_s, omega_rad_s)
            if Opcode.QUERY_LIST not in question:
                continue
            counts = [0, 0]
            if asks_motion(question) and heard is not False:
                whole = [int(1000.0 * self.way_m), int(math.degrees(self.turn_rad))]
                counts, self._told = [a - b for a, b in zip(whole, self._told)], whole
            said = answer(question, *counts, gyro=counts_of(omega_rad_s) if self.gyro else 0)
            if asks_motion(question) and heard is not None:
                said, heard = said[:-1], None
            self.readings += self.dialect.receive(said, self.now_ns)


@pytest.mark.parametrize("heard", [True, False])
def test_one_lost_answer_moves_the_pose_neither_back_nor_on(heard):
    robot = Driven()
    robot.drive(0.2, 0.0, 1.0)
    robot.drive(0.2, 0.0, 3.0, heard=heard)
    ways = [reading.odometry.x_m for reading in robot.readings]
    assert abs(ways[-1] - robot.way_m) < 0.03
    assert min(b - a for a, b in zip(ways, ways[1:])) > -0.005
    told = [reading.odometry.trusted for reading in robot.readings]
    assert not all(told)
    assert told[-1]


@pytest.mark.parametrize("heard", [True, False])
@pytest.mark.parametrize("gyro", [True, False])
def test_one_lost_answer_in_a_turn_loses_no_turn(heard, gyro):
    robot = Driven(gyro=gyro)
    robot.drive(0.1, 0.5, 1.0)
    robot.drive(0.1, 0.5, 3.0, heard=heard)
    assert abs(robot.readings[-1].odometry.heading_rad - robot.turn_rad) < 0.06


def test_a_reconnection_in_motion_does_not_move_the_pose_back():
    robot = Driven()
    robot.drive(0.2, 0.0, 1.2)
    list(robot.dialect.hello())
    robot.drive(0.2, 0.0, 3.0)
    assert abs(robot.readings[-1].odometry.x_m - robot.way_m) < 0.03


@pytest.mark.parametrize(("omega_rad_s", "cycle_ms"), [(1.5, 40), (0.9, 50), (-1.5, 50)])
def test_a_fast_turn_on_a_busy_computer_is_no_junk(omega_rad_s, cycle_ms):
    robot = Driven(cycle_ms)
    robot.drive(0.0, omega_rad_s, 6.0)
    robot.drive(0.0, 0.0, 2.0)
    last = robot.readings[-1].odometry
    assert (last.gaps, last.trusted) == (0, True)
    assert last.heading_rad == pytest.approx(robot.turn_rad, abs=0.06)


def test_a_reconnection_loses_motion_and_says_so():
    dialect = Create1Dialect()
    list(dialect.hello())
    assert {reading.odometry.gaps for reading in converse(dialect, 75)} == {0}
    list(dialect.hello())
    first = converse(dialect, 25, 2000 * MS, distance_mm=40)
    assert first[-1].odometry.gaps == 1
    assert not first[-1].odometry.trusted
    after = converse(dialect, 25, 2500 * MS, distance_mm=7)[-1].odometry
    assert not after.trusted
    assert converse(dialect, 30, 3000 * MS)[-1].odometry.trusted, "a second after the next measurement"
    assert after.wheels_m == pytest.approx((0.007, 0.007)), "what was driven before is not known"
    assert after.gaps == 1


def test_a_robot_in_passive_is_not_thought_to_move():
    """It fell there at a cliff, and is still told to drive on."""
    shown = {}
    for mode in (Mode.SAFE, Mode.PASSIVE):
        dialect = Create1Dialect()
        converse(dialect, 3, mode=mode)
        for k in range(3, 20):
            (reading,) = dialect.receive(answer(dialect.drive(0.2, 0.0), mode=mode), k * 20 * MS)
        shown[mode] = reading.odometry.x_m, reading.odometry.v_m_s
    assert shown == {Mode.SAFE: (pytest.approx(0.068), 0.2), Mode.PASSIVE: (0.0, 0.0)}


@pytest.mark.parametrize(("hazard", "v_m_s"), [(0, 0.0), (4, 0.2)])
def test_a_robot_that_stays_in_passive_is_kept_awake(hazard, v_m_s):
    """On no dock: nothing is asked of it, or it may not move because a wheel is raised."""
    dialect = Create1Dialect()
    (reading,) = dialect.receive(answer(dialect.drive(0.0, 0.0), bump=hazard, mode=Mode.PASSIVE), 0)
    assert (reading.mode, reading.battery.docked) == ("passive", False)
    sent = [k for k in range(6002) if dialect.drive(v_m_s, 0.0)[:1] == bytes((Opcode.START,))]
    assert sent == [2999, 5999], "it falls asleep after five minutes; these are two, of 20 ms each"


def test_late_bytes_are_not_taken_for_the_next_answer():
    dialect = Create1Dialect()
    converse(dialect, 25)
    late = answer(dialect.drive(0.1, 0.0), bump=1)
    assert dialect.drive(0.1, 0.0)
    assert dialect.receive(late, 560 * MS) == []
    for _ in range(LONGEST_REST):
        assert Opcode.QUERY_LIST not in dialect.drive(0.1, 0.0), "more may be on their way"
    question = dialect.drive(0.1, 0.0)
    (reading,) = dialect.receive(answer(question, distance_mm=3), 600 * MS)
    assert reading.odometry.wheels_m == pytest.approx((0.003, 0.003))


@pytest.mark.parametrize(
    ("spoil", "rest"), [(lambda a: a[1:] + b"\0", 0), (lambda a: a + b"\0", LONGEST_REST), (lambda a: bytes(len(a)), 0)]
)
def test_slipped_bytes_are_refused(spoil, rest):
    dialect = Create1Dialect()
    converse(dialect, 3)
    question = dialect.drive(0.0, 0.0)
    assert dialect.receive(spoil(answer(question)), 80 * MS) == []
    assert dialect.counters()["refused_frames"] == 1
    assert not any(Opcode.QUERY_LIST in dialect.drive(0.0, 0.0) for _ in range(rest))
    assert len(converse(dialect, 2, 100 * MS)) == 2


def test_the_create_2_is_never_asked_for_its_angle():
    """Its firmware up to 3.4.0 tells 0.324 of the true angle; the encoders are right in all of them."""
    requests = [data for data, _ in Create2Dialect().hello() if data[0] == Opcode.STREAM]
    (request,) = requests
    assert not {19, 20} & set(request[2:])
    assert {43, 44} <= set(request[2:])


def test_the_board_gyro_learns_its_zero_and_measures_turns():
    gyro = BoardGyro()
    rates = [gyro.rate_rad_s(507, True) for _ in range(60)]
    assert rates[:49] == [None] * 49
    assert rates[-1] == pytest.approx(0.0, abs=1e-9)
    assert math.degrees(gyro.rate_rad_s(507 - 100, False)) == pytest.approx(100 / 507 * 150 * 1.35)
    carried = [gyro.rate_rad_s(407, True) for _ in range(500)][-1]
    assert gyro.offset == pytest.approx(507)
    assert carried > 0.5


@pytest.mark.parametrize("counts", [0, 80, 1023])
def test_an_unpowered_board_tells_nothing(counts):
    gyro = BoardGyro()
    assert [gyro.rate_rad_s(counts, True) for _ in range(200)][-1] is None


def test_a_zero_learned_while_it_was_twisted_is_learned_anew():
    """Put down with a constant twist of 20 deg/s in the first 1.2 s."""
    gyro = BoardGyro()
    twisted = [gyro.rate_rad_s(461, True) for _ in range(60)]
    assert abs(twisted[-1]) < 0.01
    still = [gyro.rate_rad_s(512 + k % 2, True) for k in range(70)]
    assert gyro.offset == pytest.approx(512.5, abs=0.1)
    assert abs(still[-1]) < 0.01


def test_samples_that_differ_give_no_zero():
    gyro = BoardGyro()
    swung = [gyro.rate_rad_s(round(512 + 25 * math.sin(0.2 * k)), True) for k in range(200)]
    assert set(swung) == {None}
    assert abs([gyro.rate_rad_s(512, True) for _ in range(60)][-1]) < 0.01


def test_a_board_that_gets_its_power_late_gives_rates():
    gyro = BoardGyro()
    assert {gyro.rate_rad_s(0, True) for _ in range(50)} == {None}
    assert abs([gyro.rate_rad_s(512, True) for _ in range(60)][-1]) < 0.01


@pytest.mark.parametrize("counts", [9, -9, 25, -50])
def test_a_zero_is_not_overruled_by_a_turn_shorter_than_it_stood(counts):
    """On a turntable a robot turns as steadily as it stands: 4, 10 and 20 deg/s for 15 of 20 s; and while driven."""
    gyro = BoardGyro()
    for _ in range(1000):
        gyro.rate_rad_s(512, True)
    turned = [gyro.rate_rad_s(512 + counts, True) for _ in range(750)]
    assert gyro.offset == pytest.approx(512)
    assert turned[-1] == pytest.approx(-math.radians(counts / 512 * 150 * 1.35))
    for _ in range(10):
        gyro.rate_rad_s(512, True)
    for _ in range(2000):
        gyro.rate_rad_s(512 + counts, False)
    assert gyro.offset == pytest.approx(512)


def test_no_zero_is_learned_while_the_wheels_are_pushed():
    """Two seconds still, then five in a steady curve without a command."""
    dialect = Create1Dialect()
    converse(dialect, 100)
    pushed = converse(dialect, 250, 2000 * MS, gyro=555, angle_deg=-9)
    assert pushed[-1].gyro.rate_rad_s == pytest.approx(math.radians(-43 / 512 * 150 * 1.35))
    converse(dialect, 40, 7000 * MS)
    assert dialect._gyro.offset == pytest.approx(512)


def test_a_reconnection_learns_the_zero_anew():
    dialect = Create1Dialect()
    assert converse(dialect, 75, gyro=505)[-1].gyro is not None
    list(dialect.hello())
    after = converse(dialect, 75, 2000 * MS, gyro=520)
    assert after[0].gyro is None
    assert abs(after[-1].gyro.rate_rad_s) < 0.01


def test_odometry_is_trusted_again_once_a_twisted_zero_is_corrected():
    """Turned by hand in the first 1.2 s, then 10 s still, then a turn to each side."""
    dialect = Create1Dialect()
    twist = counts_of(math.radians(20.0))
    readings = converse(dialect, 60, gyro=twist) + converse(dialect, 500, 1200 * MS)
    assert abs(readings[-1].gyro.rate_rad_s) < 0.01
    turned_rad = told_rad = 0.0
    for k in range(300):
        rate = 0.5 if k < 150 else -0.5
        turned_rad += rate * 0.02
        question = dialect.drive(0.0, rate)
        angle_deg = round(math.degrees(turned_rad - told_rad)) if asks_motion(question) else 0
        told_rad += math.radians(angle_deg)
        now_ns = (11200 + 20 * k) * MS
        readings += dialect.receive(answer(question, angle_deg=angle_deg, gyro=counts_of(rate)), now_ns)
    assert readings[-1].odometry.trusted
    assert readings[-1].gyro.trusted


def test_the_heading_follows_the_gyro_between_and_at_the_measurements():
    dialect = Create1Dialect()
    converse(dialect, 75)
    rate = 0.5
    readings = []
    turned_deg = 0.0
    for k in range(100):
        question = dialect.drive(0.0, rate)
        turned_deg += math.degrees(rate) * 0.02
        angle_deg = round(turned_deg) if asks_motion(question) else 0
        turned_deg -= angle_deg
        now_ns = (1500 + 20 * k) * MS
        readings += dialect.receive(answer(question, angle_deg=angle_deg, gyro=counts_of(rate)), now_ns)
    turned = readings[-1].odometry.heading_rad - readings[0].odometry.heading_rad
    assert turned == pytest.approx(rate * 99 * 0.02, rel=0.02)
    assert readings[-1].gyro.rate_rad_s == pytest.approx(rate, rel=0.02)


def test_the_gyro_byte_order_is_that_of_the_open_interface():
    assert encode_packets({33: counts_of(0.0)}) == struct.pack(">H", 512)
