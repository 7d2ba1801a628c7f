"""An iRobot Create or Create 2 written from the manuals alone: bytes in, bytes out, time as an argument.

Sources: "iRobot Create Open Interface" (2006), "iRobot Create 2 Open Interface Specification based on the Roomba 600",
"Hacking Roomba" p. 45 (20 ms after a change of mode). It shares no code with the drivers. What the manuals forbid is
added to `violations`.
"""

import math
import struct
from collections import deque
from dataclasses import dataclass, field

from documented_oi_packets import BAUDS, COMMANDS, DEFAULT_BAUD, FORMATS, Generation, data_length, members
from documented_oi_sensors import OFF, PASSIVE, Sensors

TICK_S = 0.015  # sensor values and the stream are renewed at this rate
ROBOT_RADIUS_MM = 170
SAFE, FULL = 2, 3
STRAIGHT = (-32768, 32767)
_MODE_OPCODES = (130, 131, 132, 133, 134, 135, 136, 143)  # not Start: iRobot's own examples go on at once
_AFTER_MODE_S, _AFTER_BAUD_S, _SLEEP_S = 0.020, 0.100, 300.0
_KNOWING_S = 0.3  # a host may need so long to notice that the robot fell to Passive by itself: packet 35 tells
_MISSING_S = 3.0  # and so long to notice that the robot was switched off: nothing tells
_DRIVES_PER_S = 70
_QUESTIONS = 40  # so many in a row must take as long as their ticks: a single one may be late, and the next not
BANNER = (
    b"bl-start\r\nSTR730\r\nbootloader id: #x47135160 82FA7FFF\r\nRoomba by iRobot!\r\nr3_robot/tags/release-3.5.1\r\n"
)


@dataclass
class OpenInterface(Sensors):
    """The robot."""

    mode: int = OFF
    asleep: bool = False
    violations: list[str] = field(default_factory=list)
    ignored: list[str] = field(default_factory=list)  # commands, but a stop, in a mode in which they do nothing
    commands: list[tuple[float, int, bytes]] = field(default_factory=list)  # (time, opcode, data), executed ones
    songs: dict[int, bytes] = field(default_factory=dict)
    digital_outputs: int = 0
    lamps: tuple[int, int, int] = (0, 0, 0)  # bits, colour and brightness of the power lamp, as commanded
    baud: int = 0
    now_s: float = 0.0

    def __post_init__(self) -> None:
        super().__post_init__()
        self.baud = self.baud or DEFAULT_BAUD[self.generation]
        self._opcode, self._data = -1, b""
        self._powered_s, self._ticks_passed, self._next_tick_s = self.now_s, 0, self.now_s + TICK_S
        self._deaf_until_s, self._deaf_why, self._input_s, self._fell_s = -math.inf, "", self.now_s, -math.inf
        self._asked: deque[float] = deque(maxlen=_QUESTIONS)
        self._drives: deque[float] = deque(maxlen=_DRIVES_PER_S)
        self._drive = (0, 0, 0, 0)  # velocity, radius, right, left as last requested
        self._stream: list[int] = []
        self._streaming = False
        self._song, self._song_until_s = 0, -math.inf

    def told(self) -> dict[int, int]:
        """Return packets 35-42: what the robot says of itself."""
        values = {35: self.mode, 36: self._song, 37: int(self.now_s < self._song_until_s), 38: len(self._stream)}
        return values | dict(zip(range(39, 43), self._drive))

    # -- time ------------------------------------------------------------------------------------------------------

    def advance(self, now_s: float) -> bytes:
        """Let time pass; return what the robot sent meanwhile."""
        sent = b""
        while self._next_tick_s <= now_s:
            self._roll(self._next_tick_s)
            self._ticks_passed += 1
            self._next_tick_s = self._powered_s + (self._ticks_passed + 1) * TICK_S
            self._protect()
            if self._streaming and self.mode != OFF:
                sent += self._stream_frame()
            if self.mode == PASSIVE and self.now_s - self._input_s > _SLEEP_S:
                self.asleep = True
        self._roll(now_s)
        return sent

    def _roll(self, until_s: float) -> None:
        if until_s <= self.now_s:
            return
        before = self.body.left_m, self.body.right_m
        self.body.advance(until_s - self.now_s)
        self.count(self.body.left_m - before[0], self.body.right_m - before[1])
        self.now_s = until_s

    def _protect(self) -> None:
        """Stop in Safe mode and fall to Passive: cliff while driving forward (or tightly), wheel drop, charger."""
        if self.mode != SAFE:
            return
        velocity, radius = self.body.speed_m_s, self._radius_mm()
        cliff = any(self.cliffs) and (
            velocity > 1e-9 or ((velocity or self.body.rate_rad_s) and radius < ROBOT_RADIUS_MM)
        )
        if cliff or self.bumps_and_drops & 0x1C or self.charging_sources:
            self._enter(PASSIVE)
            self._fell_s = self.now_s

    def _radius_mm(self) -> float:
        rate = self.body.rate_rad_s
        return math.inf if rate == 0.0 else abs(self.body.speed_m_s / rate) * 1000.0

    def _enter(self, mode: int) -> None:
        if mode in (OFF, PASSIVE):
            self.body.want(0.0, 0.0)
            self._drive = (0, 0, 0, 0)
            self.digital_outputs = 0
        self.mode, self.lamps = mode, (0, 0, 0)

    def power_cycle(self) -> None:
        """Take the battery out and put it in again."""
        self._enter(OFF)
        self.baud, self.songs, self.asleep = DEFAULT_BAUD[self.generation], {}, False
        self.__post_init__()
        self._fell_s = self.now_s

    def wake(self) -> None:
        """Pulse the BRC line low for a second."""
        self.asleep, self._input_s = False, self.now_s

    # -- robot to host ---------------------------------------------------------------------------------------------

    def _stream_frame(self) -> bytes:
        data = b"".join(bytes([identifier]) + self.packet(identifier) for identifier in self._stream)
        covered = bytes([len(data)]) + data
        total = sum(covered) + (19 if self.header_in_checksum else 0)
        return b"\x13" + covered + bytes([-total & 0xFF])

    # -- host to robot ---------------------------------------------------------------------------------------------

    def receive(self, data: bytes, now_s: float, since_s: float | None = None) -> bytes:
        """Take bytes that came between `since_s` and `now_s`; return the answers.

        What comes too soon is judged by what is certain: the bytes may have come as late as `now_s`, the ones before
        them as early as their own `since_s`.
        """
        since_s = now_s if since_s is None else since_s
        sent = self.advance(now_s)
        for byte in data:
            sent += self._byte(byte, since_s)
        return sent

    def _byte(self, byte: int, since_s: float) -> bytes:
        if self.asleep:
            return b""
        if self.now_s < self._deaf_until_s:
            self._check(False, f"byte {byte} less than {self._deaf_why}")
            return b""
        self._input_s = self.now_s
        if self.mode == OFF and byte not in (7, 128):  # the robot listens for Start and nothing else
            self._check(self.now_s - self._fell_s < _MISSING_S, f"byte {byte} before Start")
            return b""
        if self._opcode < 0:
            if byte not in COMMANDS[self.generation]:
                self._check(False, f"unknown opcode {byte}")
                return b""
            self._opcode, self._data = byte, b""
        else:
            self._data += bytes([byte])
        if data_length(self.generation, self._opcode, self._data) != len(self._data):
            return b""
        opcode, self._opcode = self._opcode, -1
        return self._command(opcode, self._data, since_s)

    def _command(self, opcode: int, data: bytes, since_s: float) -> bytes:
        if self.mode not in COMMANDS[self.generation][opcode][1]:
            if not (opcode in (137, 145) and not any(data)) and self.now_s - self._fell_s > _KNOWING_S:
                self.ignored.append(f"opcode {opcode} {list(data)} in mode {self.mode}")
            return b""
        self.commands.append((self.now_s, opcode, data))
        answer = self._execute(opcode, data, since_s)
        if opcode in _MODE_OPCODES:
            self._deaf_until_s, self._deaf_why = since_s + _AFTER_MODE_S, f"20 ms after opcode {opcode}"
        return answer

    def _execute(self, opcode: int, data: bytes, since_s: float) -> bytes:
        if opcode in (7, 173):
            self._enter(OFF)
            self._streaming = False
            return BANNER if opcode == 7 else b""
        if opcode == 128 or opcode in _MODE_OPCODES:
            self._enter({130: SAFE, 131: SAFE, 132: FULL}.get(opcode, PASSIVE))
            self.asleep = opcode == 133
        elif opcode == 129:
            self._check(data[0] < len(BAUDS), f"baud code {data[0]}")
            self.baud = BAUDS[min(data[0], 11)]
            self._deaf_until_s, self._deaf_why = since_s + _AFTER_BAUD_S, "100 ms after a change of the baud rate"
        elif opcode in (137, 145, 146):
            self._wheels(opcode, *struct.unpack(">hh", data), since_s)
        elif opcode in (140, 141):
            self._music(opcode, data)
        elif opcode in (142, 149):
            return self._answer(list(data[-1:]) if opcode == 142 else list(data[1:]), since_s)
        elif opcode in (148, 150):
            self._set_stream(opcode, data)
        elif opcode == 139:
            self.lamps = (data[0], data[1], data[2])
        elif opcode == 147:
            self._check(data[0] <= 7, f"digital outputs {data[0]}")
            self.digital_outputs = data[0]
        return b""

    def _wheels(self, opcode: int, first: int, second: int, since_s: float) -> None:
        often = len(self._drives) == _DRIVES_PER_S and self.now_s - self._drives[0] < 1.0
        self._check(not often, f"more than {_DRIVES_PER_S} drive commands in a second")
        self._drives.append(since_s)
        limit = 255 if opcode == 146 else 500
        self._check(abs(first) <= limit, f"opcode {opcode}: {first}, {second}")
        if opcode != 137:
            self._check(abs(second) <= limit, f"opcode {opcode}: {first}, {second}")
            self._drive = (0, 0, first, second)
            right, left = (value * 500 / limit for value in (first, second))
        else:
            self._check(second in STRAIGHT or 0 < abs(second) <= 2000, f"drive radius {second}")
            self._drive = (first, second, 0, 0)
            right = left = float(first)
            if abs(second) == 1:
                right, left = first * second, -first * second
            elif second not in (*STRAIGHT, 0):
                half = self.body.wheel_base_m * 500.0
                right, left = first * (second + half) / second, first * (second - half) / second
        self.body.want(max(-500.0, min(500.0, left)) / 1000.0, max(-500.0, min(500.0, right)) / 1000.0)

    def _music(self, opcode: int, data: bytes) -> None:
        self._check(data[0] <= (15 if self.generation is Generation.CREATE_1 else 4), f"song number {data[0]}")
        if opcode == 140:
            self._check(1 <= data[1] <= 16, f"song of {data[1]} notes")
            self.songs[data[0]] = data[2:]
            return
        self._check(self.now_s >= self._song_until_s, "play while a song is playing")
        self._check(data[0] in self.songs, f"play of the song {data[0]}, which was never sent")
        self._song = data[0]
        self._song_until_s = self.now_s + sum(self.songs.get(data[0], b"")[1::2]) / 64.0

    def _answer(self, packets: list[int], since_s: float) -> bytes:
        self._asked.append(since_s)
        often = len(self._asked) == _QUESTIONS and self.now_s - self._asked[0] < TICK_S * (_QUESTIONS - 1)
        self._check(not often, "sensors asked more often than each 15 ms")
        self._check(not self._streaming, "sensors asked while the stream runs")
        self._have(packets)
        return b"".join(self.packet(identifier) for identifier in packets)

    def _set_stream(self, opcode: int, data: bytes) -> None:
        if opcode == 150:
            self._check(data[0] <= 1, f"stream state {data[0]}")
            self._streaming = bool(data[0]) and bool(self._stream)
            return
        self._stream = list(data[1:])
        self._streaming = bool(self._stream)
        self._have(self._stream)
        sizes = [
            struct.calcsize(">" + FORMATS[self.generation][one])
            for i in self._stream
            for one in members(self.generation, i)
        ]
        size, slot = 3 + len(self._stream) + sum(sizes), int(TICK_S * self.baud / 10)
        self._check(size <= slot, f"a stream of {size} bytes each 15 ms, where {slot} fit")

    def _have(self, packets: list[int]) -> None:
        for identifier in packets:
            self._check(
                bool(members(self.generation, identifier)), f"packet {identifier}, which this robot does not have"
            )

    def _check(self, allowed: bool, what: str) -> None:
        if not allowed:
            self.violations.append(what)
