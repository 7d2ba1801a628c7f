"""Poses of SDF that name frames, and saved states: where parts are, and what is told of frames that do not exist."""

from pathlib import Path

import numpy as np
import pytest
from gazebo_files import FLOOR, box_model, write_world

from vsx_ros.errors import InputError
from vsx_ros.sim.gazebo.budget import Budget
from vsx_ros.sim.gazebo.paths import ModelFolders
from vsx_ros.sim.gazebo.sdf import Layout, read_layout

BOX = "<geometry><box><size>1 1 1</size></box></geometry>"
QUARTER = "1.5707963267948966"


def layout_of(folder: Path, *parts: str) -> Layout:
    return read_layout(write_world(folder, *parts), ModelFolders([folder]), Budget())


def link(name: str, pose: str) -> str:
    return f'<link name="{name}"><pose {pose}</pose><collision name="c">{BOX}</collision></link>'


def places(layout: Layout) -> dict[str, list[float]]:
    return {shape.link: shape.T_world[:3, 3].round(9).tolist() for shape in layout.shapes if shape.solid}


def included(folder: Path, name: str, content: str, attributes: str = "") -> None:
    (folder / name).mkdir()
    text = f'<sdf version="1.9"><model name="{name}" {attributes}>{content}</model></sdf>'
    (folder / name / "model.sdf").write_text(text)


def test_a_model_stands_at_a_frame_of_the_world(tmp_path: Path) -> None:
    frames = f"""<frame name="room"><pose>4 0 0 0 0 {QUARTER}</pose></frame>
      <frame name="door" attached_to="room"><pose>1 0 0 0 0 0</pose></frame>
      <frame name="hinge"><pose relative_to="door">0 0 1 0 0 0</pose></frame>"""
    at = '<model name="m"><pose relative_to="hinge">1 0 0 0 0 0</pose>' + link("l", ">0 0 0 0 0 0") + "</model>"
    lamp = '<light name="a" type="point"><pose relative_to="m">0 0 2 0 0 0</pose></light>'
    layout = layout_of(tmp_path, at, lamp, frames)
    assert places(layout) == {"m/l": [4.0, 2.0, 1.0]}
    assert layout.lamps[0].position.tolist() == pytest.approx([4.0, 2.0, 3.0])
    assert not layout.remarks


def test_links_joints_and_visuals_may_name_each_other(tmp_path: Path) -> None:
    joint = '<joint name="j"><parent>a</parent><child>b</child><pose>0 0 0.5 0 0 0</pose></joint>'
    parts = [
        link("a", ">0 0 1 0 0 0"),
        link("b", ' relative_to="a">1 0 0 0 0 0'),
        link("c", ' relative_to="j">0 1 0 0 0 0'),
        f'<link name="d"><visual name="v"><pose relative_to="c">1 0 0 0 0 0</pose>{BOX}</visual></link>',
        link("e", ' relative_to="__model__">7 0 0 0 0 0'),
        '<link name="f"><pose>9 9 9 0 0 0</pose><light name="x" type="point"><pose relative_to="a"/></light></link>',
    ]
    model = f'<model name="m"><pose>10 0 0 0 0 0</pose>{"".join(parts)}{joint}</model>'
    layout = layout_of(tmp_path, model)
    assert places(layout) == {
        "m/a": [10.0, 0.0, 1.0], "m/b": [11.0, 0.0, 1.0], "m/c": [11.0, 1.0, 1.5], "m/e": [17.0, 0.0, 0.0],
    }  # fmt: skip
    drawn = next(shape for shape in layout.shapes if not shape.solid)
    np.testing.assert_allclose(drawn.T_world[:3, 3], [12.0, 1.0, 1.5], atol=1e-12)
    np.testing.assert_allclose(layout.lamps[0].position, [10.0, 0.0, 1.0])
    assert not layout.remarks


def test_frames_in_models_that_are_nested_or_included(tmp_path: Path) -> None:
    included(tmp_path, "table", '<frame name="top"><pose>0 0 0.7 0 0 0</pose></frame>' + link("l", ">0 0 0 0 0 0"))
    nested = '<model name="in"><pose>0 1 0 0 0 0</pose><frame name="f"><pose>0 0 3 0 0 0</pose></frame></model>'
    parts = [
        "<include><uri>model://table</uri><name>t</name><pose>2 0 0 0 0 0</pose></include>",
        f'<model name="out"><pose>5 0 0 0 0 0</pose>{nested}</model>',
        box_model("cup", "0 0 0 0 0 0", "1 1 1").replace("<pose>", '<pose relative_to="t::top">', 1),
        box_model("lid", "0 0 0 0 0 0", "1 1 1").replace("<pose>", '<pose relative_to="out::in::f">', 1),
    ]
    layout = layout_of(tmp_path, *parts)
    found = places(layout)
    assert found["cup/l"] == [2.0, 0.0, 0.7]
    assert found["lid/l"] == [5.0, 1.0, 3.0]
    assert not layout.remarks


def test_a_placement_frame_stands_where_the_pose_says(tmp_path: Path) -> None:
    included(tmp_path, "lamp", link("foot", ">0 0 -1 0 0 0"), 'placement_frame="foot"')
    parts = [
        "<include><uri>model://lamp</uri><pose>3 0 0 0 0 0</pose></include>",
        f'<model name="m" placement_frame="tip"><pose>0 4 0 0 0 0</pose>{link("tip", ">0 0 2 0 0 0")}</model>',
        "<include><uri>model://lamp</uri><name>n</name><placement_frame>__model__</placement_frame></include>",
    ]
    layout = layout_of(tmp_path, *parts)
    assert places(layout) == {"lamp/foot": [3.0, 0.0, 0.0], "m/tip": [0.0, 4.0, 0.0], "n/foot": [0.0, 0.0, -1.0]}
    assert not layout.remarks


def test_a_merged_model_lends_its_frames(tmp_path: Path) -> None:
    included(tmp_path, "base", link("plate", ">0 0 0.2 0 0 0"))
    include = '<include merge="true"><uri>model://base</uri><pose>1 0 0 0 0 0</pose></include>'
    layout = layout_of(
        tmp_path, f'<model name="m">{include}{link("mast", " relative_to=" + repr("plate") + ">")}</model>'
    )
    assert places(layout)["m/mast"] == [1.0, 0.0, 0.2]
    assert not layout.remarks


def test_frames_in_a_circle_are_told(tmp_path: Path) -> None:
    circle = '<frame name="f" attached_to="g"/><frame name="g"><pose relative_to="f"/></frame>'
    chain = "".join(f'<frame name="c{k}" attached_to="c{k + 1}"/>' for k in range(3000)) + '<frame name="c3000"/>'
    names = {"k": "f", "m": "m", "n": "a::b", "o": "c0"}
    bad = [box_model(name, "1 2 3 0 0 0", "1 1 1").replace("<pose>", f'<pose relative_to="{frame}">', 1)
           for name, frame in names.items()]  # fmt: skip
    layout = layout_of(tmp_path, circle, chain, *bad)
    assert all(shape.T_world[:3, 3].tolist() == [1.0, 2.0, 3.0] for shape in layout.shapes)
    told = " ".join(layout.remarks)
    assert len(layout.remarks) == 3
    for words in ("frame f is given relative to itself", "frame m is given relative", "no frame a::b in the world"):
        assert words in told


def test_frames_in_models_that_hold_themselves_end(tmp_path: Path) -> None:
    inside = "<include><uri>model://m</uri><placement_frame>m::m::l</placement_frame></include>"
    included(tmp_path, "m", inside + link("l", ">0 0 0 0 0 0"))
    with pytest.raises(InputError, match="nested"):
        layout_of(tmp_path, "<include><uri>model://m</uri></include>")


def test_a_state_places_links_lamps_and_nested_models_in_the_world(tmp_path: Path) -> None:
    inner = box_model("inner", "1 0 0 0 0 0", "1 1 1")
    outer = box_model("outer", "0 0 0 0 0 0", "1 1 1", inner)
    lamp = '<light name="outer" type="point"><pose>0 0 3 0 0 0</pose></light>'
    state = """<state><model name="outer"><pose>5 0 0 0 0 0</pose><scale>2 3 1</scale>
        <link name="l"><pose>5 0 0.4 0 0 0</pose></link><model name="inner"><pose>6 6 0 0 0 0</pose></model></model>
      <light name="outer"><pose>0 0 2 0 0 0</pose></light></state>"""
    layout = layout_of(tmp_path, outer, lamp, state)
    assert places(layout) == {"outer/l": [5.0, 0.0, 0.4], "outer/inner/l": [6.0, 6.0, 0.0]}
    sizes = [np.ptp(shape.geometry.corners, axis=(0, 1)).tolist() for shape in layout.shapes]  # type: ignore[union-attr]
    assert sizes == [[2.0, 3.0, 1.0]] * 2 + [[1.0, 1.0, 1.0]] * 2
    assert layout.lamps[0].position.tolist() == [0.0, 0.0, 2.0]
    assert not layout.remarks


def test_what_a_link_holds_moves_with_its_saved_link_whatever_frame_it_names(tmp_path: Path) -> None:
    shape = f'<collision name="c"><pose{{}}>0 0 1 0 0 0</pose>{BOX}</collision>'
    lamp = '<light name="a" type="point"><pose relative_to="other">0 0 2 0 0 0</pose></light>'
    named = "".join(shape.format(f' relative_to="{name}"') for name in ("l", "other", "__model__"))
    model = f"""<model name="m"><link name="l"><pose>1 0 0 0 0 0</pose>{shape.format("")}{named}{lamp}</link>
      {link("other", ">0 3 0 0 0 0")}</model>"""
    state = f"""<state><model name="m"><pose>2 2 0 0 0 0</pose>
      <link name="l"><pose>-2 2 0 0 0 {QUARTER}</pose></link></model></state>"""
    layout = layout_of(tmp_path, model, state)
    found = [shape.T_world[:3, 3].round(9).tolist() for shape in layout.shapes]
    assert found == [[-2, 2, 1], [-2, 2, 1], [-5, 1, 1], [-2, 1, 1], [2, 5, 0]]
    assert layout.lamps[0].position.tolist() == pytest.approx([-5.0, 1.0, 2.0])


def test_what_of_a_state_is_not_applied_is_told(tmp_path: Path) -> None:
    state = """<state><insertions><model name="x"/></insertions><deletions/>
      <model name="m"><scale>0 1 1</scale></model></state>"""
    layout = layout_of(tmp_path, box_model("m", "1 0 0 0 0 0", "1 1 1"), state)
    assert layout.shapes[0].T_world[0, 3] == 1.0
    assert len(layout.remarks) == 2
    assert "<insertions>" in layout.remarks[0]
    assert "state of m: its <scale>" in layout.remarks[1]


def test_what_is_transparent_is_not_drawn_or_told(tmp_path: Path) -> None:
    model = '<model name="m"><link name="l"><visual name="v">{}' + BOX + "</visual></link></model>"
    clear = layout_of(tmp_path, model.format("<transparency>1</transparency>"))
    assert not clear.shapes
    assert not clear.remarks
    partly = layout_of(tmp_path, model.format("<transparency>0.5</transparency>"))
    assert len(partly.shapes) == 1
    assert "transparency 0.5 and is drawn opaque" in partly.remarks[0]
    assert not layout_of(tmp_path, model.format("<transparency>0</transparency>")).remarks


def test_a_plane_without_size_is_large_as_a_solid(tmp_path: Path) -> None:
    plane = "<geometry><plane><normal>0 0 1</normal>{}</plane></geometry>"
    bare, sized = plane.format(""), plane.format("<size>3 3</size>")
    parts = f'<visual name="v">{bare}</visual><collision name="c">{bare}</collision>'
    parts += f'<collision name="d">{sized}</collision>'
    layout = layout_of(tmp_path, FLOOR, f'<model name="m"><link name="l">{parts}</link></model>')
    sizes = [np.ptp(shape.geometry.corners, axis=(0, 1))[0] for shape in layout.shapes[2:]]  # type: ignore[union-attr]
    assert sizes == [1.0, 200.0, 3.0]
