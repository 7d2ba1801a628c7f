"""How far a calibration can be trusted, in words."""

from collections.abc import Sequence
from enum import IntEnum
from typing import NamedTuple


class Grade(IntEnum):
    """GOOD: use it. USABLE: better than none, repeat it when there is time. BAD: worse than none."""

    GOOD, USABLE, BAD = range(3)

    @classmethod
    def of(cls, good: bool, usable: bool = True) -> "Grade":
        """Good, else usable, else bad."""
        return cls.GOOD if good else cls.USABLE if usable else cls.BAD


class Verdict(NamedTuple):
    """findings: the grade of each check, and what to do if it is not good."""

    findings: Sequence[tuple[Grade, str]]

    @property
    def grade(self) -> Grade:
        """The worst grade."""
        return max((grade for grade, _ in self.findings), default=Grade.GOOD)

    def __str__(self) -> str:
        """One sentence, worst first."""
        worst_first = sorted(self.findings, key=lambda finding: -finding[0])
        said = [words for grade, words in worst_first if grade is not Grade.GOOD]
        name = self.grade.name.lower()
        return f"{name}: {'; '.join(said)}" if said else name
