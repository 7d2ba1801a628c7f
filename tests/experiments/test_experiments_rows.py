"""Rows of results: none without its tree, none of another tree or configuration taken for one of now."""

import json
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from vsx_ros import __version__
from vsx_ros.config import Config, overridden
from vsx_ros.errors import InputError
from vsx_ros.experiments import rows
from vsx_ros.experiments.rows import Row, Store, read_rows
from vsx_ros.registry import PLUGINS

ASKED: dict[str, Any] = {"world": "lab", "seed": 7, "settings": ("a=1",)}
OTHER = {**ASKED, "seed": 8}
GAZEBO_ROOM = Path(__file__).parents[1] / "data/gazebo_room"
KEYS = {"commit", "dirty", "code", "config", "versions", "machine", "when", "asked", "files", "result"}


@pytest.fixture
def file(tmp_path: Path) -> Path:
    return tmp_path / "results" / "r.jsonl"


@pytest.fixture
def room(tmp_path: Path) -> Path:
    """A folder with the code that is judged."""
    folder = tmp_path / "room"
    folder.mkdir()
    (folder / "slam.py").write_text("x = 1\n")
    return folder


def test_a_row_says_what_it_rests_on(file: Path) -> None:
    Store(file).add(ASKED, {"ate_m": 0.01})
    (line,) = file.read_text().splitlines()
    row = json.loads(line)
    assert set(row) == KEYS
    commit = subprocess.run(["git", "rev-parse", "HEAD"], cwd=rows.PACKAGE, capture_output=True, text=True, check=False)
    assert (row["commit"] or "") == commit.stdout.strip()[:12]
    assert row["versions"]["vsx_ros"] == __version__
    assert {"python", "numpy", "cv2", "numba"} <= set(row["versions"])
    assert set(row["machine"]) == {"processor", "cores", "load"}
    assert row["when"].endswith("+00:00")
    assert (row["asked"], row["result"]) == ({**ASKED, "settings": ["a=1"]}, {"ate_m": 0.01})
    assert ": " not in line.replace(row["machine"]["processor"], "")


def test_outside_of_a_checkout_the_code_is_named_without_a_commit(
    file: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(rows, "_git", lambda *words: "")
    Store(file).add(ASKED, 1)
    (row,) = read_rows(file, print)
    assert (row.commit, row.dirty) == (None, None)
    assert row.code
    assert ASKED in Store(file)


def test_what_is_known_stays_known(file: Path, room: Path, capsys: pytest.CaptureFixture[str]) -> None:
    Store(file, rooms=[room]).add(ASKED, 1)
    store = Store(file, rooms=[room])
    assert (ASKED in store, OTHER in store, store[ASKED]) == (True, False, 1)
    assert capsys.readouterr().err == ""


def test_a_row_of_other_code_is_not_taken_and_told(file: Path, room: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The version did not change, as it does not from commit to commit."""
    Store(file, rooms=[room]).add(ASKED, 1)
    before = file.read_bytes()
    (room / "slam.py").write_text("x = 2\n")
    store = Store(file, rooms=[room])
    assert ASKED not in store
    (told,) = capsys.readouterr().err.splitlines()
    assert "rows of other code than the present one do not count (1 of " in told
    store.add(ASKED, 2)
    assert file.read_bytes().startswith(before)
    assert Store(file, rooms=[room])[ASKED] == 2


def test_another_file_of_code_or_another_name_is_other_code(room: Path) -> None:
    hashes = [rows.code_hash([room])]
    (room / "slam.py").rename(room / "map.py")
    hashes.append(rows.code_hash([room]))
    (room / "more.py").write_text("")
    hashes.append(rows.code_hash([room]))
    assert len(set(hashes)) == 3
    (room / "notes.md").write_text("words")
    assert rows.code_hash([room]) == hashes[-1]


def test_words_about_code_are_no_other_code(room: Path) -> None:
    source = 'def f() -> str:\n    """{doc}"""\n    return """# {text}"""{comment}\n'
    of = {}
    for doc, text, comment in (("a", "t", ""), ("b\n\n    c\n    ", "t", "  # why"), ("a", "u", "")):
        (room / "slam.py").write_text(source.format(doc=doc, text=text, comment=comment))
        of[doc, text] = rows.code_hash([room])
    assert of["a", "t"] == of["b\n\n    c\n    ", "t"] != of["a", "u"]


def test_a_row_of_another_configuration_is_not_taken_and_told(
    file: Path, room: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    Store(file, rooms=[room]).add(ASKED, 1)
    store = Store(file, overridden(Config(), {"planner.phi_rad_m": 0.7}), [room])
    assert ASKED not in store
    assert "1 rows of another configuration than the present one do not count" in capsys.readouterr().err


def test_code_that_changes_while_it_is_measured_is_told(file: Path, room: Path) -> None:
    store = Store(file, rooms=[room])
    (room / "slam.py").write_text("x = 2\n")
    with pytest.raises(InputError, match="the code was changed while it was measured"):
        store.add(ASKED, 1)
    assert not file.exists()


def test_a_row_is_of_the_files_of_its_world(file: Path, room: Path, tmp_path: Path) -> None:
    world = tmp_path / "mine.yaml"
    asked = {**ASKED, "world": str(world)}
    stores = []
    for content, result in ((None, {"failed": "no file"}), ("one", 1), ("two", 2)):
        if content is not None:
            world.write_text(content)
        store = Store(file, rooms=[room])
        assert asked not in store
        store.add(asked, result)
        assert Store(file, rooms=[room])[asked] == result
        stores.append(store)
    world.write_text("one")
    assert Store(file, rooms=[room])[asked] == 1
    with pytest.raises(InputError, match="the world was changed while it was measured"):
        stores[-1].add(asked, 3)


def test_a_picture_of_a_map_is_a_file_of_its_world(tmp_path: Path) -> None:
    (tmp_path / "m.pgm").write_bytes(b"first")
    text = "image: m.pgm\nresolution: 0.05\norigin: [0, 0, 0]\nnegate: 0\noccupied_thresh: 0.65\nfree_thresh: 0.2\n"
    (tmp_path / "m.yaml").write_text(text)
    first = rows.files_hash({"world": str(tmp_path / "m.yaml")})
    (tmp_path / "m.pgm").write_bytes(b"second")
    assert rows.files_hash({"world": str(tmp_path / "m.yaml")}) != first
    assert rows.files_hash({"world": "lab"}) == rows.files_hash({"seed": 1}) == ""


def test_models_are_files_of_their_world(tmp_path: Path) -> None:
    shutil.copytree(GAZEBO_ROOM, tmp_path / "room")
    world, models = tmp_path / "room/worlds/room.world", sorted((tmp_path / "room/models").iterdir())
    (tmp_path / "named.yaml").write_text("gazebo: room/worlds/room.world\n")
    mesh = world.with_name("tub.obj")
    mesh.write_text("mtllib tub.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    part = "<geometry><mesh><uri>tub.obj</uri></mesh></geometry>"
    model = f'<model name="tub"><link name="l"><visual name="v">{part}</visual></link></model></world>'
    world.write_text(world.read_text().replace("</world>", model))
    asked = [{"world": str(world)}, {"world": str(tmp_path / "named.yaml")}]
    known = [rows.files_hash(one) for one in asked]
    assert "unreadable" not in known
    assert [rows.files_hash(one) for one in asked] == known
    texture = next(file for folder in models for file in folder.rglob("*.png"))
    for changed in (models[0] / "model.sdf", next(models[0].rglob("*.DAE")), texture, mesh, mesh.with_suffix(".mtl")):
        changed.write_bytes((changed.read_bytes() if changed.exists() else b"") + b" ")
        before, known = known, [rows.files_hash(one) for one in asked]
        assert not {*before} & {*known}, changed


@pytest.mark.parametrize("package", [False, True])
def test_a_row_is_of_the_plug_ins(
    file: Path, room: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, package: bool
) -> None:
    source = tmp_path / "mine_for_rows" / "__init__.py" if package else tmp_path / "mine_for_rows.py"
    source.parent.mkdir(exist_ok=True)
    source.write_text("x = 1\n")
    Store(file, rooms=[room]).add(ASKED, 0)
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.setenv(PLUGINS, "mine_for_rows")
    monkeypatch.delitem(sys.modules, "mine_for_rows", raising=False)
    assert ASKED not in Store(file, rooms=[room])
    Store(file, rooms=[room]).add(ASKED, 1)
    assert Store(file, rooms=[room])[ASKED] == 1
    source.write_text("x = 2\n")
    assert ASKED not in Store(file, rooms=[room])
    monkeypatch.delenv(PLUGINS)
    assert Store(file, rooms=[room])[ASKED] == 0


def test_rows_without_a_hash_of_files_are_of_worlds_without_files(file: Path, room: Path) -> None:
    Store(file, rooms=[room]).add(ASKED, 1)
    row = json.loads(file.read_text())
    del row["files"]
    file.write_text(json.dumps(row) + "\n")
    assert Store(file, rooms=[room])[ASKED] == 1


@pytest.mark.parametrize(
    "damage", [b"nonsense}", b"[]", b"{}", b'{"task": 1}', b"\xff\xfe", b"", b'{"commit": 1, "asked": {}}']
)
def test_a_damaged_row_is_told_and_not_mixed_in(
    file: Path, room: Path, damage: bytes, capsys: pytest.CaptureFixture[str]
) -> None:
    Store(file, rooms=[room]).add(ASKED, 1)
    with file.open("ab") as out:
        out.write(damage + b"\n")
    Store(file, rooms=[room]).add(OTHER, 2)
    (told,) = capsys.readouterr().err.splitlines()
    assert told.startswith(f"{file}, line 2, is no row of results (")
    assert [row.result for row in read_rows(file, lambda line: None)] == [1, 2]


def test_a_row_of_a_killed_run_is_told_and_gone_on_after(
    file: Path, room: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    Store(file, rooms=[room]).add(ASKED, 1)
    Store(file, rooms=[room]).add(OTHER, {"x": 2})
    whole = file.read_bytes()
    first = whole.splitlines(keepends=True)[0]
    for cut in range(2, len(whole) - len(first) + 1):
        file.write_bytes(whole[:-cut])
        store = Store(file, rooms=[room])
        assert (ASKED in store, OTHER in store) == (True, False)
        store.add(OTHER, {"x": 2})
        assert Store(file, rooms=[room])[OTHER] == {"x": 2}
        assert file.read_bytes().startswith(first)
    assert "line 2, is no row of results" in capsys.readouterr().err


def test_unknown_keys_are_no_row(file: Path, room: Path) -> None:
    Store(file, rooms=[room]).add(ASKED, 1)
    row = json.loads(file.read_text())
    assert set(row) == set(Row.__struct_fields__)
    file.write_text(json.dumps({**row, "version": "0.1.0"}) + "\n")
    told: list[str] = []
    assert read_rows(file, told.append) == []
    assert "unknown field `version`" in told[0]


def test_a_file_that_cannot_be_read_is_told(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="cannot be used"):
        Store(tmp_path)
