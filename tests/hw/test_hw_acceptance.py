"""The table of docs/reliability.md tells the truth: every test it names exists."""

import re
from pathlib import Path

CHECKOUT = Path(__file__).resolve().parents[2]


def test_every_acceptance_test_exists():
    text = (CHECKOUT / "docs" / "reliability.md").read_text(encoding="utf-8").partition("## Acceptance")[2]
    named = re.findall(r"`(?:(test_hw_\w+):)?(test_\w+)`", text)
    sources = {file.stem: file.read_text(encoding="utf-8") for file in (CHECKOUT / "tests").rglob("test_*.py")}
    assert len(named) >= 60
    missing = [
        name
        for module, name in named
        if not any(f"def {name}(" in source for stem, source in sources.items() if module in ("", stem))
    ]
    assert missing == []
