"""How far a calibration can be trusted, in words."""

from enum import Enum
from typing import NamedTuple


class Grade(Enum):
    """good: use it. usable: better than none, do it again when there is time. bad: worse than none."""

    GOOD = "good"
    USABLE = "usable"
    BAD = "bad"


class Complaint(NamedTuple):
    """Something that is not as it should be, and what to do about it."""

    grade: Grade
    words: str


class Verdict(NamedTuple):
    """The worst of what was found; good when nothing was."""

    complaints: tuple[Complaint, ...]

    @property
    def grade(self) -> Grade:
        """The worst complaint's."""
        grades = {complaint.grade for complaint in self.complaints}
        return next((grade for grade in (Grade.BAD, Grade.USABLE) if grade in grades), Grade.GOOD)

    def __str__(self) -> str:
        """One sentence, worst first."""
        order = [Grade.BAD, Grade.USABLE, Grade.GOOD]
        said = [c.words for c in sorted(self.complaints, key=lambda complaint: order.index(complaint.grade))]
        return f"{self.grade.value}: {'; '.join(said)}" if said else self.grade.value
