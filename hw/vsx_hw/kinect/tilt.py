"""The motor part of the first Kinect (1414): its accelerometer gives the camera's pitch and roll against gravity.

Source: OpenKinect protocol documentation. Control IN 0xC0, request 0x32, 10 bytes: status and level of the motor, then
i16 big endian x, y, z in counts of 819 per g, i8 twice the tilt in degrees, u8 motor state."""

import math
import struct
from contextlib import closing
from typing import NamedTuple

import usb1

from vsx_hw.errors import DeviceError, DeviceNotFound, ProtocolError

MOTOR = (0x045E, 0x02B0)  # USB vendor and product
COUNTS_PER_G = 819.0  # of its accelerometer
STATE_BYTES = 10  # of the motor's answer
_UNKNOWN_TILT = -128  # while the motor moves


class TiltState(NamedTuple):
    """gravity_g: (x right, y up, z forward) of the standing camera; tilt_deg of its head, None while it moves."""

    gravity_g: tuple[float, float, float]
    tilt_deg: float | None

    @property
    def pitch_rad(self) -> float:
        """Of the base plate; positive when the front points up."""
        x, y, z = self.gravity_g
        return math.atan2(z, math.hypot(x, y))

    @property
    def roll_rad(self) -> float:
        """Of the base plate; positive when the right side is up."""
        return math.atan2(self.gravity_g[0], self.gravity_g[1])


def decode_tilt_state(data: bytes) -> TiltState:
    """The state of the motor part. Raises ProtocolError for another length or no gravity."""
    if len(data) != STATE_BYTES:
        raise ProtocolError(f"Kinect motor: state of {len(data)} bytes, {STATE_BYTES} expected; replug it")
    x, y, z, double_tilt = struct.unpack_from(">hhhb", data, 2)
    gravity = (x / COUNTS_PER_G, y / COUNTS_PER_G, z / COUNTS_PER_G)
    if not 0.5 < math.hypot(*gravity) < 1.5:
        raise ProtocolError(f"Kinect motor: gravity of {math.hypot(*gravity):.2f} g; keep it still and ask again")
    return TiltState(gravity, None if double_tilt == _UNKNOWN_TILT else double_tilt / 2.0)


def read_tilt_state() -> TiltState:
    """Ask the first motor part on the USB. Raises DeviceNotFound without one, DeviceError when it does not answer."""
    with usb1.USBContext() as context:
        handle = context.openByVendorIDAndProductID(*MOTOR, skip_on_error=True)
        if handle is None:
            raise DeviceNotFound("no Kinect motor on the USB; only model 1414 has one, and its 12 V must be on")
        with closing(handle):
            try:
                return decode_tilt_state(bytes(handle.controlRead(0xC0, 0x32, 0, 0, STATE_BYTES, 500)))
            except usb1.USBError as error:
                raise DeviceError(f"Kinect motor: {error}; replug it") from error
