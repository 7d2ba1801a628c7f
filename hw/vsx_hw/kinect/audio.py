"""The audio part of newer Kinects (1473, for Windows): it has the lamp, and the serial number that the camera lacks.

Source: libfreenect (facts only). The camera streams without it; some units freeze unless the lamp is lit once.
"""

import logging
import struct
from typing import Any

import usb1

logger = logging.getLogger(__name__)

FIRST_MODEL = 0x010B
"""bcdDevice of the camera of model 1414; every other value is a newer one."""
AUDIO_PARTS = ((0x045E, 0x02AD), (0x045E, 0x02BE), (0x045E, 0x02BB), (0x045E, 0x02C3))
_MAGIC, _SET_LAMP, GREEN = 0x06022009, 0x10, 3
_TIMEOUT_MS = 200


def lamp_message(tag: int, color: int) -> bytes:
    """Five little-endian words: magic, tag, length of data, command, colour (1 off, 2 blinking, 3 green, 4 red)."""
    return struct.pack("<5I", _MAGIC, tag, 0, _SET_LAMP, color)


def light_lamp(context: Any) -> str:
    """Light the lamp; the serial number of the audio part, empty without one. Failure is told and does not matter."""
    for device in context.getDeviceIterator(skip_on_error=True):
        if (device.getVendorID(), device.getProductID()) in AUDIO_PARTS:
            try:
                return _light(device)
            except usb1.USBError as error:
                logger.warning("Kinect: lamp and serial number are out of reach (%s); the camera works without", error)
                return ""
    logger.warning("Kinect: its audio part is missing (lamp, serial number); the camera works without")
    return ""


def _light(device: Any) -> str:
    handle = device.open()
    try:
        serial = str(handle.getSerialNumber() or "")
        handle.claimInterface(0)
        handle.bulkWrite(0x01, lamp_message(1, GREEN), _TIMEOUT_MS)
        handle.bulkRead(0x81, 512, _TIMEOUT_MS)
        return serial
    finally:
        handle.close()
