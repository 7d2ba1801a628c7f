"""The table of docs/reliability.md tells the truth: it is complete, and every test it names exists."""

import re
from pathlib import Path

CHECKOUT = Path(__file__).resolve().parents[2]
IDS = {
    "V": (1, 2, 3, 4, 5, 6, 7, 8),
    "OI-": (1, 2, 5, 7, 12, 14, 15, 17, 19, 22, 23, 24, 25, 26, 27, 28),
    "KB-": (1, 2, 4, 7, 10, 12, 14, 16, 19, 21, 22, 23, 24, 25),
    "KN-": (1, 3, 5, 6, 9, 10, 11, 13, 14, 15, 16, 17, 18, 20),
    "SF-": (1, 2, 5, 8, 10, 12, 13, 14, 15),
}
TABLE = (CHECKOUT / "docs" / "reliability.md").read_text(encoding="utf-8").partition("## Acceptance")[2]


def test_every_acceptance_test_has_its_row():
    told = [one for cells in re.findall(r"^\| ([A-Z][^|]*) \| `", TABLE, re.MULTILINE) for one in cells.split(", ")]
    assert told == [f"{group}{number:02}" if "-" in group else f"V{number}" for group in IDS for number in IDS[group]]


def test_every_acceptance_test_exists():
    named = re.findall(r"`(?:(test_hw_\w+):)?(test_\w+)`", TABLE)
    sources = {file.stem: file.read_text(encoding="utf-8") for file in (CHECKOUT / "tests").rglob("test_*.py")}
    assert len(named) >= 60
    missing = [
        name
        for module, name in named
        if not any(f"def {name}(" in source for stem, source in sources.items() if module in ("", stem))
    ]
    assert missing == []
