"""Which base is at a serial port: listen, then ask. No byte that is sent can turn a wheel."""

import time
from collections.abc import Callable

from vsx_hw.create.dialect import BATTERY_PACKETS, SAFETY_PACKETS, is_plausible
from vsx_hw.create.protocol import CREATE_1, CREATE_2, Opcode, decode_packets, encode_query, packet_bytes
from vsx_hw.errors import DeviceNotFound
from vsx_hw.kobuki.protocol import BAUD as KOBUKI_BAUD
from vsx_hw.kobuki.stream import StreamParser
from vsx_hw.transport import SerialTransport, Transport

LISTEN_S, ANSWER_S = 0.3, 0.3
ENOUGH_FRAMES = 2
QUESTIONS = SAFETY_PACKETS + BATTERY_PACKETS


def detect_base(port: str, open_transport: Callable[[str, int], Transport] = SerialTransport) -> str:
    """kobuki, create or create2. Raises DeviceNotFound when the port cannot be opened or nobody answers. A Kobuki
    speaks unasked. The Creates answer questions, each at its own speed."""
    transport = open_transport(port, KOBUKI_BAUD)
    try:
        if _speaks_like_a_kobuki(transport):
            return "kobuki"
    finally:
        transport.close()
    for model in (CREATE_2, CREATE_1):
        transport = open_transport(port, model.baud)
        try:
            if _answers_like_a_create(transport):
                return model.name
        finally:
            transport.close()
    raise DeviceNotFound(
        f"{port}: no base answers, neither a Kobuki or Create 2 at {KOBUKI_BAUD} baud nor a Create 1 at "
        f"{CREATE_1.baud}; switch it on, check the cable, or give ~robot_type"
    )


def _speaks_like_a_kobuki(transport: Transport) -> bool:
    parser = StreamParser()
    deadline_s = time.monotonic() + LISTEN_S
    while time.monotonic() < deadline_s and parser.frames < ENOUGH_FRAMES:
        parser.feed(transport.read(0.05))
    return parser.frames >= ENOUGH_FRAMES


def _answers_like_a_create(transport: Transport) -> bool:
    """Asked up to three times: an answer may be mixed with what the robot prints when it is switched on, or lost. A
    stream that another program has left running is paused."""
    transport.write(bytes((Opcode.START, Opcode.PAUSE_STREAM, 0)))
    time.sleep(0.1)
    for _ in range(3):
        _flush(transport)
        transport.write(encode_query(QUESTIONS))
        answer = b""
        deadline_s = time.monotonic() + ANSWER_S
        while time.monotonic() < deadline_s:
            answer += transport.read(0.05)
        if len(answer) == sum(packet_bytes(p) for p in QUESTIONS) and _is_a_create(answer):
            return True
    return False


def _flush(transport: Transport) -> None:
    deadline_s = time.monotonic() + ANSWER_S
    while transport.read(0.02) and time.monotonic() < deadline_s:
        continue


def _is_a_create(answer: bytes) -> bool:
    values = decode_packets(answer, QUESTIONS)
    return is_plausible(values) and values[35] in (1, 2, 3) and values[26] > 0
