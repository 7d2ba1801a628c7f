"""The files of the page: those in the folder ``page``, and no others."""

from importlib import resources
from typing import NamedTuple

_KINDS = {
    ".html": "text/html; charset=utf-8",
    ".css": "text/css; charset=utf-8",
    ".js": "text/javascript; charset=utf-8",
}


class PageFile(NamedTuple):
    """kind: its content type."""

    kind: str
    content: bytes


def page_file(path: str) -> PageFile | None:
    """The file at a path of the address: / is index.html, /map.js is map.js; None if there is none."""
    wanted = "index.html" if path == "/" else path.removeprefix("/")
    for file in resources.files(__package__).joinpath("page").iterdir():
        kind = _KINDS.get(f".{file.name.rpartition('.')[2]}")
        if file.name == wanted and kind is not None:
            return PageFile(kind, file.read_bytes())
    return None
