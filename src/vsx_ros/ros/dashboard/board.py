"""The newest word on each subject, for any number of viewers that each look when they have time."""

import threading
from typing import NamedTuple


class Note(NamedTuple):
    """One subject's newest word. number: counts all words ever posted. text: JSON, one line."""

    number: int
    subject: str
    text: str


class Board:
    """Words replace older ones on the same subject, so a slow viewer skips but never lags. Thread-safe."""

    def __init__(self) -> None:
        self._news = threading.Condition()
        self._notes: dict[str, Note] = {}
        self._number = 0

    def post(self, subject: str, text: str) -> None:
        """Replace what is known of a subject."""
        with self._news:
            self._number += 1
            self._notes[subject] = Note(self._number, subject, text)
            self._news.notify_all()

    def clear(self) -> None:
        """Forget everything: what is old when the next viewer comes would look new."""
        with self._news:
            self._notes.clear()

    def newer_than(self, number: int, timeout_s: float) -> list[Note]:
        """What was posted after the note of that number, oldest first; empty when nothing comes within the time."""
        with self._news:
            self._news.wait_for(lambda: self._number > number, timeout_s)
            return sorted(note for note in self._notes.values() if note.number > number)
