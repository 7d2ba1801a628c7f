"""What a world may hold in all: counted before it is made, because a small file can use a thing a million times."""

from vsx_ros.errors import InputError

MOST_TRIANGLES = 2_000_000  # as read, as seen and as solid together: about 120 bytes each; a house has 0.3 million
MOST = {
    "triangles": MOST_TRIANGLES,
    "vertices": 20_000_000,  # moved while meshes are read
    "parts of meshes": 50_000,
    "shapes": 20_000,
    "lamps": 256,
    "elements": 200_000,  # of its files, for each time that they are included
}


class Budget:
    """The counts of one world."""

    def __init__(self) -> None:
        self._left = dict(MOST)

    def take(self, kind: str, count: int, at: str) -> None:
        """Use ``count`` of a kind in ``MOST``. Raises InputError if more than that is used in all."""
        self._left[kind] -= count
        if self._left[kind] < 0:
            where = f"{at:.200}" or "its last shape"
            raise InputError(f"the world has more than {MOST[kind]} {kind} at {where}; simplify it or leave some out")
