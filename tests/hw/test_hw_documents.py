"""docs/protocols.md against the code: each packet that is decoded or sent, with its type and its length."""

import re
import struct
from pathlib import Path

from vsx_hw.create.protocol import GROUPS, LAYOUT, Opcode, packet_bytes
from vsx_hw.kobuki import protocol as kobuki

TEXT = (Path(__file__).resolve().parents[2] / "docs" / "protocols.md").read_text(encoding="utf-8")
TYPES = {"u8": "B", "i8": "b", "u16": "H", "i16": "h", "u32": "I"}


def rows(heading: str) -> list[list[str]]:
    """The cells of the table rows between this heading and the next."""
    section = re.split(r"\n#+ ", TEXT.partition(f"# {heading}\n")[2])[0]
    lines = [line for line in section.splitlines() if line.startswith("| ")]
    return [[cell.strip() for cell in line.strip("|").split("|")] for line in lines]


def test_every_open_interface_packet_has_its_type_and_a_source():
    told = {int(cells[0]): cells for cells in rows("From the robot") if cells[0].isdigit()}
    assert set(told) == set(LAYOUT)
    for packet, cells in told.items():
        assert ">" + TYPES[cells[2]] == LAYOUT[packet], cells
        assert set(cells[5].split(", ")) <= {"C1", "C2", "S", "TB"}


def test_the_groups_are_as_long_as_told():
    told = re.findall(r"(\d+) = (\d+)-(\d+) \((\d+)\)", TEXT)
    assert {int(group): range(int(a), int(b) + 1) for group, a, b, _ in told} == GROUPS
    assert all(packet_bytes(int(group)) == int(size) for group, _, _, size in told)


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
