"""The thread of the connection to any device: opens, serves and closes it, and tries again when it fails."""

import logging
import threading
import time
from abc import ABC, abstractmethod
from collections.abc import Callable
from typing import Any, TypeVar

from vsx_hw.errors import DeviceError
from vsx_hw.readings import LinkStatus

logger = logging.getLogger(__name__)

STEADY_S = 5.0
"""A connection that lasted so long was good: retry soon after its loss. A loose plug gets growing pauses."""

Driver = TypeVar("Driver", bound="ConnectionThread")


class ConnectionThread(ABC):
    """A driver runs its ``_serve(device)`` on a daemon thread until it returns. A DeviceError or any other exception in
    it closes the device and leads to a new attempt, after the pauses backoff_s. Usable as a context manager.

    ``_leave`` is called before each close; its DeviceErrors are ignored, as the device may be gone. ``report`` sets the
    state of the connection; each change is logged once and passed to on_link. ``alive`` is False when the thread has
    ended without ``close``; the user of the device should then start again."""

    def __init__(
        self,
        name: str,
        open_device: Callable[[], Any],
        backoff_s: tuple[float, ...],
        on_link: Callable[[bool, str], None] = lambda connected, message: None,
    ) -> None:
        self.closing = threading.Event()
        self.alive, self.connected = True, False
        self.message = "not started"
        self.connections = 0
        self._name = name
        self._open_device, self._on_link = open_device, on_link
        self._backoff_s = backoff_s
        self._connected_s = 0.0
        self._thread = threading.Thread(target=self._run, name=name, daemon=True)

    def __enter__(self: Driver) -> Driver:
        self.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def start(self) -> None:
        """Begin connecting; returns at once."""
        self._thread.start()

    def close(self, timeout_s: float = 3.0) -> bool:
        """Release the device and wait for the thread. Returns whether it has ended."""
        self.closing.set()
        if self._thread.is_alive() and self._thread is not threading.current_thread():
            self._thread.join(timeout_s)
        return not self._thread.is_alive()

    def report(self, connected: bool, message: str) -> None:
        """Set the state of the connection."""
        if message == self.message:
            return
        if connected and not self.connected:
            self.connections += 1
            self._connected_s = time.monotonic()
        self.connected, self.message = connected, message
        named = message if message.startswith(self._name) else f"{self._name}: {message}"
        logger.log(logging.INFO if connected else logging.WARNING, "%s", named)
        self._on_link(connected, message)

    def _status(self, device: str, counters: dict[str, int]) -> LinkStatus:
        told = {"connections": self.connections, **counters}
        return LinkStatus(self.connected, self.message, device, told, alive=self.alive)

    def _run(self) -> None:
        try:
            self._serve_until_closed()
        finally:
            self.alive = self.closing.is_set()

    def _serve_until_closed(self) -> None:
        failures = 0
        while not self.closing.is_set():
            try:
                device = self._open_device()
                try:
                    self._serve(device)
                finally:
                    self._let_go(device)
            except Exception as error:  # a fault in a callback must not leave a device without its driver
                failure = error
            else:
                continue
            steady = self.connected and time.monotonic() - self._connected_s > STEADY_S
            failures = 0 if steady else failures + 1
            self._report_failure(failure)
            self.closing.wait(self._backoff_s[min(failures, len(self._backoff_s) - 1)])

    def _report_failure(self, failure: Exception) -> None:
        """Log and report a failure. Both may fail too: the log on a full disk, or on_link."""
        message = str(failure)
        try:
            if not isinstance(failure, DeviceError):
                message = f"{self._name}: internal fault ({failure!r}); connecting again"
                if message != self.message:
                    logger.error("%s", message, exc_info=failure)
            self.report(False, message)
        except Exception as error:
            self.message = f"{message}; and nobody could be told ({error!r})"

    @abstractmethod
    def _serve(self, device: Any) -> None:
        """Serve one connection until ``closing`` is set or the device fails."""

    def _leave(self, device: Any) -> None:
        """Send the last messages to a device; by default none."""
        return

    def _let_go(self, device: Any) -> None:
        try:
            self._leave(device)
        except DeviceError as error:
            logger.debug("%s: not left properly (%s)", self._name, error)
        finally:
            device.close()
