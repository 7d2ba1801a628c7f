"""The thread that keeps a device outlives whoever listens to it, or is known to be dead."""

import threading

import pytest
from waiting import PATIENCE_S

from vsx_hw.connection_thread import ConnectionThread
from vsx_hw.errors import DeviceError


class Port:
    def close(self) -> None:
        pass


class Told(ConnectionThread):
    """A device that cannot be opened twice and then works; who is told of it fails."""

    def __init__(self, error: type[BaseException]) -> None:
        super().__init__("port", self.open, (0.01,), self.fail)
        self.attempts = 0
        self.served = threading.Event()
        self._error = error

    def open(self) -> Port:
        self.attempts += 1
        if self.attempts < 3:
            raise DeviceError(f"no such port, attempt {self.attempts}")
        return Port()

    def _serve(self, _: Port) -> None:
        self.served.set()
        self.closing.wait(PATIENCE_S)

    def fail(self, *_: object) -> None:
        raise self._error(28, "No space left on device")


def test_a_listener_that_fails_leaves_no_device_without_its_driver() -> None:
    told = Told(OSError)
    told.start()
    assert told.served.wait(PATIENCE_S)
    assert "nobody could be told" in told.message
    assert told.alive
    assert told.close()
    assert told.alive, "it was asked to end"


@pytest.mark.filterwarnings("ignore::pytest.PytestUnhandledThreadExceptionWarning")
def test_a_keeper_that_ended_by_itself_is_known_to_be_dead() -> None:
    told = Told(SystemExit)
    told.start()
    told._thread.join(PATIENCE_S)
    assert not told.alive
