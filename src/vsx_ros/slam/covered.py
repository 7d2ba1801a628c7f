"""Whether something that is not in the map stands before the camera: it hides map points that should be seen.

One camera cannot measure how far away a thing is that moves. But a person who is near hides most of what the map has in
the middle of the image, and a person who is far hides little of it."""

from vsx_ros.arrays import BoolArray, Points3

HALF_SLOPE = 0.19  # of the window to each side: as wide as a person 1.2 m away
LEAST_POINTS = 15  # in the window; fewer say nothing
COVERED = (1.5, 0.45), (0.8, 0.4)
"""Of the points farther than so many metres, the share that is not found. The first range notices a person 1.5 m away:
two thirds are hidden then, at 1.75 m one third, and without anybody at most 0.30. Where nothing is so far, the second
notices one 1.2 m away; without anybody it misses at most 0.23."""
MORE_THAN_BESIDE = 0.2  # more of the points is missed ahead than beside; dim or blurred images miss as many everywhere
LEAST_IMAGES = 3  # in a row


def covered_ahead(points_cam: Points3, found: BoolArray, concealed: BoolArray) -> str:
    """How much of the map ahead is hidden, in words; empty if little is, or too few points could tell. points_cam
    (S, 3): the searched points in the camera's frame [m]; concealed (S,): those behind points that were found."""
    x, depth = points_cam[:, 0], points_cam[:, 2]
    ahead = (abs(x) < HALF_SLOPE * depth) & ~concealed
    for beyond_m, share in COVERED:
        far = ahead & (depth > beyond_m)
        searched, missed = int(far.sum()), int((far & ~found).sum())
        beside = ~ahead & ~concealed & (depth > beyond_m)
        usual = float((beside & ~found).sum()) / max(int(beside.sum()), LEAST_POINTS)
        if searched >= LEAST_POINTS and missed > max(share, usual + MORE_THAN_BESIDE) * searched:
            return f"something hides {missed} of {searched} points ahead"
    return ""


class CoverWatch:
    """Believes what several images in a row say."""

    def __init__(self) -> None:
        self._images = 0

    def believed(self, ahead: str) -> str:
        """What hides the map ahead, after this image's verdict."""
        self._images = self._images + 1 if ahead else 0
        return ahead if self._images >= LEAST_IMAGES else ""
