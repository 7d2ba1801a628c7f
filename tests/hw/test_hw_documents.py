"""docs/protocols.md against the code: each packet that is decoded or sent, with its type and its length."""

import re
import struct
from pathlib import Path

import numpy as np

from vsx_hw.create.protocol import GROUPS, LAYOUT, Opcode, packets_bytes
from vsx_hw.kinect import protocol as kinect
from vsx_hw.kinect import tilt, usb_transport
from vsx_hw.kinect.emulator import KinectBoard
from vsx_hw.kobuki import feedback as kobuki

TEXT = (Path(__file__).resolve().parents[2] / "docs" / "protocols.md").read_text(encoding="utf-8")
TYPES = {"u8": "B", "i8": "b", "u16": "H", "i16": "h", "u32": "I"}

CONTROL, PACKETS, MOTOR, AUDIO = re.findall(r"^### (.+)$", TEXT.partition("## Kinect\n")[2], re.MULTILINE)


def rows(heading: str) -> list[list[str]]:
    """The cells of the table rows between this heading and the next."""
    section = re.split(r"\n#+ ", TEXT.partition(f"# {heading}\n")[2])[0]
    lines = [line for line in section.splitlines() if line.startswith("| ")]
    return [[cell.strip() for cell in line.strip("|").split("|")] for line in lines]


def test_every_open_interface_packet_has_its_type_and_a_source():
    told = {int(cells[0]): cells for cells in rows("From the robot") if cells[0].isdigit()}
    assert set(told) == set(LAYOUT)
    for packet, cells in told.items():
        assert TYPES[cells[2]] == LAYOUT[packet], cells
        assert set(cells[5].split(", ")) <= {"C1", "C2", "S", "TB"}


def test_the_groups_are_as_long_as_told():
    told = re.findall(r"(\d+) = (\d+)-(\d+) \((\d+)\)", TEXT)
    assert {int(group): range(int(a), int(b) + 1) for group, a, b, _ in told} == GROUPS
    assert all(packets_bytes([int(group)]) == int(size) for group, _, _, size in told)


def test_every_command_to_a_create_is_told():
    assert {int(cells[0]) for cells in rows("To the robot") if cells[0].isdigit()} == {int(code) for code in Opcode}


def test_every_kobuki_part_is_as_long_as_told():
    """The fields of the tables fill their parts, and the core part is decoded in their order."""
    parts: dict[str, list[str]] = {}
    sizes: dict[str, str] = {}
    for cells in rows("From the base") + rows("To the base"):
        if cells[1].isdigit() or "+" in cells[1]:
            name, sizes[cells[0]] = cells[0], cells[1]
        if cells[0] == "" or cells[1].isdigit():
            parts.setdefault(name, []).append(_layout(cells[3], cells[2]))
    wanted = {name: int(size) for name, size in sizes.items() if size.isdigit()}
    assert {name: struct.calcsize("<" + "".join(parts[name])) for name in wanted} == wanted
    assert "".join(parts["1 core"]) == "HBBBHHbbBBBB"
    assert len("".join(parts["1 core"])) == len(kobuki.Core._fields)
    assert {int(name.split()[0]) for name in sizes} >= {1, 3, 4, 5, 6, 9, 10, 11, 12, 13, 14, 16, 19, 21}


def test_every_kinect_command_is_as_long_as_told():
    told = {int(cells[0].split()[0], 16): cells[1].count("u16") for cells in rows(CONTROL) if "regist" in cells[0][4:]}
    board, sent = KinectBoard(), {kinect.WRITE_REGISTER: (5, 1), kinect.CMOS_REGISTER: (1, kinect.EXPOSURE_MODES, 0)}
    assert told == {command: len(words) for command, words in sent.items()}
    for command, words in sent.items():
        message = kinect.encode_message(command, 7, *words)
        assert kinect.decode_message(message) == (command, 7, words)
        board.control_out(message)
        assert board.control_in(), "obeyed"


def test_every_kinect_register_is_told_with_all_values_it_is_given():
    told: dict[int, str] = {}
    for cells in rows(CONTROL):
        for address in re.findall(r"^0x\w+$|^0x\w+(?=,)|(?<=, )0x\w+$", cells[0]):
            told[int(address, 16)] = cells[2]
    given: dict[int, set[int]] = {}
    for register in (*kinect.STOP, *(register for mode in kinect.MODES.values() for register in mode.start)):
        given.setdefault(register.address, set()).add(register.value)
    assert set(told) == set(given)
    for address, values in given.items():
        assert values <= {int(number) for number in re.findall(r"\d+", told[address])}, hex(address)
    sensor = next(cells for cells in rows(CONTROL) if cells[0].startswith("sensor"))
    bits = [1 << int(bit) for bit in re.findall(r"bit (\d+)", sensor[2])]
    assert int(sensor[0].split()[1], 16) == kinect.EXPOSURE_MODES
    assert bits == [kinect.AUTOMATIC_EXPOSURE, kinect.AUTOMATIC_WHITE_BALANCE]


def test_a_kinect_packet_is_laid_out_as_told():
    told = [cells for cells in rows(PACKETS) if cells[0].isdigit()]
    assert _ends(told[:-1]) == kinect.HEADER_BYTES == int(told[-1][0])
    assert told[-1][2] == f"up to {kinect.PACKET_DATA_BYTES} x u8"
    assert f"at most {kinect.PACKET_BYTES} bytes" in PACKETS
    at = {cells[1]: int(cells[0]) for cells in told}
    packets = kinect.packetize(np.zeros((480, 640), np.uint8), 0x01020304, 255)
    magic, flags, clock = (next(cells[3] for cells in told if cells[1] == name) for name in ("magic", "flag", "clock"))
    assert packets[0][: at["flag"] - 1].hex(" ") == magic
    assert [f"0x{packets[k][at['flag']]:02X}" for k in (0, 1, -1)] == re.findall(r"0x\w+", flags)
    assert [packet[at["sequence"]] for packet in packets[:2]] == [255, 0]
    assert packets[-1][at["clock"] : at["data"]] == struct.pack("<I", 0x01020304)
    assert f"{kinect.CLOCK_HZ // 10**6} MHz" in clock
    assert f"wraps after {2**kinect.CLOCK_BITS / kinect.CLOCK_HZ:.1f} s" in clock


def test_the_images_of_a_kinect_are_as_large_as_told():
    told = re.findall(r"(VGA Bayer|UYVY|SXGA Bayer): ([\d,]+)(?: bytes)? in (\d+)", TEXT)
    modes = {"VGA Bayer": kinect.VGA_BAYER, "UYVY": kinect.VGA_UYVY, "SXGA Bayer": kinect.SXGA_BAYER}
    assert [name for name, _, _ in told] == list(modes)
    for name, size, packets in told:
        assert int(size.replace(",", "")) == modes[name].frame_bytes
        assert len(kinect.packetize(np.zeros(modes[name].frame_bytes, np.uint8), 0, 0)) == int(packets)


def test_the_motor_and_the_audio_part_are_laid_out_as_told():
    motor = [cells for cells in rows(MOTOR) if cells[0].isdigit()]
    assert _ends(motor) == tilt.STATE_BYTES
    state = tilt.decode_tilt_state(struct.pack(">BBhhhbB", 0, 0, 0, 819, 0, -10, 0))
    assert (state.gravity_g, state.tilt_deg) == ((0.0, 1.0, 0.0), -5.0)
    assert [cells[3].split(":")[0] for cells in motor if cells[0] == "2"] == [f"1/{tilt.COUNTS_PER_G:.0f} g"]
    lamp = [cells for cells in rows(AUDIO) if cells[0].isdigit()]
    told = [int(cells[3].split()[0], 0) for cells in lamp if cells[1] in ("magic", "data length", "command")]
    assert _ends(lamp) == len(usb_transport.lamp_message(7, 3))
    assert struct.unpack("<5I", usb_transport.lamp_message(7, 3)) == (told[0], 7, *told[1:], 3)
    assert f"{usb_transport.GREEN} green" in lamp[-1][3]


def test_the_parts_of_a_kinect_have_their_ids():
    ids = [f"{vendor:04x}:{product:04x}" for vendor, product in usb_transport.AUDIO_PARTS]
    assert re.findall(r"\w{4}:\w{4}|(?<=, )\w{4}", AUDIO) == [ids[0], *(one[5:] for one in ids[1:])]
    cameras = [
        f"{vendor:04x}:{product:04x}" for vendor, product in (usb_transport.XBOX, usb_transport.KINECT_FOR_WINDOWS)
    ]
    assert re.findall(r"\w{4}:\w{4}", CONTROL) == cameras
    assert "{:04x}:{:04x}".format(*tilt.MOTOR) in MOTOR


def _ends(cells: list[list[str]]) -> int:
    """Bytes of a table with a column of offsets, each of which follows from the field before."""
    offset = 0
    for row in cells:
        assert int(row[0]) == offset, row
        names = 3 if "x, y, z" in row[1] else 1
        offset += names * struct.calcsize("<" + _layout(row[2].removesuffix(" each"), row[1]))
    return offset


def _layout(types: str, names: str) -> str:
    """struct letters of 'u16', 'u8, u8', '3 x u16', or 'u8 each' for as many as are named."""
    if types.endswith("each"):
        many = 4 if "0 to 3" in names else 3 if "three" in names else names.count(",") + 1
        return TYPES[types.split()[0]] * many
    letters = ""
    for one in types.split(", "):
        count, _, kind = one.rpartition(" x ")
        letters += TYPES[kind] * int(count or 1)
    return letters
