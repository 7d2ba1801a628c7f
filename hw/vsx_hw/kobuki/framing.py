"""The envelope of Kobuki messages, the same in both directions: ``AA 55 LEN payload XOR``."""

from functools import reduce
from operator import xor

HEADER = b"\xaa\x55"
LONGEST_PAYLOAD = 128
"""The longest legal payload is 124 bytes; a larger LEN is a false header and would swallow good frames."""


def encode_frame(*payloads: bytes) -> bytes:
    """One frame around sub-payloads."""
    body = b"".join(payloads)
    body = bytes((len(body),)) + body
    return HEADER + body + bytes((reduce(xor, body),))


def sub_payloads(payload: bytes) -> list[tuple[int, bytes]] | None:
    """(id, data) of each part, or None unless the parts tile the payload exactly."""
    parts = []
    at = 0
    while at + 2 <= len(payload):
        length = payload[at + 1]
        parts.append((payload[at], payload[at + 2 : at + 2 + length]))
        at += 2 + length
    return parts if at == len(payload) and parts else None


class FrameScanner:
    """Finds frames in a byte stream. After a bad one it looks again from the second byte of its header, so that a good
    frame inside is not lost."""

    def __init__(self) -> None:
        self.skipped_bytes = 0
        self._buffer = bytearray()

    def feed(self, data: bytes) -> list[bytes]:
        """Payloads with a correct checksum completed by these bytes."""
        self._buffer += data
        return list(iter(self._next, None))

    def clear(self) -> None:
        """Forget a frame that has begun."""
        self._buffer.clear()

    def _next(self) -> bytes | None:
        buffer = self._buffer
        while True:
            self._skip_to_header()
            if len(buffer) < 3:
                return None
            length = buffer[2]
            if length > LONGEST_PAYLOAD or length == 0:
                self._skip(1)
                continue
            if len(buffer) < length + 4:
                return None
            if reduce(xor, buffer[2 : length + 4]):
                self._skip(1)
                continue
            payload = bytes(buffer[3 : length + 3])
            del buffer[: length + 4]
            return payload

    def _skip_to_header(self) -> None:
        at = self._buffer.find(HEADER)
        if at < 0:
            at = len(self._buffer) - (self._buffer[-1:] == HEADER[:1])
        self._skip(at)

    def _skip(self, count: int) -> None:
        self.skipped_bytes += count
        del self._buffer[:count]
