"""The Create 1 and the Create 2 behind a serial port."""

from __future__ import annotations

from collections.abc import Callable, Iterable

from vsx_hw.base_driver import BaseDriver
from vsx_hw.create.odometry import DistanceOdometry, EncoderOdometry
from vsx_hw.create.protocol import (
    CREATE_1,
    CREATE_2,
    Mode,
    Model,
    Opcode,
    StreamParser,
    decode_packets,
    encode_drive_direct,
    encode_query,
    encode_stream_request,
    mode_of,
    packet_bytes,
)
from vsx_hw.readings import BaseReading, BatteryReading, Hazard, OdometryReading
from vsx_hw.transport import SerialTransport

SAFETY_PACKETS = [7, 9, 10, 11, 12, 18, 35]
BATTERY_PACKETS = [21, 22, 25, 26]
ENCODER_PACKETS = [43, 44]
MOTION_PACKETS = [19, 20]

MODE_PAUSE_S = 0.05
"""Commands within 20 ms of a change of mode are lost."""

QUERIES_PER_MOTION = 30
"""Every half second: each reading of distance and angle may cut off most of a millimetre and of a degree."""

CYCLES_TO_RETRY_MODE = 25


class _CreateDialect:
    """What both robots share: modes, hazards, battery, the way to stop. See ``vsx_hw.base_driver.Dialect``.

    The robots are driven in Safe mode: at a cliff or a raised wheel they stop by themselves and fall to Passive. They
    are put back to Safe when the cause is gone, or for reversing from a cliff, and a command to move arrives.
    """

    def __init__(self, model: Model) -> None:
        self._model = model
        self._mode = Mode.UNKNOWN
        self._hazards = Hazard.NONE
        self._cycles_out_of_safe = 0
        self.driving = False

    def wheel_command(self, v_m_s: float, omega_rad_s: float) -> bytes:
        """Drive, or go back to Safe first."""
        self.driving = v_m_s != 0.0 or omega_rad_s != 0.0
        if self._mode in (Mode.SAFE, Mode.FULL, Mode.UNKNOWN):
            self._cycles_out_of_safe = 0
            half = 500.0 * self._model.wheel_base_m * omega_rad_s
            return encode_drive_direct(1000.0 * v_m_s - half, 1000.0 * v_m_s + half)
        self._cycles_out_of_safe += 1
        cause = self._hazards & (Hazard.WHEEL_DROP if v_m_s < 0.0 else Hazard.WHEEL_DROP | Hazard.CLIFF)
        if self.driving and not cause and self._cycles_out_of_safe % CYCLES_TO_RETRY_MODE == 1:
            return bytes((Opcode.SAFE,))
        return b""

    def farewell(self) -> bytes:
        """Wheels still, then Passive: in Safe a robot does not charge and drains its battery. Create 2 sleeps."""
        end = bytes((Opcode.STOP,)) if self._model is CREATE_2 else b""
        return encode_drive_direct(0.0, 0.0) + bytes((Opcode.START,)) + end

    def base_reading(self, values: dict[int, int], odometry: OdometryReading) -> BaseReading:
        """The reading of SAFETY_PACKETS and BATTERY_PACKETS."""
        self._mode = mode_of(values[35])
        self._hazards = hazards_of(values)
        return BaseReading(
            odometry.stamp_ns, odometry, self._hazards, battery_of(values), values[18], self._mode.name.lower()
        )

    def silence(self) -> str:
        """See Dialect."""
        return (
            f"switch the robot on and check ~robot_type: {CREATE_1.name} speaks at {CREATE_1.baud} baud, "
            f"{CREATE_2.name} at {CREATE_2.baud}; this driver listens at {self._model.baud}"
        )


class Create2Dialect(_CreateDialect):
    """Create 2: a stream every 15 ms, odometry by encoders."""

    def __init__(self, linear_scale: float = 1.0, angular_scale: float = 1.0) -> None:
        super().__init__(CREATE_2)
        self._odometry = EncoderOdometry(linear_scale, angular_scale)
        self._parser = StreamParser()

    def hello(self) -> Iterable[tuple[bytes, float]]:
        """See Dialect."""
        packets = SAFETY_PACKETS + BATTERY_PACKETS + ENCODER_PACKETS
        yield bytes((Opcode.START,)), MODE_PAUSE_S
        yield bytes((Opcode.SAFE,)), MODE_PAUSE_S
        yield encode_stream_request(packets, self._model.baud), 0.0

    def receive(self, data: bytes, now_ns: int) -> list[BaseReading]:
        """See Dialect."""
        readings = []
        for values in self._parser.feed(data):
            if values.keys() >= {*SAFETY_PACKETS, *BATTERY_PACKETS, *ENCODER_PACKETS}:
                odometry = self._odometry.update(values[43], values[44], self.driving, now_ns)
                readings.append(self.base_reading(values, odometry))
        return readings

    def drive(self, v_m_s: float, omega_rad_s: float) -> bytes:
        """See Dialect."""
        return self.wheel_command(v_m_s, omega_rad_s)

    def reset_odometry(self) -> None:
        """See Dialect."""
        self._odometry.reset()

    def counters(self) -> dict[str, int]:
        """See Dialect."""
        return {"frames": self._parser.frames, "refused_frames": self._parser.refused}


class Create1Dialect(_CreateDialect):
    """Create 1: questions and answers, because its distance and angle suffer from being read often."""

    def __init__(self, linear_scale: float = 1.0, angular_scale: float = 1.0) -> None:
        super().__init__(CREATE_1)
        self._odometry = DistanceOdometry(linear_scale, angular_scale)
        self._buffer = bytearray()
        self._asked: list[int] = []
        self._queries = 0
        self._frames = self._lost = 0
        self._measured_once = False

    def hello(self) -> Iterable[tuple[bytes, float]]:
        """See Dialect. What the robot printed at start-up is not an answer."""
        self._asked, self._measured_once = [], False
        yield bytes((Opcode.START,)), MODE_PAUSE_S
        yield bytes((Opcode.SAFE,)), MODE_PAUSE_S

    def receive(self, data: bytes, now_ns: int) -> list[BaseReading]:
        """See Dialect."""
        if not self._asked:
            return []
        self._buffer += data
        if len(self._buffer) < sum(packet_bytes(p) for p in self._asked):
            return []
        asked, self._asked = self._asked, []
        values = decode_packets(bytes(self._buffer), asked)
        self._frames += 1
        if 19 in values:
            # The first reading holds whatever happened before this program began.
            if self._measured_once:
                self._odometry.measure(values[19], values[20])
            self._measured_once = True
        return [self.base_reading(values, self._odometry.reading(now_ns))]

    def drive(self, v_m_s: float, omega_rad_s: float) -> bytes:
        """The command, the camera's supply (digital output 0 of a TurtleBot 1, cleared whenever Safe is left), and the
        next question. An answer that did not come in time is given up."""
        if self._asked:
            self._lost += 1
            if 19 in self._asked:
                self._odometry.lose()
        self._buffer.clear()
        self._odometry.command(v_m_s, omega_rad_s)
        self._asked = SAFETY_PACKETS + BATTERY_PACKETS
        if self._queries % QUERIES_PER_MOTION == 0:
            self._asked = self._asked + MOTION_PACKETS
        self._queries += 1
        supply = bytes((Opcode.DIGITAL_OUTPUTS, 1))
        return self.wheel_command(v_m_s, omega_rad_s) + supply + encode_query(self._asked)

    def reset_odometry(self) -> None:
        """See Dialect."""
        self._odometry.reset()

    def counters(self) -> dict[str, int]:
        """See Dialect."""
        return {"frames": self._frames, "refused_frames": self._lost}


def hazards_of(values: dict[int, int]) -> Hazard:
    """Packets 7 (bit 0 right, 1 left bump; 2 right, 3 left, 4 caster drop) and 9-12 (cliffs from left to right)."""
    bumps = values[7]
    hazards = Hazard.NONE
    for bit, hazard in ((1, Hazard.BUMPER_RIGHT), (2, Hazard.BUMPER_LEFT)):
        hazards |= hazard if bumps & bit else Hazard.NONE
    for bit, hazard in ((4, Hazard.WHEEL_DROP_RIGHT), (8, Hazard.WHEEL_DROP_LEFT), (16, Hazard.WHEEL_DROP)):
        hazards |= hazard if bumps & bit else Hazard.NONE
    sides = ((9, Hazard.CLIFF_LEFT), (10, Hazard.CLIFF_CENTER), (11, Hazard.CLIFF_CENTER), (12, Hazard.CLIFF_RIGHT))
    for packet, hazard in sides:
        hazards |= hazard if values[packet] else Hazard.NONE
    return hazards


def battery_of(values: dict[int, int]) -> BatteryReading:
    """Packets 21 (charging state), 22 (mV), 25 and 26 (charge and capacity)."""
    fraction = min(1.0, values[25] / values[26]) if values[26] else 0.0
    charging = values[21] in (1, 2, 3)
    state = "charging" if charging else "critical" if fraction < 0.1 else "low" if fraction < 0.2 else "healthy"
    return BatteryReading(values[22] / 1000.0, fraction, charging, state)


def create_dialect(
    model: Model, linear_scale: float = 1.0, angular_scale: float = 1.0
) -> Create1Dialect | Create2Dialect:
    """How CREATE_1 or CREATE_2 is spoken to."""
    dialect = Create1Dialect if model is CREATE_1 else Create2Dialect
    return dialect(linear_scale, angular_scale)


def create_driver(
    model: Model,
    port: str,
    on_reading: Callable[[BaseReading], None],
    on_link: Callable[[bool, str], None] = lambda connected, message: None,
    command_timeout_s: float = 0.25,
    linear_scale: float = 1.0,
    angular_scale: float = 1.0,
) -> BaseDriver:
    """A driver for CREATE_1 or CREATE_2 at a serial port; call ``start`` on it."""
    return BaseDriver(
        create_dialect(model, linear_scale, angular_scale),
        lambda: SerialTransport(port, model.baud),
        port,
        on_reading,
        on_link,
        command_timeout_s,
    )
