"""Files and functions are short enough to be read at once."""

import ast
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
FILES = sorted(path for room in ("src", "hw") for path in (ROOT / room).rglob("*.py"))
_FILE, _NODE, _FUNCTION = 250, 120, 40  # lines
_LONGER = 0.005  # share of the functions that may be longer: kernels, whose loops numba compiles as one


def _longer(most: int, folder: Path) -> dict[str, int]:
    lines = {path: len(path.read_text().splitlines()) for path in FILES if path.is_relative_to(folder)}
    assert lines
    return {str(path.relative_to(ROOT)): count for path, count in lines.items() if count > most}


def test_no_file_is_longer_than_250_lines_and_no_node_than_120() -> None:
    assert _longer(_FILE, ROOT) == {}
    assert _longer(_NODE, ROOT / "src/vsx_ros/ros/nodes") == {}


def test_hardly_a_function_is_longer_than_40_lines() -> None:
    """Its lines: from ``def`` to the last, with its signature and docstring, without decorators."""
    lengths = [
        (f"{path.relative_to(ROOT)}: {node.name}", (node.end_lineno or 0) - node.lineno + 1)
        for path in FILES
        for node in ast.walk(ast.parse(path.read_text()))
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef)
    ]
    longer = sorted(name for name, lines in lengths if lines > _FUNCTION)
    assert len(longer) <= _LONGER * len(lengths), longer
