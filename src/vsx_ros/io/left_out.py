"""What of a recording cannot be used and is left out: how much, and the first of it in words."""

from collections.abc import Callable, Iterable, Iterator
from typing import ParamSpec, TypeVar

from vsx_ros.errors import InputError, VsxError

P = ParamSpec("P")
T = TypeVar("T")


class LeftOut:
    """count: how many were left out. first: what is wrong with the first of them. used: how many were not left out."""

    def __init__(self) -> None:
        self.count = self.used = 0
        self.first: VsxError | None = None

    def of(self, items: Iterable[T | VsxError], most_in_vain: int = 0) -> Iterator[T]:
        """The items, without those in whose place an error tells why they cannot be used. most_in_vain: if so many come
        before the first usable one, end; 0: never."""
        for item in items:
            if not isinstance(item, VsxError):
                self.used += 1
                yield item
                continue
            self.count += 1
            self.first = self.first or item
            if not self.used and self.count == most_in_vain:
                return

    def words(self, of: str) -> str:
        """What was left out, in one sentence. of: e.g. "60 images"."""
        return f"{self.count} of {of} left out, as they cannot be used; the first: {self.first}"


def usable(items: Iterable[T | VsxError], what: str, damage: list[str]) -> Iterator[T]:
    """The items that can be used (see ``LeftOut``); how many are left out is added to ``damage``, in words. what: e.g.
    "readings of /odom"."""
    left_out = LeftOut()
    yield from left_out.of(items)
    if left_out.count:
        damage.append(left_out.words(f"{left_out.count + left_out.used} {what}"))


def tried(make: Callable[P, T], *args: P.args, **more: P.kwargs) -> T | InputError:
    """What the function returns, or the InputError that it raises."""
    try:
        return make(*args, **more)
    except InputError as error:
        return error


def until_damage(items: Iterable[T], damage: list[str]) -> Iterator[T]:
    """The items up to where they cannot be read any more (InputError), which is added to ``damage`` in words."""
    try:
        yield from items
    except InputError as error:
        damage.append(str(error))
