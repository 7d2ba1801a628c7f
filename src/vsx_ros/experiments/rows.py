"""Rows of results, each with its provenance: the code, configuration and machine that produced it.

A file of rows has one line of JSON per question, with the keys of ``Row``. A row is valid only for the same code,
configuration and files of its world."""

import hashlib
import json
import os
import platform
import subprocess
import sys
import token
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from datetime import datetime, timezone
from functools import cache
from importlib import import_module
from io import BytesIO
from pathlib import Path
from tokenize import tokenize
from typing import Any

import msgspec

import vsx_ros
from vsx_ros.config import Config, to_dict
from vsx_ros.errors import InputError, VsxError, explained, reason_of
from vsx_ros.limits import LOG_BYTES, file_bytes, json_tree
from vsx_ros.registry import load_plugins
from vsx_ros.runs.world import world_files

PACKAGE = Path(vsx_ros.__file__).parent
_PACKAGES = ("vsx_ros", "numpy", "cv2", "numba")
_DIGITS = 12  # of hashes; enough to distinguish commits and configurations
_GIT_S = 30.0  # a hung disk must not hang a run


class Provenance(msgspec.Struct, frozen=True):
    """The origin of all rows of one process. commit: git's, None outside of a checkout. dirty: whether code of the
    checkout was not committed; None if the commit is only the one that added the row to the repository. code: hash of
    the executed sources. config: hash of the configuration. Both are empty if unknown."""

    commit: str | None
    dirty: bool | None
    code: str
    config: str
    versions: dict[str, str]


class Row(Provenance, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """machine: processor, its cores, and the load (1 min mean). when: UTC, to the second. files: hash of the files of
    the world in ``asked``; empty if there are none."""

    files: str = ""
    machine: dict[str, Any]
    when: str
    asked: dict[str, Any]
    result: Any


def made_by() -> str:
    """Version and commit of this process, in words."""
    commit, dirty = _commit((PACKAGE,))
    tree = f", commit {commit}{' with changes' * bool(dirty)}" if commit else ""
    return f"vsx_ros {vsx_ros.__version__}{tree}"


def code_hash(rooms: Iterable[Path]) -> str:
    """Hash of all sources in the rooms, by name and code, without comments and docstrings."""
    digest = hashlib.sha256()
    for room in sorted(rooms):
        for path in sorted(room.rglob("*.py")) if room.is_dir() else [room]:
            digest.update(str(path.relative_to(room.parent)).encode() + b"\0" + _code(path.read_bytes()) + b"\0")
    return digest.hexdigest()[:_DIGITS]


@cache
def _code(source: bytes) -> bytes:
    """The source without comments, strings that are whole statements (docstrings), and empty lines."""
    lines = source.decode().split("\n")
    tokens = [t for t in tokenize(BytesIO(source).readline) if t.type not in (token.NL, token.ENCODING)]
    begins = {token.NEWLINE, token.INDENT, token.DEDENT}
    for before, this, after in reversed(list(zip([None, *tokens], tokens, [*tokens[1:], None]))):
        alone = before is None or before.type in begins | {token.COMMENT}
        said = this.type == token.STRING and alone and after is not None and after.type == token.NEWLINE
        if said or this.type == token.COMMENT:
            (first, begin), (last, end) = this.start, this.end
            lines[first - 1 : last] = [lines[first - 1][:begin] + lines[last - 1][end:]]
    return "\n".join(filter(None, map(str.rstrip, lines))).encode()


def config_hash(config: Config) -> str:
    """Hash of every parameter, including defaults."""
    return hashlib.sha256(json.dumps(to_dict(config), sort_keys=True).encode()).hexdigest()[:_DIGITS]


def files_hash(asked: Mapping[str, Any]) -> str:
    """Hash of the files of the question's world; empty without a world or for a generator's."""
    try:
        files = world_files(str(asked["world"])) if "world" in asked else []
        contents = [path.read_bytes() for path in files]
    except (VsxError, OSError):
        return "unreadable"
    return hashlib.sha256(b"\0".join(contents)).hexdigest()[:_DIGITS] if files else ""


def tell(line: str) -> None:
    """Print a line for the user on stderr, apart from the results."""
    print(line, file=sys.stderr, flush=True)


def read_rows(path: Path, say: Callable[[str], None]) -> list[Row]:
    """All valid rows; each invalid line is reported with ``say`` and left out. Raises InputError if the file cannot be
    read."""
    with explained(InputError, f"{path} cannot be used", "choose another --out"):
        content = file_bytes(path, LOG_BYTES) if path.exists() else b""
    rows = []
    for number, line in enumerate(content.splitlines(), start=1):
        try:
            rows.append(msgspec.convert(json_tree(line), Row))
        except (msgspec.ValidationError, ValueError) as error:
            say(f"{path}, line {number}, is no row of results ({reason_of(error)}); it is left out")
    return rows


class Store:
    """The rows of a file that are valid for the current code, plug-ins, configuration and files of worlds; new ones are
    appended at once."""

    def __init__(self, path: Path, config: Config | None = None, rooms: Sequence[Path] = (PACKAGE,)) -> None:
        """config: of the runs. rooms: files and folders with the code they depend on. Other rows stay in the file, and
        their number is reported. Raises InputError when the file cannot be used."""
        with explained(InputError, f"{path} cannot be used", "choose another --out", OSError):
            path.parent.mkdir(parents=True, exist_ok=True)
        self._path, self._rooms = path, [*rooms, *_plugins()]
        code, of_config = hashes = code_hash(self._rooms), config_hash(config or Config())
        commit, dirty = _commit(rooms)
        self._rests_on = Provenance(commit, dirty, code=code, config=of_config, versions=_versions())
        rows = read_rows(path, tell)
        self._known = {(_key(row.asked), row.files): row.result for row in rows if (row.code, row.config) == hashes}
        self._files: dict[str, str] = {}
        self._tell_others(rows)

    def __contains__(self, asked: Mapping[str, Any]) -> bool:
        return self._question(asked) in self._known

    def __getitem__(self, asked: Mapping[str, Any]) -> Any:
        return self._known[self._question(asked)]

    def _question(self, asked: Mapping[str, Any]) -> tuple[str, str]:
        """With the hash of the files of its world, as they were when it was first asked."""
        key = _key(asked)
        if key not in self._files:
            self._files[key] = files_hash(asked)
        return key, self._files[key]

    def add(self, asked: Mapping[str, Any], result: Any) -> None:
        """Append a row, on its own line even if the last line is incomplete. Raises InputError when the file cannot be
        written, or the code or the world's files have changed since the start."""
        question = key, files = self._question(asked)
        same_code = code_hash(self._rooms) == self._rests_on.code
        if not same_code or files_hash(asked) != files:
            what = "world" if same_code else "code"
            raise InputError(
                f"the {what} was changed while it was measured for {self._path}; begin again with it as it is"
            )
        machine = {"processor": _processor(), "cores": os.cpu_count(), "load": round(os.getloadavg()[0], 1)}
        when = datetime.now(timezone.utc).isoformat(timespec="seconds")
        row = {**msgspec.structs.asdict(self._rests_on), "files": files, "machine": machine, "when": when}
        line = json.dumps({**row, "asked": dict(asked), "result": result}, separators=(",", ":"))
        remedy = "free the disk, then the same command goes on"
        with explained(InputError, f"{self._path} cannot be written", remedy, OSError), self._path.open("a+b") as file:
            file.seek(max(0, file.seek(0, os.SEEK_END) - 1))
            torn = file.read(1) not in (b"\n", b"")
            file.write(b"\n" * torn + line.encode() + b"\n")
        self._known[question] = json.loads(line)["result"]

    def _tell_others(self, rows: Sequence[Row]) -> None:
        """Report which rows are not valid now."""
        code, config = self._rests_on.code, self._rests_on.config
        older = Counter(row.commit or "no commit" for row in rows if row.code != code)
        if older:
            commits = ", ".join(f"{count} of {commit}" for commit, count in older.items())
            tell(f"{self._path}: rows of other code than the present one do not count ({commits})")
        changed = sum(row.code == code and row.config != config for row in rows)
        if changed:
            tell(f"{self._path}: {changed} rows of another configuration than the present one do not count")


def _plugins() -> list[Path]:
    """The source of each plug-in: its file, or the folder of a package."""
    files = [Path(module.__file__) for module in load_plugins() if module.__file__]
    return [file.parent if file.name == "__init__.py" else file for file in files]


def _key(asked: Mapping[str, Any]) -> str:
    return json.dumps(asked, sort_keys=True)


def _git(*words: str) -> str:
    """Git's output for the checkout of this package; empty if there is none."""
    try:
        done = subprocess.run(["git", *words], cwd=PACKAGE, capture_output=True, text=True, check=False, timeout=_GIT_S)
    except (OSError, subprocess.TimeoutExpired):
        return ""
    return done.stdout.strip() if done.returncode == 0 else ""


def _commit(rooms: Iterable[Path]) -> tuple[str | None, bool | None]:
    """The commit, and whether sources in the rooms differ from it; (None, None) outside of a checkout."""
    if not _git("ls-files", str(PACKAGE / "errors.py")):
        return None, None
    changed = _git("status", "--porcelain", "--", *map(str, rooms))
    return _git("rev-parse", f"--short={_DIGITS}", "HEAD"), bool(changed)


def _versions() -> dict[str, str]:
    """Versions of Python and the packages that results depend on."""
    return {"python": platform.python_version()} | {name: import_module(name).__version__ for name in _PACKAGES}


def _processor() -> str:
    lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines() if Path("/proc/cpuinfo").exists() else []
    return next((line.partition(":")[2].strip() for line in lines if line.startswith("model name")), platform.machine())
