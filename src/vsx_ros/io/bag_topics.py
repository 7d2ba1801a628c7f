"""Which topics of a bag are those of camera and odometry."""

from collections.abc import Iterable
from pathlib import Path

from vsx_ros.errors import InputError
from vsx_ros.io.bag_reader import Messages
from vsx_ros.io.recording import NO_ODOMETRY

IMAGE, COMPRESSED = "sensor_msgs/msg/Image", "sensor_msgs/msg/CompressedImage"
ODOMETRY, POSE = "nav_msgs/msg/Odometry", "geometry_msgs/msg/PoseStamped"
_POSES = (POSE, "geometry_msgs/msg/PoseWithCovarianceStamped")
_LONGEST_LISTING = 1000  # characters of topics in a message


def _listing(counts: dict[str, tuple[str, int]]) -> str:
    if not any(count for _, count in counts.values()):
        return "it holds no messages at all"
    return "it has " + _words(f"{topic} ({kind.replace('/msg/', '/')})" for topic, (kind, _) in counts.items())


def _words(names: Iterable[str]) -> str:
    """The names on one line, even if a damaged bag has unprintable ones."""
    return "".join(c if c.isprintable() else "?" for c in ", ".join(names))[:_LONGEST_LISTING]


def _named_depth(name: str) -> bool:
    return any(word in name.lower() for word in ("depth", "disparity"))


def _is_depth(bag: Messages, topic: str) -> bool:
    """Whether an image topic with such a name holds distances, by its first message: depth cameras have colour, too."""
    first = bag.first(topic) if _named_depth(topic) else None
    told = str(getattr(first, "encoding", getattr(first, "format", "")))
    return "compressedDepth" in told or told.partition(";")[0].strip() in ("16UC1", "mono16", "32FC1")


def chosen_images(bag: Messages, path: Path, counts: dict[str, tuple[str, int]], wanted: str | None) -> str:
    """The topic of the camera's images. Raises InputError when it has none, or several and none is wanted."""
    images = [t for t, (kind, count) in counts.items() if kind in (IMAGE, COMPRESSED) and count]
    if wanted is not None:
        return _wanted(path, counts, images, wanted, "image")
    cameras = [t for t in images if not _is_depth(bag, t)]
    usable = [
        t for t in cameras if not _named_depth("/".join(t.removesuffix("/compressed").split("/")[-2:]))
    ] or cameras
    raw_preferred = [t for t in usable if not (t.endswith("/compressed") and t.removesuffix("/compressed") in usable)]
    if not raw_preferred:
        depth = "; a camera's among those of depth can be chosen with --image-topic" if images else ""
        raise InputError(f"bag {path} has no image topic; {_listing(counts)}{depth}")
    if len(raw_preferred) > 1:
        raise InputError(f"bag {path} has several image topics; choose one with --image-topic: {_words(raw_preferred)}")
    return raw_preferred[0]


def chosen_odometry(path: Path, counts: dict[str, tuple[str, int]], wanted: str | None) -> str | None:
    """The topic of the odometry, None if there is none or none is wanted. Raises InputError when it has several and
    none is wanted, or not the wanted one."""
    found = [t for t, (kind, count) in counts.items() if kind == ODOMETRY and count]
    if wanted == NO_ODOMETRY:
        return None
    if wanted is not None:
        poses = [t for t, (kind, count) in counts.items() if kind in _POSES and count]
        return _wanted(path, counts, [*found, *poses], wanted, "odometry")
    candidates = [t for t in found if "ground_truth" not in t]
    if len(candidates) > 1:
        raise InputError(
            f"bag {path} has several odometry topics; choose one with --odometry-topic, or none: {_words(candidates)}"
        )
    return candidates[0] if candidates else None


def _wanted(path: Path, counts: dict[str, tuple[str, int]], found: list[str], wanted: str, kind: str) -> str:
    names = (wanted, "/" + wanted.lstrip("/"))
    for name in names:
        if name in found:
            return name
    told = [f" (that is {counts[name][1]} messages of {counts[name][0]})" for name in names if name in counts]
    raise InputError(f"bag {path} has no {kind} topic {wanted}{''.join(told[:1])}; {_listing(counts)}")
