"""Which Kobukis this driver knows: versions of firmware and hardware, and with them of the protocol.

Sources: Yujin Robot, iClebo Kobuki user guide, "Firmware, Version Checking" (a major version breaks the protocol) and
the firmware's changelog (1.1.4 mends the drift of the gyro); kobuki_core, packets firmware and hardware (two bytes).
"""

from typing import NamedTuple


class Version(NamedTuple):
    """Major, minor and patch; the major version of the firmware is that of the protocol."""

    major: int
    minor: int
    patch: int

    def __str__(self) -> str:
        """As people write it."""
        return f"{self.major}.{self.minor}.{self.patch}"


PROTOCOL = 1
KNOWN_FIRMWARE = {Version(1, *rest) for rest in ((0, 0), (1, 0), (1, 1), (1, 2), (1, 3), (1, 4), (2, 0))}
STEADY_GYRO = Version(1, 1, 4)
FIRST, FIRST_NUMBER = Version(1, 0, 0), 123


def decode_version(data: bytes | None) -> Version | None:
    """Four bytes patch, minor, major, 0. Firmware before 1.1.2 sends one decimal number of two bytes: 110 and 10100
    are 1.1.0, 111 and 10101 are 1.1.1, and 123, the first, is 1.0.0. None for another length."""
    if data is None or len(data) not in (2, 4):
        return None
    if len(data) == 4:
        return Version(data[2], data[1], data[0])
    number = int.from_bytes(data, "little")
    base = 100 if number >= 10_000 else 10
    return FIRST if number == FIRST_NUMBER else Version(number // base**2, number // base % base, number % base)


def objection(firmware: Version | None, hardware: Version | None) -> str:
    """Why a Kobuki of these versions must not be driven, with the remedy; empty for one that is known."""
    remedy = (
        f"this driver knows {', '.join(map(str, sorted(KNOWN_FIRMWARE)))}: flash 1.2.0, "
        "or set ~allow_unknown_firmware to drive it all the same"
    )
    if firmware is None:
        return f"the Kobuki has not told its firmware version; {remedy}"
    if firmware.major != PROTOCOL:
        return f"firmware {firmware} speaks protocol {firmware.major}, not {PROTOCOL}; {remedy}"
    if firmware not in KNOWN_FIRMWARE:
        return f"firmware {firmware} is unknown; {remedy}"
    if hardware is not None and hardware.major != PROTOCOL:
        return f"hardware {hardware} is unknown, Kobukis are 1.x; set ~allow_unknown_firmware to drive it all the same"
    return ""
