"""A Kinect's transport whose answers are written down."""

from vsx_hw.kinect.emulator import KinectBoard


class ScriptedTransport:
    """A camera that answers at once and remembers the order of things."""

    serial = "A1"

    def __init__(self, log: list[str]) -> None:
        self.board = KinectBoard()
        self.log = log
        self.handler = None

    def control_out(self, data: bytes) -> None:
        self.log.append(data[8:].hex())
        self.board.control_out(data)

    def control_in(self, size: int) -> bytes:
        return self.board.control_in()

    def start_iso(self, handler) -> None:
        self.log.append("receive")
        self.handler = handler

    def stop_iso(self) -> None:
        self.log.append("cancel")
        self.handler = None

    def failure(self) -> str:
        return ""

    def close(self) -> None:
        self.log.append("close")
