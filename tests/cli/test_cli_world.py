from pathlib import Path

import cv2
import numpy as np
import pytest
from msgspec.structs import replace

from vsx_ros.cli import explore, main
from vsx_ros.errors import ConfigError, MapFileError
from vsx_ros.io.map_file import load_map
from vsx_ros.occupancy.grid import FREE
from vsx_ros.runs.world import check_world, open_world, save_world
from vsx_ros.sim.generate import generate_world
from vsx_ros.sim.lighting import light_named
from vsx_ros.sim.truth import gap_to_walls
from vsx_ros.sim.world import Start, World
from vsx_ros.sim.world_file import load_world

ROOM = Path(__file__).parents[1] / "data/gazebo_room/worlds/room.world"


def run(*words: str) -> int:
    return main.run(main.parse(["world", *words]))


def test_writes_the_world_its_true_map_and_a_picture(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out, pgm, png = tmp_path / "w.yaml", tmp_path / "m.pgm", tmp_path / "p.png"
    assert run("lab", "--seed", "2", "--out", str(out), "--map", str(pgm), "--picture", str(png)) == 0
    assert load_world(out) == generate_world("lab", 2)
    grid = load_map(tmp_path / "m.yaml")
    assert 80 < (grid.data == FREE).sum() * grid.resolution**2 < 96
    assert cv2.imread(str(png)).shape[0] == 480
    said = capsys.readouterr().out
    assert all(str(path) in said for path in (out, pgm, png))
    assert run(str(tmp_path / "m.yaml"), "--out", str(tmp_path / "again.yaml")) == 0
    assert load_world(tmp_path / "again.yaml").generator.name == "m"


def test_wrong_uses_are_named(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="--out"):
        run("lab")
    with pytest.raises(ConfigError, match="castle"):
        run("castle", "--out", str(tmp_path / "w.yaml"))
    with pytest.raises(ConfigError, match="cannot be written"):
        run("corridor", "--picture", str(tmp_path / "no" / "p.png"))
    (tmp_path / "m.yaml").write_text("image: missing.pgm\nresolution: 0.05\norigin: [0, 0, 0]\n")
    with pytest.raises(MapFileError):
        run(str(tmp_path / "m.yaml"), "--out", str(tmp_path / "w.yaml"))


def test_a_light_by_name_is_in_the_file(tmp_path: Path) -> None:
    out = tmp_path / "w.yaml"
    assert run("lab:night", "--seed", "2", "--out", str(out)) == 0
    world = load_world(out)
    assert isinstance(world, World)
    assert world.lighting == light_named("night", 2)
    assert replace(world, lighting=None) == generate_world("lab", 2)
    with pytest.raises(ConfigError, match="did you mean 'night'"):
        check_world("lab:nigth")


def test_with_makes_a_world_hard_and_names_what_it_does_not_know(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "w.yaml"
    assert run("lab", "--with", "people=2,white-walls", "--with", "latency=100", "--out", str(out)) == 0
    assert load_world(out).hard == {"people": 2.0, "white-walls": 1.0, "latency": 100.0}
    assert run("info", str(out)) == 0
    assert "people=2, white-walls=1, latency=100" in capsys.readouterr().out
    with pytest.raises(ConfigError, match=r"named 'peple' \(did you mean 'people'\?\)"):
        run("lab", "--with", "peple", "--out", str(out))


def test_hard_things_are_for_emulated_worlds_and_checked_first() -> None:
    for words, told in ((["--with", "people"], "give --world"), (["--world", "lab", "--with", "people=-1"], "1 to 20")):
        with pytest.raises(ConfigError, match=told):
            main.run(main.parse(["explore", *words]))


def test_a_floor_plan_alone_is_a_world(tmp_path: Path) -> None:
    assert run("lab", "--seed", "2", "--map", str(tmp_path / "m.pgm")) == 0
    with_origin = open_world(str(tmp_path / "m.pgm"), 1)
    (tmp_path / "m.yaml").unlink()
    alone = open_world(str(tmp_path / "m.pgm"), 1)
    assert alone.bounds[2] - alone.bounds[0] == pytest.approx(with_origin.bounds[2] - with_origin.bounds[0])
    assert alone.generator.name == "m"
    with pytest.raises(ConfigError, match="existing"):
        open_world(str(tmp_path / "none.png"), 1)


def test_what_a_world_is_read_from_is_never_written_over(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    assert run("lab", "--seed", "2", "--map", "p.pgm") == 0
    Path("p.pgm").rename("m.pgm")
    Path("m.yaml").write_text(Path("p.yaml").read_text().replace("p.pgm", "m.pgm"))
    Path("p.yaml").unlink()
    cv2.imwrite("p.png", cv2.imread("m.pgm"))
    before = {path: path.read_bytes() for path in Path().iterdir()}
    for name in ("p.png", "m.yaml"):
        assert run("render", name) == 0
        assert run("import", name) == 0
    assert {path.name for path in Path().iterdir()} - {path.name for path in before} == {
        *("p-view.png", "p-world.yaml", "m-view.png", "m-world.yaml")
    }
    wrong = ["m.yaml", "--out", "m.yaml"], ["m.yaml", "--picture", "m.pgm"], ["m.pgm", "--map", "m.png"]
    for words in (*wrong, ["render", "p.png", "--out", f"../{tmp_path.name}/p.png"]):
        with pytest.raises(ConfigError, match="is read from it"):
            run(*words)
    assert {path: path.read_bytes() for path in before} == before


@pytest.mark.parametrize(
    ("words", "file"),
    [
        (["lab", "--out", "lab.yaml", "--map", "lab.pgm"], "lab.yaml"),
        (["lab", "--out", "lab.yaml", "--map", "sub/../lab"], "lab.yaml"),
        (["lab", "--out", "m.pgm", "--map", "m.yaml"], "m.pgm"),
        (["lab", "--picture", "m.pgm", "--map", "m.pgm"], "m.pgm"),
        (["lab", "--out", "w.png", "--picture", "link/w.png"], "w.png"),
        (["render", "lab", "--picture", "lab-view.png"], "lab-view.png"),
    ],
)
def test_no_output_is_written_over_another(
    words: list[str], file: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("sub").mkdir()
    Path("link").symlink_to(tmp_path)
    with pytest.raises(ConfigError, match=rf"{file} would be written twice.*name another"):
        run(*words)
    assert {path.name for path in Path().iterdir()} == {"sub", "link"}


def test_a_picture_beside_a_world_file_is_a_floor_plan(tmp_path: Path) -> None:
    assert run("lab", "--seed", "2", "--map", str(tmp_path / "p.pgm")) == 0
    assert run("import", str(tmp_path / "p.pgm"), "--out", str(tmp_path / "w.yaml")) == 0
    (tmp_path / "w.yaml").replace(tmp_path / "p.yaml")
    assert open_world(str(tmp_path / "p.pgm"), 1).generator.name == "p"


def test_a_gazebo_world_is_described_drawn_and_imported(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run("info", str(ROOM)) == 0
    said = capsys.readouterr()
    assert "room.world" in said.out
    assert "reachable" in said.out
    assert "0.0 m of solid borders" in said.out
    assert "no_such_model" in said.err
    view, out = tmp_path / "v.png", tmp_path / "room.yaml"
    assert run("render", str(ROOM), "--start", "0,5,180", "--out", str(view)) == 0
    assert cv2.imread(str(view)).shape == (480, 640, 3)
    assert run("import", str(ROOM), "--start", "0,5,180", "--out", str(out)) == 0
    assert load_world(out).start_pose.x == 0.0
    with pytest.raises(ConfigError, match="stands in pillar/hidden"):
        run("import", str(ROOM), "--start", "2,6.1,0", "--out", str(out))


@pytest.mark.parametrize("start", ["1e9,0,0", "-1000,0,0", "0,99,0"])
def test_a_start_outside_of_the_world_is_refused(start, tmp_path, capsys):
    assert main.execute(["world", "lab", f"--start={start}", "--picture", str(tmp_path / "p.png")]) == 1
    assert "give a place in it" in capsys.readouterr().err
    assert not (tmp_path / "p.png").exists()


def test_a_start_in_a_wall_is_refused_in_every_kind_of_world(tmp_path: Path) -> None:
    assert run("lab", "--seed", "2", "--map", str(tmp_path / "m.pgm"), "--out", str(tmp_path / "lab.yaml")) == 0
    for name in ("lab", str(tmp_path / "lab.yaml"), str(tmp_path / "m.yaml")):
        for start in ("0.1,2,90", *(["0.01,0.01,0"] if name != str(tmp_path / "m.yaml") else [])):
            with pytest.raises(ConfigError, match="stands in a wall or a thing; choose another start"):
                run(name, "--seed", "2", f"--start={start}", "--out", str(tmp_path / "w.yaml"))
    assert not (tmp_path / "w.yaml").exists()


@pytest.mark.parametrize(("place", "told"), [((0.01, 0.01), "stands in a wall"), ((99.0, 0.0), "give a place in it")])
def test_a_start_in_a_file_is_refused_before_anything_is_compiled(
    place: tuple[float, float], told: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    world, file = generate_world("lab", 2), tmp_path / "w.yaml"
    save_world(replace(world, start=replace(world.start, x=place[0], y=place[1])), file)
    monkeypatch.setattr(explore, "compile_kernels", lambda *_: pytest.fail("kernels are compiled"))
    for mode in (["--fast"], []):
        with pytest.raises(ConfigError, match=told):
            main.run(main.parse(["explore", *mode, "--world", str(file), "--out", str(tmp_path / "run")]))
    assert not (tmp_path / "run").exists()


def test_where_a_run_ended_at_a_wall_the_next_one_begins(tmp_path: Path) -> None:
    world, file = generate_world("lab", 2), tmp_path / "w.yaml"
    at_wall = next(x for x in np.arange(0.0, 3.0, 0.001) if _gap_m(world, float(x)) > 0.179)
    save_world(world.starting_at(Start(x=float(at_wall), y=world.start.y, theta_rad=0.0)), file)
    assert open_world(str(file), 2).start.x == at_wall


def _gap_m(world: World, x: float) -> float:
    inside = any(
        cv2.pointPolygonTest(np.array(o.points, np.float32), (x, world.start.y), False) > 0 for o in world.outlines
    )
    gap = gap_to_walls(world.obstacle_segments(0.0, 0.45), np.array([[x, world.start.y]]))
    return float(gap[0]) if inside else 0.0
