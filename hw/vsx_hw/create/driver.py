"""The protocols of the Create 1 and the Create 2 for ``BaseDriver``."""

from collections.abc import Iterable, Mapping

from vsx_hw.base_driver import KEEP_ALIVE_NS, STALE_NS
from vsx_hw.create import protocol
from vsx_hw.create.dialect import BATTERY_PACKETS, QUESTION, SAFETY_PACKETS, CreateDialect
from vsx_hw.create.odometry import BoardGyro, DistanceOdometry, EncoderOdometry
from vsx_hw.readings import BaseReading

ENCODER_PACKETS = [43, 44]  # counts of the left and the right wheel
INFRARED_PACKETS = [17, 52, 53]  # characters: from all sides, left, right
STREAM_PACKETS = SAFETY_PACKETS + BATTERY_PACKETS + INFRARED_PACKETS + ENCODER_PACKETS
GYRO_PACKET = 33  # the analogue input of the cargo bay
STILL_QUESTION = [*QUESTION, INFRARED_PACKETS[0], GYRO_PACKET]
MOTION_QUESTION = [1, 2, 3, 34, 35, GYRO_PACKET]
"""The same, and in group 2 packets 19 and 20: distance and angle since the last request."""

TELLTALE_PACKET = 32  # the cargo bay's digital inputs
"""Asked first in every second question: so the answer to the question before has another length, or makes no sense."""

COMMANDS_PER_MOTION = 25
"""Every half second, or every second if answers are slow: each reading of distance and angle may lose almost a
millimetre and a degree."""
COMMAND_MS = KEEP_ALIVE_NS // 1_000_000
LONGEST_WAIT, LONGEST_REST = 2, 3
"""Commands for which an answer is awaited, and for which the line must be quiet after bytes that came too late."""
QUICK_ANSWERS = 10  # This many in a row before the next command: a missing one is given up with it


class Create2Dialect(CreateDialect):
    """Create 2: a stream every 15 ms, odometry by encoders."""

    def __init__(self, linear_scale: float = 1.0, angular_scale: float = 1.0) -> None:
        super().__init__(protocol.CREATE_2)
        self.odometry: EncoderOdometry = EncoderOdometry(linear_scale, angular_scale)
        self._parser = protocol.StreamParser(STREAM_PACKETS)
        self._refused = self._heard_ns = 0

    def hello(self) -> Iterable[tuple[bytes, float]]:
        """See Dialect."""
        yield from super().hello()
        yield protocol.encode_stream_request(STREAM_PACKETS, self._model.baud), 0.0

    def receive(self, data: bytes, now_ns: int) -> list[BaseReading]:
        """See Dialect."""
        readings = []
        frames = self._parser.feed(data)
        for values, stamp_ns in zip(frames, self._stamps_ns(len(frames), now_ns)):
            if list(values) != STREAM_PACKETS or not self.believes(
                values, self.odometry.can_follow(values[43], values[44], stamp_ns)
            ):
                self._refused += 1
            else:
                odometry = self.odometry.update(values[43], values[44], self.driving, stamp_ns)
                readings.append(self.base_reading(values, odometry))
        return readings

    def _stamps_ns(self, frames: int, now_ns: int) -> list[int]:
        """When the frames of one read were sent. Adapters and busy computers hand over several at once: the last one is
        of now, each one before it is a period older, but all are newer than the read before."""
        if not frames:
            return []
        pause_ns, self._heard_ns = now_ns - self._heard_ns, now_ns
        # The host's clock may have been set back.
        period_ns = min(protocol.STREAM_PERIOD_NS, pause_ns // frames) if pause_ns > 0 else protocol.STREAM_PERIOD_NS
        return [now_ns - k * period_ns for k in reversed(range(frames))]

    def counters(self) -> dict[str, int]:
        """See Dialect."""
        return {"frames": self._parser.frames - self._refused, "refused_frames": self._parser.refused + self._refused}


class Create1Dialect(CreateDialect):
    """Create 1: questions and answers, because frequent readings make its distance and angle worse."""

    def __init__(self, linear_scale: float = 1.0, angular_scale: float = 1.0) -> None:
        super().__init__(protocol.CREATE_1)
        self.row_ns = STALE_NS  # a lost answer is counted
        self.odometry: DistanceOdometry = DistanceOdometry(linear_scale, angular_scale)
        self._gyro = BoardGyro()
        self._buffer = bytearray()
        self._asked: list[int] = []
        self._telltale, self._heard = False, True
        self._commands = self._waited = self._rest = self._quick = self._silent = 0
        self._frames = self._lost = 0
        self._measured_once = self._rolled = False

    def hello(self) -> Iterable[tuple[bytes, float]]:
        """See Dialect. The robot's start-up text is not an answer. The motion since the last reading is lost, as the
        first reading of a connection is not used."""
        if self._measured_once:
            self.odometry.lose()
        self._asked, self._measured_once = [], False
        self._gyro = BoardGyro()  # its board may have been off
        self._heard, self._rest, self._quick, self.late = True, 0, 0, ""
        yield from super().hello()
        yield bytes((protocol.Opcode.PAUSE_STREAM, 0)), 0.0

    def receive(self, data: bytes, now_ns: int) -> list[BaseReading]:
        """See Dialect. Bytes without an open question are a late answer, whose motion already counts as lost. More may
        be on their way, also after too many bytes: the next question waits until the line was quiet."""
        heard, self._heard = self._heard, True
        if not heard and (not self._asked or self._silent > self._waited):
            self.late = f"answers only after more than {self._silent * COMMAND_MS} ms"
        if not self._asked:
            if self._rest or not heard:
                self._quick, self._rest = 0, LONGEST_REST
            return []
        self._buffer += data
        expected = protocol.packets_bytes(self._asked)
        if len(self._buffer) < expected:
            return []
        values = protocol.decode_packets(bytes(self._buffer[:expected]), self._asked)
        if len(self._buffer) > expected or not self.believes(values):
            if len(self._buffer) > expected:
                self._quick, self._rest = 0, LONGEST_REST
            self._give_up()
            return []
        self._asked, self.late = [], ""
        self._quick = 0 if self._waited else self._quick + 1
        self._frames += 1
        return [self._reading(values, now_ns)]

    def _reading(self, values: Mapping[int, int], now_ns: int) -> BaseReading:
        if 19 in values:
            # The first reading also contains the motion before this connection.
            self._rolled = self._measured_once and any((values[19], values[20]))
            if self._measured_once:
                self.odometry.measure(values[19], values[20], now_ns)
            else:
                self.odometry.begin(now_ns)
            self._measured_once = True
        gyro = self._gyro.reading(values[GYRO_PACKET], not (self.driving or self._rolled), now_ns)
        odometry = self.odometry.reading(now_ns, None if gyro is None else gyro.rate_rad_s)
        if gyro is not None:
            gyro = gyro._replace(trusted=self.odometry.gyro_trusted)
        return self.base_reading(values, odometry, gyro)

    def waits(self) -> bool:
        """See Dialect."""
        return bool(self._asked or self._rest)

    def drive(self, v_m_s: float, omega_rad_s: float) -> bytes:
        """The command, the camera's supply (digital output 0 of a TurtleBot 1, cleared whenever Safe is left), and the
        next question, unless an answer, or a quiet line, is still awaited. After a missing answer there is no question,
        so that late bytes are not taken for the next answer. After a change of mode there is none either, as the robot
        would not hear it."""
        command = super().drive(v_m_s, omega_rad_s) + (
            bytes((protocol.Opcode.DIGITAL_OUTPUTS, 1)) if self.obeys and not self.deaf else b""
        )
        self._commands += 1
        self._silent += 1
        if self._asked:
            self._wait()
        elif self._rest:
            self._rest -= 1
        elif not self.deaf:
            return command + self._question()
        return command

    def _wait(self) -> None:
        """The answer has not come before this command: it is awaited on, or given up."""
        self._waited += 1
        quick = self._quick >= QUICK_ANSWERS
        if quick or self._waited >= LONGEST_WAIT:
            self._give_up()
            self._rest = 0 if quick else LONGEST_REST

    def _question(self) -> bytes:
        if self._heard:
            self._heard, self._silent = False, 0
        if self._commands > COMMANDS_PER_MOTION:
            self._commands = 1
        self._telltale = not self._telltale
        question = MOTION_QUESTION if self._commands == 1 else STILL_QUESTION
        self._asked = [*[TELLTALE_PACKET] * self._telltale, *question]
        self._waited = 0
        self._buffer.clear()
        return protocol.encode_query(self._asked)

    def _give_up(self) -> None:
        """The answer is lost. If it was to hold the motion, ask again: what the robot has sent is lost, what it has not
        sent still counts up inside the robot."""
        self._lost += 1
        if 19 in protocol.single_packets(self._asked):
            self.odometry.lose()
            self._commands = COMMANDS_PER_MOTION
        self._asked = []

    def silence(self) -> str:
        """See Dialect."""
        return (
            f"they must come within {LONGEST_WAIT * COMMAND_MS} ms: look for a slow adapter or hub"
            if self.late
            else super().silence()
        )

    def counters(self) -> dict[str, int]:
        """See Dialect."""
        return {"frames": self._frames, "refused_frames": self._lost}
