"""Frame names beyond the node: tf is one tree for all robots of a master, so a robot in a namespace has a prefix.

Within a node frames are called by the names of topics.py. Messages carry them with the prefix: the parameter
``tf_prefix`` of the namespace or one above it, else the namespace itself.
"""

import rospy

_prefix = ""


def adopt_prefix() -> None:
    """Learn the prefix from the namespace and the parameters; once, when the node has joined the master."""
    global _prefix  # as rospy's own node: one a process
    key = rospy.search_param("tf_prefix")
    said = rospy.get_param(key) if key else rospy.get_namespace()
    _prefix = str(said).strip("/")


def own(name: str) -> str:
    """The frame of this robot as others know it: map -> robot1/map. No name stays none."""
    return f"{_prefix}/{name}" if _prefix and name else name


def bare(frame_id: str) -> str:
    """The name of a frame of this robot without its prefix; any other frame as it is. A leading slash is old custom."""
    return frame_id.lstrip("/").removeprefix(f"{_prefix}/")
