"""The three kinds of base by name: their drivers, their emulators, and detection at a serial port."""

import sys
import time
from collections.abc import Callable
from contextlib import closing
from functools import partial
from typing import NamedTuple

from vsx_hw.base_driver import BaseDriver, Dialect
from vsx_hw.create.dialect import QUESTION, is_plausible
from vsx_hw.create.driver import Create1Dialect, Create2Dialect
from vsx_hw.create.emulator import CreateBoard
from vsx_hw.create.protocol import CREATE_1, CREATE_2, Model, Opcode, decode_packets, encode_query, packets_bytes
from vsx_hw.errors import DeviceError, DeviceNotFound
from vsx_hw.kobuki.driver import KobukiDialect
from vsx_hw.kobuki.emulator import KobukiBoard
from vsx_hw.kobuki.protocol import BAUD as KOBUKI_BAUD
from vsx_hw.kobuki.protocol import WHEEL_BASE_M as KOBUKI_WHEEL_BASE_M
from vsx_hw.kobuki.stream import StreamParser
from vsx_hw.readings import BaseReading
from vsx_hw.serial_emulator import Board, Plant, SerialEmulator
from vsx_hw.transport import SerialTransport
from vsx_hw.watchdog import StopBytes, take_over

LISTEN_S, ANSWER_S = 0.3, 0.3  # a Kobuki sends every 20 ms; a Create answers in tens of ms
ENOUGH_FRAMES = 2  # with correct checksums; one may be chance


class BaseKind(NamedTuple):
    """One kind. dialect: makes its protocol from the factors on measured distance and on measured turn. board: makes
    its emulated electronics from wheels and a seed."""

    baud: int
    wheel_base_m: float
    dialect: Callable[[float, float], Dialect]
    board: Callable[[Plant, int], Board]

    def stop_bytes(self) -> StopBytes:
        """The bytes that stop it without a driver."""
        return stop_bytes(self.dialect)


def stop_bytes(dialect: Callable[[float, float], Dialect]) -> StopBytes:
    """The bytes that stop a base of this protocol without a driver."""
    spoken = dialect(1.0, 1.0)
    return StopBytes(spoken.halt(), spoken.farewell())


BASES = {
    "kobuki": BaseKind(KOBUKI_BAUD, KOBUKI_WHEEL_BASE_M, KobukiDialect, KobukiBoard),
    CREATE_1.name: BaseKind(CREATE_1.baud, CREATE_1.wheel_base_m, Create1Dialect, partial(CreateBoard, CREATE_1)),
    CREATE_2.name: BaseKind(CREATE_2.baud, CREATE_2.wheel_base_m, Create2Dialect, partial(CreateBoard, CREATE_2)),
}


def base_driver(
    kind: str, port: str, on_reading: Callable[[BaseReading], None],
    on_link: Callable[[bool, str], None] = lambda connected, message: None, command_timeout_s: float = 0.25,
    on_command: Callable[[bool], None] = lambda turning: None,
) -> BaseDriver:  # fmt: skip
    """A driver for the base of this kind at a serial port such as /dev/kobuki; call ``start`` on it. Raises KeyError
    for a kind that is not in BASES."""
    base = BASES[kind]
    return BaseDriver(
        base.dialect(1.0, 1.0), lambda: SerialTransport(port, base.baud), port, on_reading, on_link, command_timeout_s,
        on_command,
    )  # fmt: skip


def base_emulator(kind: str, plant: Plant, link: str, seed: int = 0, battery_pace: float = 1.0) -> SerialEmulator:
    """A base on emulated wheels behind the serial port ``link``; start it, or use it as a context manager. Its battery
    drains and charges ``battery_pace`` times faster than a real one. Raises KeyError for a kind not in BASES."""
    board = BASES[kind].board(plant, seed)
    board.battery.pace = battery_pace
    return SerialEmulator(board, plant, link, seed)


def detect_base(port: str) -> str:
    """Returns kobuki, create or create2. Listens, then asks; no byte that is sent can turn a wheel. A Kobuki sends
    unasked. The Creates answer questions, each at its own baud rate; the bytes are no commands to drive at the other
    one's either. Raises DeviceNotFound when the port cannot be opened, no base answers, or a Create answers strangely.
    """
    with closing(SerialTransport(port, KOBUKI_BAUD)) as transport:
        if _speaks_like_a_kobuki(transport):
            return "kobuki"
    for model in (CREATE_2, CREATE_1):
        with closing(SerialTransport(port, model.baud)) as transport:
            if _answers_like_a_create(transport, port, model):
                return model.name
    raise DeviceNotFound(
        f"{port}: no base answers, neither a Kobuki or Create 2 at {KOBUKI_BAUD} baud nor a Create 1 at "
        f"{CREATE_1.baud}; switch it on, check the cable, or give ~robot_type"
    )


def _speaks_like_a_kobuki(transport: SerialTransport) -> bool:
    parser = StreamParser()
    deadline_s = time.monotonic() + LISTEN_S
    while time.monotonic() < deadline_s and parser.frames < ENOUGH_FRAMES:
        parser.feed(transport.read(0.05))
    return parser.frames >= ENOUGH_FRAMES


def _answers_like_a_create(transport: SerialTransport, port: str, model: Model) -> bool:
    """Asks up to three times: an answer may be lost or mixed with the robot's start-up text. Pauses a stream that
    another program has left running. After a plausible answer nothing is sent at another rate.
    Raises DeviceNotFound if its mode or battery is none that is known."""
    transport.write(bytes((Opcode.START, Opcode.PAUSE_STREAM, 0)))
    time.sleep(0.1)
    strange = ""
    for _ in range(3):
        flushed_s = time.monotonic() + ANSWER_S
        while transport.read(0.02) and time.monotonic() < flushed_s:
            continue
        transport.write(encode_query(QUESTION))
        answer = b""
        deadline_s = time.monotonic() + ANSWER_S
        while time.monotonic() < deadline_s:
            answer += transport.read(0.05)
        if len(answer) == packets_bytes(QUESTION):
            values = decode_packets(answer, QUESTION)
            if is_plausible(values):
                if values[35] in (1, 2, 3) and values[26] > 0:
                    return True
                strange = f"mode {values[35]}, capacity {values[26]} mAh"
    if strange:
        raise DeviceNotFound(
            f"{port}: a {model.name} answers, but strangely: {strange}; switch it off and on, or give ~robot_type"
        )
    return False


def main() -> None:
    """Stop the wheels of a base without a driver; systemd runs this after the driver's end: stop_base PORT [KIND].
    Without KIND the base is detected. Exit code 0 when the stop bytes were sent, 1 for wrong arguments, 2 when the port
    could not be opened or no base answered."""
    arguments = sys.argv[1:]
    if len(arguments) not in (1, 2) or not BASES.keys() >= set(arguments[1:]):
        sys.exit(f"stop_base PORT [{'|'.join(BASES)}]")
    port = arguments[0]
    try:
        base = BASES[arguments[1] if len(arguments) == 2 else detect_base(port)]
    except DeviceError as error:
        sys.stderr.write(f"stop_base: {error}\n")
        sys.exit(2)
    sys.exit(0 if take_over(port, base.baud, base.stop_bytes().farewell) else 2)
