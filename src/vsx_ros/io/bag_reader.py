"""Reads messages of a bag, ROS 1 (format 2.0; none, bz2, lz4) or ROS 2 (sqlite3, mcap), with rosbags, without ROS."""

import re
import sqlite3
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

import apsw
from rosbags.rosbag1 import ReaderError as Ros1ReaderError
from rosbags.rosbag2 import ReaderError as Ros2ReaderError
from rosbags.serde import SerdeError
from rosbags.typesys import Stores, get_typestore
from ruamel.yaml.error import YAMLError

from vsx_ros.errors import InputError, VsxError
from vsx_ros.io.bag_without_index import UnindexedBag
from vsx_ros.io.bounded_rosbags import BoundedRos1, BoundedRos2, ZstdError
from vsx_ros.io.left_out import LeftOut, tried
from vsx_ros.limits import DAMAGE, OverLimitError

METADATA = "metadata.yaml"  # a folder with this file is a ROS 2 bag

_ROS1_MAGIC = b"#ROSBAG V2.0\n"
_ROS2_MAGIC = {b"\x89MCAP0\r\n": ".mcap", b"SQLite format 3\x00": ".db3"}
_MCAP_START = b"\x89MCAP0\r\n\x01"  # and the code of the header's record
_ROS2_SUFFIXES = tuple(_ROS2_MAGIC.values())
# errors of rosbags, the decompressors, YAML and sqlite for damaged files
_DAMAGE = (Ros1ReaderError, Ros2ReaderError, SerdeError, sqlite3.Error, apsw.Error, YAMLError, ZstdError, *DAMAGE)


class Messages:
    """Deserialised messages, one topic at a time. ``damage``: what is wrong with a bag that can still be read."""

    def __init__(self, reader: Any, path: Path, *, ros2: bool, damage: str = "") -> None:
        self._reader, self._path, self._ros2 = reader, path, ros2
        # Embedded definitions are not needed for standard types, which have not changed within either ROS.
        self._types = get_typestore(Stores.ROS2_HUMBLE if ros2 else Stores.ROS1_NOETIC)
        self.damage = damage

    def counts(self) -> dict[str, tuple[str, int]]:
        """Message type and number of messages of each topic."""
        found: dict[str, tuple[str, int]] = {}
        for connection in sorted(self._reader.connections, key=lambda c: str(c.topic)):
            kind, count = found.get(connection.topic, (connection.msgtype, 0))
            kind = kind if kind == connection.msgtype else "several types"
            found[connection.topic] = kind, count + connection.msgcount
        return found

    def of(self, topic: str) -> Iterator[tuple[int, Any] | InputError]:
        """(stamp_ns, message): the header's stamp. If there is none, the time of recording, earlier by the delay of the
        last message that has both. In place of a message that cannot be read, why. Raises InputError, with the remedy,
        where nothing behind the damage can be found."""
        with _damage_explained(self._path, ros2=self._ros2):
            yield from self._of(topic)

    def first(self, topic: str) -> Any:
        """The first message that can be read, None if there is none."""
        return next(LeftOut().of(self.of(topic)), (0, None))[1]

    def _of(self, topic: str) -> Iterator[tuple[int, Any] | InputError]:
        connections = [c for c in self._reader.connections if c.topic == topic]
        delay_ns = 0
        for number, (connection, recorded_ns, raw) in enumerate(self._reader.messages(connections)):
            name = f"message {number} of topic {topic} of bag {self._path}"
            message = tried(self._message, raw, connection.msgtype, recorded_ns, name)
            if isinstance(message, InputError):
                yield message
                continue
            header = getattr(message, "header", None)
            stamp_ns = 0 if header is None else int(header.stamp.sec) * 1_000_000_000 + int(header.stamp.nanosec)
            delay_ns = recorded_ns - stamp_ns if stamp_ns else delay_ns
            yield recorded_ns - delay_ns, message

    def _message(self, raw: bytes | Exception, kind: str, recorded_ns: object, name: str) -> Any:
        try:
            if isinstance(raw, Exception):
                raise raw
            if not isinstance(recorded_ns, int):  # a column of sqlite can hold any type
                raise ValueError(f"its time of recording is {str(recorded_ns)[:40]!r}")
            return (self._types.deserialize_cdr if self._ros2 else self._types.deserialize_ros1)(raw, kind)
        except _DAMAGE as error:
            raise InputError(f"{name} cannot be read ({_detail(error, 'it makes no sense')})") from error


@contextmanager
def messages(path: Path) -> Iterator[Messages]:
    """Open a bag. Any error in its bytes becomes an InputError with the remedy. A ROS 1 bag with an unusable index is
    read without it."""
    ros2 = _is_ros2(path)
    with _damage_explained(path, ros2=ros2), ExitStack() as stack:
        if ros2:
            _refuse_other_profiles(path)
            unwritten = _unwritten(path)
            damage = f"bag {path} lacks its last messages; {unwritten}" if unwritten else ""
            yield Messages(stack.enter_context(BoundedRos2(path)), path, ros2=True, damage=damage)
        else:
            yield _opened_ros1(path, stack)


def is_bag_folder(path: Path) -> bool:
    """Whether a folder is a ROS 2 bag, perhaps without the metadata.yaml that a killed recorder does not write."""
    return (path / METADATA).exists() or (bool(_stored(path)) and not (path / "rgb.txt").exists())


def _stored(path: Path) -> list[Path]:
    """The files of a ROS 2 bag that hold messages."""
    return [file for file in ([path] if path.is_file() else sorted(path.glob("*"))) if file.suffix in _ROS2_SUFFIXES]


def _refuse_other_profiles(path: Path) -> None:
    """Raises InputError for an MCAP file that says it is of something else than ROS 2."""
    for file in _stored(path):
        with file.open("rb") as content:
            start = content.read(100)
        begin = len(_MCAP_START) + 12  # behind the lengths of the record and of the profile
        end = begin + int.from_bytes(start[begin - 4 : begin], "little")
        profile = start[begin:end].decode(errors="replace")
        if start.startswith(_MCAP_START) and begin <= end <= len(start) and profile != "ros2":
            raise InputError(
                f"{file} is an MCAP file but none of ROS 2 (its profile is {profile!r}); give the bag it was made "
                "from, or write its messages with the profile 'ros2', as 'ros2 bag record' does"
            )


def _unwritten(path: Path) -> str:
    """How to save the messages that a recorder of sqlite left beside its database, which is read without them; empty if
    there are none."""
    for file in _stored(path):
        beside = file.with_name(f"{file.name}-wal")
        if beside.exists() and beside.stat().st_size:
            return f"put in the messages of {beside.name} with sqlite3 '{file}' 'PRAGMA wal_checkpoint(TRUNCATE)'"
    return ""


@contextmanager
def _damage_explained(path: Path, *, ros2: bool) -> Iterator[None]:
    try:
        yield
    except VsxError:
        raise
    except PermissionError as error:
        raise InputError(f"bag {path} may not be read; check its permissions") from error
    except OverLimitError as error:
        raise InputError(f"bag {path} is too large when it is unpacked ({error}); cut it into parts") from error
    except _DAMAGE as error:
        remedy = _remedy(path, error, ros2=ros2)
        raise InputError(f"bag {path} is cut short or damaged ({_detail(error)}); copy it again, {remedy}") from error


def _opened_ros1(path: Path, stack: ExitStack) -> Messages:
    try:
        return Messages(stack.enter_context(BoundedRos1(path)), path, ros2=False)
    except (PermissionError, OverLimitError):
        raise
    except _DAMAGE as error:
        bag = UnindexedBag(path)
        count = sum(connection.msgcount for connection in bag.connections)
        if not count:
            raise
        damage = (
            f"bag {path} is cut short or damaged ({_detail(error)}); the {count} messages that are whole are used, "
            "'rosbag reindex FILE' makes it a good one"
        )
        return Messages(bag, path, ros2=False, damage=damage)


def _remedy(path: Path, error: Exception, *, ros2: bool) -> str:
    """How to repair a damaged bag of this kind. A ROS 2 bag has its index at the end and is not read without it."""
    if not ros2:
        return "or repair it with 'rosbag reindex FILE' (Debian: python3-rosbag)"
    file = next(iter(_stored(path)), None)
    if file is None or METADATA in str(error):
        return "or write its metadata.yaml anew with 'ros2 bag reindex FOLDER'"
    if file.suffix == ".mcap":
        saved = file.with_name("saved.mcap")
        return f"or save what is whole with 'mcap recover {file} -o {saved}' (the mcap command) and give {saved}"
    if unwritten := _unwritten(path):
        return f"or {unwritten}"
    return "for of a damaged database not all is read; the .recover of the sqlite3 command may find more of it"


def _detail(error: Exception, otherwise: str = "its index contradicts itself") -> str:
    """The library's message without its wrapping. otherwise: if it is empty."""
    return re.sub(r"\('|',\)|\.$", "", str(error)).partition("\n")[0][:300] or otherwise


def _is_ros2(path: Path) -> bool:
    """Decides by content. Raises InputError for anything but a bag."""
    if path.is_dir():
        if not (path / METADATA).exists():
            names = ", ".join(file.name for file in _stored(path)[:3])
            raise InputError(
                f"folder {path} has {names} but no {METADATA}, as where the recorder was killed; write it with "
                f"'ros2 bag reindex {path}', or give a file of it"
            )
        return True
    try:
        with path.open("rb") as file:
            first_line = file.readline(40)
    except OSError as error:
        raise InputError(f"bag {path} cannot be read ({error.strerror}); check the path and its permissions") from error
    if not first_line:
        raise InputError(f"bag {path} is empty (0 bytes); record it again")
    for magic, suffix in _ROS2_MAGIC.items():
        if first_line.startswith(magic):
            if path.suffix != suffix:
                raise InputError(f"bag {path} has the content of a {suffix} file; rename it to *{suffix}")
            return True
    if first_line == _ROS1_MAGIC:
        return False
    old = re.match(rb"#ROS(?:BAG|RECORD|LOG) V(\d+\.\d+)", first_line)
    if old:
        raise InputError(
            f"bag {path} has the format {old[1].decode()}, this reads 2.0; convert it with 'rosbag fix OLD NEW'"
        )
    raise InputError(
        f"{path} is not a bag (it starts with {first_line[:8]!r}); give a ROS 1 bag of format 2.0, or a ROS 2 bag: "
        "its folder, .db3 or .mcap"
    )
