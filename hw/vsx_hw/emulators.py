"""The three emulated bases by the names of ``vsx_hw.bases``."""

from vsx_hw.create.emulator import CreateBoard
from vsx_hw.create.protocol import CREATE_1, CREATE_2
from vsx_hw.kobuki.emulator import KobukiBoard
from vsx_hw.serial_emulator import Board, Plant, SerialEmulator


def base_emulator(kind: str, plant: Plant, link: str, seed: int = 0) -> SerialEmulator:
    """A base on emulated wheels behind the serial port ``link``; start it, or use it as a context manager. Raises
    KeyError for a kind that is not in BASES."""
    if kind == "kobuki":
        board: Board = KobukiBoard(plant, seed)
    else:
        board = CreateBoard({model.name: model for model in (CREATE_1, CREATE_2)}[kind], plant, seed)
    return SerialEmulator(board, plant, link, seed)
