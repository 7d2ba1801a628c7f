"""Where the parts of a Gazebo world lie: ``model://`` and ``file://`` addresses, textures beside their meshes."""

import re
from collections.abc import Iterator, Sequence
from functools import lru_cache
from pathlib import Path
from urllib.parse import unquote

_SCHEME = re.compile(r"^([A-Za-z][A-Za-z0-9+.-]+):/*")
_NETWORK = ("http", "https", "fuel", "ftp")


def is_remote(uri: str) -> bool:
    """Whether the address needs a network."""
    scheme = _SCHEME.match(uri)
    return scheme is not None and scheme[1].lower() in _NETWORK


class ModelFolders:
    """Folders whose subfolders are models, the first match wins. The case of letters may be wrong."""

    def __init__(self, folders: Sequence[Path]) -> None:
        self.folders = tuple(dict.fromkeys(folder.resolve() for folder in folders if folder.is_dir()))
        self._found: dict[tuple[str, Path], Path | None] = {}

    def find(self, uri: str, beside: Path) -> Path | None:
        """The existing file or folder of a URI, or None. beside: folder of the file that names it."""
        if (uri, beside) not in self._found:
            self._found[uri, beside] = self._search(uri, beside)
        return self._found[uri, beside]

    def used(self) -> list[Path]:
        """The files found so far: of a model's folder, all; of another folder, those in it; beside a mesh, those of its
        name, and textures in the usual folders."""
        used: set[Path] = set()
        for place in filter(None, self._found.values()):
            if place.is_dir():
                used.update(place.rglob("*") if (place / "model.config").is_file() else place.iterdir())
                continue
            used.update(file for file in place.parent.iterdir() if file.stem == place.stem)
            for folder in _texture_folders(place.parent, place.parent.parent):
                if folder != place.parent:
                    used.update(folder.glob("*"))
        return sorted(file for file in used if file.is_file())

    def _search(self, uri: str, beside: Path) -> Path | None:
        uri = uri.strip()
        if not uri or is_remote(uri):
            return None
        scheme = _SCHEME.match(uri)
        rest = unquote(uri[scheme.end() :] if scheme else uri).replace("\\", "/")
        absolute = Path("/" + rest) if scheme is None and rest.startswith("/") or uri.startswith("file:///") else None
        if absolute is not None and _exists(absolute):
            return absolute
        near = (beside,) if scheme is None else ()
        far = (beside, *(folder.parent for folder in self.folders)) if scheme and scheme[1].lower() == "file" else ()
        places = (below(folder, rest) for folder in (*near, *self.folders, *far))
        return next((place for place in places if place is not None), None)

    def find_texture(self, name: str, mesh: Path) -> Path | None:
        """The existing image that a mesh names, or None: by its path, else by its file name in the usual folders."""
        if "://" in name and (found := self.find(name, mesh.parent)) is not None and found.is_file():
            return found
        rest = unquote(_SCHEME.sub("", name)).replace("\\", "/")
        base = rest.rpartition("/")[2]
        model = mesh.parent.parent
        places = [below(mesh.parent, rest), *(below(folder, base) for folder in _texture_folders(mesh.parent, model))]
        return next((place for place in places if place is not None and place.is_file()), None)


def _texture_folders(meshes: Path, model: Path) -> Iterator[Path]:
    yield from (meshes, model / "materials" / "textures", meshes / "textures", model / "textures")
    yield from (meshes / "materials" / "textures", model.parent / "materials" / "textures")


def _exists(path: Path) -> bool:
    """Whether it does; no file has a name that is too long for the disk, or holds a null."""
    try:
        return path.exists()
    except (OSError, ValueError):
        return False


def _changed_ns(folder: Path) -> int:
    return folder.stat().st_mtime_ns if folder.is_dir() else 0


@lru_cache(maxsize=256)
def _by_small_letters(folder: Path, _changed_ns: int) -> dict[str, Path]:
    """What lies in a folder, by its name in small letters; nothing if it cannot be listed."""
    try:
        return {entry.name.lower(): entry for entry in reversed(list(folder.iterdir()))}
    except OSError:
        return {}


def below(folder: Path, rest: str) -> Path | None:
    """The existing path folder/rest, letter case aside, or None. Steps upwards may not leave the model's folder."""
    here = folder
    for part in rest.split("/"):
        if part in ("", "."):
            continue
        if part == "..":
            here = here.parent
            if len(here.parts) < len(folder.parts) - 1:
                return None
            continue
        step = here / part
        if not _exists(step):
            same = _by_small_letters(here, _changed_ns(here)).get(part.lower())
            if same is None:
                return None
            step = same
        here = step
    return here
