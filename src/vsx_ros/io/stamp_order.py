"""Puts what was recorded in the order of its stamps."""

from collections.abc import Iterable, Iterator, Sequence
from typing import Generic, Protocol, TypeVar

from vsx_ros.errors import InputError

AHEAD_NS = 1_000_000_000  # a stamp this far ahead of later messages is wrong, or they are


class _Stamped(Protocol):
    @property
    def stamp_ns(self) -> int: ...


T = TypeVar("T", bound=_Stamped)


class StampOrder(Generic[T]):
    """Sorts messages that come nearly in order. ``left_out`` counts the others so far: those with the stamp of another
    one, those that come too late, and those with a stamp more than a second off: of two messages in the wrong order,
    the one that more of the next ones contradict."""

    def __init__(self, held: int) -> None:
        """held: so many messages wait, and are in memory."""
        self._most, self._held, self._last_ns = held, list[T](), -1
        self.left_out = 0

    def of(self, messages: Iterable[T]) -> Iterator[T]:
        """The messages, each later than the one before. An InputError in ``messages`` is raised after those before
        it."""
        damage = None
        try:
            for message in messages:
                self._hold([*self._held, message])
                if len(self._held) > self._most:
                    yield from self._next()
        except InputError as error:
            damage = error
        while self._held:
            yield from self._next()
        if damage is not None:
            raise damage

    def _next(self) -> Iterator[T]:
        """The earliest message, if none before it contradicts it; else leaves out what is wrong."""
        stamps = [message.stamp_ns for message in self._held]
        first = stamps.index(min(stamps))
        later = next((k for k in range(first) if stamps[k] > stamps[first] + AHEAD_NS), None)
        if later is None:
            message = self._held.pop(first)
            self._last_ns = message.stamp_ns
            self._hold(self._held)
            yield message
            return
        earlier = {k for k in range(later, len(stamps)) if stamps[k] < stamps[later] - AHEAD_NS}
        wrong = {later} if 2 * len(earlier) >= len(stamps) - later - 1 else earlier
        self.left_out += len(wrong)
        self._held = [message for k, message in enumerate(self._held) if k not in wrong]

    def _hold(self, messages: Sequence[T]) -> None:
        """Hold those of the messages that are later than the last one given."""
        self._held = [message for message in messages if message.stamp_ns > self._last_ns]
        self.left_out += len(messages) - len(self._held)
