"""What a Create hears of bytes that were sent at the baud rate of the other one: no command to drive."""

import pytest

from vsx_hw import bases
from vsx_hw.create.dialect import CreateDialect
from vsx_hw.create.driver import Create1Dialect, Create2Dialect
from vsx_hw.create.protocol import CREATE_1, CREATE_2, Mode, Opcode, encode_packets, single_packets
from vsx_hw.errors import DeviceNotFound
from vsx_hw.readings import Signal

DRIVE_FROM_PASSIVE = {134, 135, 136, 143}  # spot, clean, maximum or demo, seek dock
FAST, SLOW = 20, 40  # samples of the line in a bit at 115200 and at 57600 baud


def hear(data: bytes, sent: int, read: int, late: int, gap: int) -> list[int]:
    """The bytes that a receiver takes from the line, framing errors included; all arguments in samples: of a bit of
    the sender and of the receiver, how late the receiver samples, and the pause between the sender's bytes."""
    line = [1]
    for byte in data:
        for bit in (0, *((byte >> k) & 1 for k in range(8)), 1):
            line += [bit] * sent
        line += [1] * gap
    line += [1] * 10 * read
    heard, at = [], 1
    while True:
        at = next((k for k in range(at, len(line)) if line[k - 1] and not line[k]), -1)
        if at < 0:
            return heard
        at += read // 2 + late
        heard.append(sum(line[at + (1 + k) * read] << k for k in range(8)))
        at += 9 * read


def drives(data: bytes, sent: int) -> bool:
    """Whether the other robot may hear a command to drive."""
    read = FAST + SLOW - sent
    return any(
        DRIVE_FROM_PASSIVE & set(hear(data, sent, read, late, gap)) for late in (-3, 3) for gap in (0, 30 * SLOW)
    )


def test_bytes_are_heard_as_a_receiver_at_twice_or_half_the_rate_hears_them():
    assert 134 in hear(bytes((9,)), SLOW, FAST, 3, 0), "bits 0 1001.. : start, then 0 1 1 0 0 0 0 1, and a stop bit"
    assert hear(bytes((134, 7)), SLOW, SLOW, 3, 0) == [134, 7]
    assert drives(bytes((149, 2, 35, 25)), SLOW)


@pytest.mark.parametrize(("dialect", "sent"), [(Create1Dialect, SLOW), (Create2Dialect, FAST)])
def test_no_byte_of_a_driver_drives_the_other_create(dialect, sent):
    """A driver of the wrong kind hears no answer, so it commands standstill only."""
    create: CreateDialect = dialect()
    said = [data for data, _ in create.hello()] + [create.halt(), create.farewell()]
    for commands in (0, 0, 1, 1):  # both questions of a Create 1, each with and without its first byte
        create._asked, create._commands = [], commands
        said += [create.drive(0.0, 0.0)]
    create._mode = Mode.SAFE
    said += [create.show(signal) for signal in Signal] + [create.drive(0.0, 0.0)]
    assert [data.hex(" ") for data in said if drives(data, sent)] == []


class Line:
    """A port at which nobody answers, or, odd, a Create 2 in a mode that is not documented."""

    def __init__(self, odd: bool) -> None:
        self.odd, self.baud, self.asked = odd, 0, False
        self.said: list[tuple[int, bytes]] = []

    def open(self, port: str, baud: int) -> "Line":
        self.baud = baud
        return self

    def read(self, timeout_s: float) -> bytes:
        answers, self.asked = self.asked and self.odd and self.baud == CREATE_2.baud, False
        values = dict.fromkeys(range(7, 36), 0) | {22: 16000, 25: 2000, 26: 2700, 35: 4}
        asked = single_packets(self.said[-1][1][2:]) if answers else []
        return encode_packets({packet: values[packet] for packet in asked})

    def write(self, data: bytes) -> None:
        self.asked = data[0] == Opcode.QUERY_LIST
        self.said.append((self.baud, data))

    def close(self) -> None:
        pass


@pytest.fixture
def detect(monkeypatch):
    """Detection on a line; the bytes it sent."""

    def detected(line: Line, match: str) -> list[tuple[int, bytes]]:
        monkeypatch.setattr(bases, "SerialTransport", line.open)
        for name in ("LISTEN_S", "ANSWER_S"):
            monkeypatch.setattr(bases, name, 0.01)
        with pytest.raises(DeviceNotFound, match=match):
            bases.detect_base("/dev/tty")
        return line.said

    return detected


def test_no_byte_of_the_detection_drives_the_other_create(detect):
    said = detect(Line(odd=False), "no base answers")
    assert {baud for baud, _ in said} == {CREATE_1.baud, CREATE_2.baud}
    drive = [(baud, data.hex(" ")) for baud, data in said if drives(data, SLOW if baud == CREATE_1.baud else FAST)]
    assert drive == []


def test_a_create_2_that_answers_strangely_hears_nothing_at_another_rate(detect):
    said = detect(Line(odd=True), "create2 answers, but strangely: mode 4")
    assert {baud for baud, _ in said} == {CREATE_2.baud}
