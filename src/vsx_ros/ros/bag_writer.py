"""A ROS 1 bag that grows message by message, on a thread of its own; whole or named .active."""

import os
import queue
import threading
from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

from rosbags.rosbag1 import Writer
from rosbags.rosbag1.writer import WriterError

from vsx_ros.errors import InputError

_WAITING = 500
"""Messages that may wait for the disk: 150 MB of raw images."""

_OVERHEAD_BYTES = 64


class Serialized(NamedTuple):
    """A message as it came over the wire. said: by its publisher, the header of the connection."""

    topic: str
    stamp_ns: int
    said: Mapping[str, str]
    data: bytes


class BagWriter:
    """``put`` never waits; ``close`` writes the index and gives the bag its name. Raises InputError when the file
    cannot be made. ``failure`` says, later, why writing ended early."""

    def __init__(self, path: Path) -> None:
        self._path, self._active = path, path.with_name(f"{path.name}.active")
        self.counts: dict[str, int] = {}
        self.bytes, self.dropped, self.failure = 0, 0, ""
        self._connections: dict[tuple[str, ...], object] = {}
        self._queue: queue.Queue[Serialized | None] = queue.Queue(_WAITING)
        try:
            self._writer = Writer(self._active)
            self._writer.open()
        except (OSError, WriterError) as error:
            raise InputError(f"bag {path} cannot be written ({error}); choose another name or folder") from error
        self._thread = threading.Thread(target=self._write, name="bag", daemon=True)
        self._thread.start()

    def put(self, message: Serialized) -> None:
        """Write it soon; when the disk is too slow it is dropped and counted."""
        try:
            self._queue.put_nowait(message)
        except queue.Full:
            self.dropped += 1

    def close(self) -> Path:
        """Finish; the path of the bag. An empty one is not left behind."""
        self._queue.put(None)
        self._thread.join()
        try:
            self._writer.close()
            if not self.counts:
                self._active.unlink(missing_ok=True)
            elif not self.failure:
                os.replace(self._active, self._path)
                return self._path
        except OSError as error:
            self.failure = self.failure or str(error)
        return self._active

    def _write(self) -> None:
        while (message := self._queue.get()) is not None:
            if self.failure:
                continue
            try:
                self._writer.write(self._connection(message), message.stamp_ns, message.data)  # type: ignore[arg-type]  # bytes will do
            except Exception as error:  # whatever it is: without this thread close would wait for ever
                self.failure = str(error) or repr(error)
                continue
            self.counts[message.topic] = self.counts.get(message.topic, 0) + 1
            self.bytes += len(message.data) + _OVERHEAD_BYTES

    def _connection(self, message: Serialized) -> object:
        """That of the topic and publisher, made when it speaks first."""
        said = message.said
        key = message.topic, said["type"], said.get("callerid", "")
        if key not in self._connections:
            self._connections[key] = self._writer.add_connection(
                message.topic,
                said["type"].replace("/", "/msg/"),
                msgdef=said.get("message_definition", ""),
                md5sum=said["md5sum"],
                callerid=said.get("callerid", ""),
                latching=int(said.get("latching") == "1"),
            )
        return self._connections[key]
