"""Sensor packets and commands of the Open Interface, tables written from the manuals of Create and Create 2."""

from enum import Enum

SAFE_OR_FULL, ANY_STARTED, ALWAYS = (2, 3), (1, 2, 3), (0, 1, 2, 3)


class Generation(Enum):
    """Which robot."""

    CREATE_1 = 1
    CREATE_2 = 2


# id: struct format (big endian)
_FORMATS = {7: "B", 8: "B", 9: "B", 10: "B", 11: "B", 12: "B", 13: "B", 14: "B", 15: "B", 16: "B", 17: "B", 18: "B"}
_FORMATS |= {
    19: "h",
    20: "h",
    21: "B",
    22: "H",
    23: "h",
    24: "b",
    25: "H",
    26: "H",
    27: "H",
    28: "H",
    29: "H",
    30: "H",
    31: "H",
}
_FORMATS |= {32: "B", 33: "H", 34: "B", 35: "B", 36: "B", 37: "B", 38: "B", 39: "h", 40: "h", 41: "h", 42: "h"}
_FORMATS_2 = {43: "H", 44: "H", 45: "B", 46: "H", 47: "H", 48: "H", 49: "H", 50: "H", 51: "H", 52: "B", 53: "B"}
_FORMATS_2 |= {54: "h", 55: "h", 56: "h", 57: "h", 58: "B"}
_GROUPS = {0: (7, 26), 1: (7, 16), 2: (17, 20), 3: (21, 26), 4: (27, 34), 5: (35, 42), 6: (7, 42)}
_GROUPS_2 = {100: (7, 58), 101: (43, 58), 106: (46, 51), 107: (54, 58)}

FORMATS = {Generation.CREATE_1: _FORMATS, Generation.CREATE_2: _FORMATS | _FORMATS_2}
GROUPS = {Generation.CREATE_1: _GROUPS, Generation.CREATE_2: _GROUPS | _GROUPS_2}

# opcode: (data bytes, or -1: told by the first data byte(s); OI modes in which it works)
_COMMON = {7: (0, ALWAYS), 128: (0, ALWAYS), 129: (1, ANY_STARTED), 130: (0, ANY_STARTED), 131: (0, ANY_STARTED)}
_COMMON |= {132: (0, ANY_STARTED), 134: (0, ANY_STARTED), 135: (0, ANY_STARTED), 137: (4, SAFE_OR_FULL)}
_COMMON |= {138: (1, SAFE_OR_FULL), 139: (3, SAFE_OR_FULL), 140: (-1, ANY_STARTED), 141: (1, SAFE_OR_FULL)}
_COMMON |= {142: (1, ANY_STARTED), 143: (0, ANY_STARTED), 144: (3, SAFE_OR_FULL), 145: (4, SAFE_OR_FULL)}
_COMMON |= {148: (-1, ANY_STARTED), 149: (-1, ANY_STARTED), 150: (1, ANY_STARTED)}
_ONLY_1 = {136: (1, ANY_STARTED), 147: (1, SAFE_OR_FULL), 151: (1, SAFE_OR_FULL), 152: (-1, ANY_STARTED)}
_ONLY_1 |= {153: (0, ANY_STARTED), 154: (0, ANY_STARTED), 155: (1, ANY_STARTED), 156: (2, ANY_STARTED)}
_ONLY_1 |= {157: (2, ANY_STARTED), 158: (1, ANY_STARTED)}
_ONLY_2 = {
    133: (0, ANY_STARTED),
    136: (0, ANY_STARTED),
    146: (4, SAFE_OR_FULL),
    162: (2, SAFE_OR_FULL),
    163: (4, SAFE_OR_FULL),
}
_ONLY_2 |= {
    164: (4, SAFE_OR_FULL),
    165: (1, ANY_STARTED),
    167: (15, ANY_STARTED),
    168: (3, ANY_STARTED),
    173: (0, ANY_STARTED),
}

COMMANDS = {Generation.CREATE_1: _COMMON | _ONLY_1, Generation.CREATE_2: _COMMON | _ONLY_2}
BAUDS = (300, 600, 1200, 2400, 4800, 9600, 14400, 19200, 28800, 38400, 57600, 115200)
DEFAULT_BAUD = {Generation.CREATE_1: 57600, Generation.CREATE_2: 115200}


def data_length(generation: Generation, opcode: int, data: bytes) -> int | None:
    """Return how many data bytes follow `opcode`, or None while the bytes that tell it are missing."""
    length = COMMANDS[generation][opcode][0]
    if length >= 0:
        return length
    if opcode == 140:  # song number, notes, (note, duration) each
        return 2 + 2 * data[1] if len(data) > 1 else None
    return 1 + data[0] if data else None


def members(generation: Generation, packet: int) -> list[int]:
    """Return the single packets of a packet or group; an empty list for one that this robot does not have."""
    if packet in GROUPS[generation]:
        first, last = GROUPS[generation][packet]
        return list(range(first, last + 1))
    return [packet] if packet in FORMATS[generation] else []
