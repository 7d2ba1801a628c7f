"""A tuple of more than four fields is built by keyword: nobody reads seven numbers in a row right."""

import ast
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
_MOST = 4  # fields, or arguments, that may be told apart by their place


def _modules() -> dict[str, ast.Module]:
    """By dotted name."""
    found = {}
    for top in (ROOT / "src", ROOT / "hw"):
        for path in sorted(top.rglob("*.py")):
            name = ".".join(path.relative_to(top).with_suffix("").parts).removesuffix(".__init__")
            found[name] = ast.parse(path.read_text())
    return found


def _is_record(node: ast.ClassDef) -> bool:
    marks = [ast.unparse(mark) for mark in (*node.bases, *node.decorator_list)]
    return any(mark.split("(")[0].split(".")[-1] in ("NamedTuple", "Struct", "dataclass") for mark in marks)


def _long_records(modules: dict[str, ast.Module]) -> set[str]:
    """Dotted names of the classes that have more than four fields."""
    return {
        f"{module}.{node.name}"
        for module, tree in modules.items()
        for node in ast.walk(tree)
        if isinstance(node, ast.ClassDef) and _is_record(node)
        if sum(isinstance(line, ast.AnnAssign) for line in node.body) > _MOST
    }


def _names(module: str, tree: ast.Module) -> dict[str, str]:
    """What the names of a module mean, dotted."""
    names = {node.name: f"{module}.{node.name}" for node in ast.walk(tree) if isinstance(node, ast.ClassDef)}
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom):
            names.update({alias.asname or alias.name: f"{node.module}.{alias.name}" for alias in node.names})
        elif isinstance(node, ast.Import):
            names.update({alias.asname or alias.name: alias.name for alias in node.names})
    return names


def _by_place(modules: dict[str, ast.Module]) -> Iterator[tuple[str, str, int]]:
    """Module, class and line where one is built from more than four arguments, or from a star, by place."""
    long = _long_records(modules)
    for module, tree in modules.items():
        names = _names(module, tree)
        for node in ast.walk(tree):
            if not isinstance(node, ast.Call):
                continue
            head, _, rest = ast.unparse(node.func).partition(".")
            built = f"{names.get(head, head)}.{rest}".rstrip(".")
            by_place = len(node.args) + sum(isinstance(argument, ast.Starred) for argument in node.args) * _MOST
            if built in long and by_place > _MOST:
                yield module, built.split(".")[-1], node.lineno


_TABLES = {
    ("vsx_hw.kinect.protocol", "StreamMode"): "a row for each mode, below one another",
    ("vsx_hw.kobuki.feedback", "Core"): "unpacked from the wire, in the order of the document",
    ("vsx_hw.plausibility", "_Sums"): "field by field from two of its kind",
    ("vsx_ros.kernels.vision.patches", "Slopes"): "sums of a compiled loop, in the order of their matrix",
    ("vsx_ros.kernels.warmup", "Edges"): "made-up arrays, in the order of their types",
    ("vsx_ros.kernels.warmup", "Factors"): "made-up arrays, in the order of their types",
    ("vsx_ros.kernels.warmup", "Lattice"): "made-up numbers",
    ("vsx_ros.kernels.warmup", "BundleObservations"): "made-up arrays, in the order of their types",
    ("vsx_ros.kernels.warmup", "ObservedPoints"): "made-up arrays, in the order of their types",
    ("vsx_ros.kernels.warmup", "Scene"): "made-up arrays, in the order of their types",
    ("vsx_ros.kernels.warmup", "View"): "made-up arrays, in the order of their types",
    ("vsx_ros.kernels.warmup", "Views"): "made-up arrays, in the order of their types",
    ("vsx_ros.ros.planning_thread", "Adjustable"): "a row for each parameter, below one another",
}


def test_tuples_of_more_than_four_fields_are_built_by_keyword() -> None:
    found = [f"{module}:{line} {name}" for module, name, line in _by_place(_modules()) if (module, name) not in _TABLES]
    assert not found, f"give these their fields by keyword: {', '.join(found)}"


def test_every_way_to_build_by_place_is_found() -> None:
    record = "from typing import NamedTuple\nclass Five(NamedTuple):\n" + "".join(f"    f{k}: int\n" for k in range(5))
    used = "from room import Five\nimport room\n{}\n"
    for line, count in (
        ("Five(1, 2, 3, 4, 5)", 1),
        ("Five(*row)", 1),
        ("Five(0, *row, f4=1)", 1),
        ("room.Five(1, 2, 3, 4, 5)", 1),
        ("Five(1, 2, 3, 4, f4=5)", 0),
        ("other.Five(1, 2, 3, 4, 5)", 0),
    ):
        modules = {"room": ast.parse(record), "user": ast.parse(used.format(line))}
        assert len(list(_by_place(modules))) == count, line
