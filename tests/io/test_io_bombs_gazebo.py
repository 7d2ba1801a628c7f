"""Small Gazebo worlds that ask for gigabytes or hours: each is read, or refused in one sentence, at once."""

import json
import struct
from pathlib import Path

import numpy as np
import pytest
import trimesh
from PIL import Image
from taken import taken

from vsx_ros.sim.gazebo_world import load_gazebo


def world(folder: Path, *parts: str) -> Path:
    """A world of these parts, with a floor and two walls; returns its folder."""
    box = "<geometry><box><size>6 0.1 1</size></box></geometry>"
    sides = (f'<collision name="w"><pose>0 {y} 0.5 0 0 0</pose>{box}</collision>' for y in (-2, 2))
    floor = "<include><uri>model://ground_plane</uri></include>"
    text = f'<sdf version="1.6"><world name="w">{floor}{model(*sides)}{"".join(parts)}</world></sdf>'
    (folder / "w.world").write_text(text)
    return folder


def model(*parts: str) -> str:
    return f'<model name="m"><link name="l">{"".join(parts)}</link></model>'


def uses(kind: str, count: int, what: str = "visual") -> str:
    mesh = f"<geometry><mesh><uri>m.{kind}</uri></mesh></geometry>"
    return model(*(f'<{what} name="v{k}">{mesh}</{what}>' for k in range(count)))


def said(folder: Path) -> str:
    return taken(folder, lambda p: load_gazebo(p / "w.world", []))


def fan(triangles: int) -> trimesh.Trimesh:
    """Of a thin disc."""
    angles = np.linspace(0.0, 6.28, triangles + 1)
    rim = np.column_stack([np.cos(angles), np.sin(angles), np.zeros(triangles + 1)])
    faces = np.column_stack([np.zeros(triangles, int), np.arange(1, triangles + 1), np.arange(2, triangles + 2)])
    return trimesh.Trimesh(np.vstack([np.zeros((1, 3)), rim]), np.minimum(faces, triangles + 1), process=False)


def glb(path: Path, tree: dict, data: bytes = b"") -> None:
    text = json.dumps({"asset": {"version": "2.0"}, **tree}).encode()
    text += b" " * (-len(text) % 4)
    chunks = struct.pack("<II", len(text), 0x4E4F534A) + text
    if data:
        chunks += struct.pack("<II", len(data), 0x004E4942) + data
    path.write_bytes(struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks)


def many_nodes(path: Path, count: int, faces: int, **more: object) -> None:
    """Nodes that all show the same mesh."""
    numbers = np.arange(3 * faces, dtype=np.uint32) % 300
    data = np.random.default_rng(0).random((300, 3), np.float32).tobytes() + numbers.tobytes()
    tree = {
        "buffers": [{"byteLength": len(data)}],
        "bufferViews": [
            {"buffer": 0, "byteOffset": 0, "byteLength": 3600},
            {"buffer": 0, "byteOffset": 3600, "byteLength": len(data) - 3600},
        ],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": 300, "type": "VEC3"},
            {"bufferView": 1, "componentType": 5125, "count": 3 * faces, "type": "SCALAR"},
        ],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]}],
        "nodes": [{"mesh": 0} for _ in range(count)],
        "scenes": [{"nodes": list(range(count))}],
    }
    glb(path, {**tree, **more}, data)


def no_view(path: Path) -> None:
    glb(path, {"accessors": [{"componentType": 5126, "count": 30_000_000, "type": "VEC3"}], "bufferViews": [],
               "meshes": [{"primitives": [{"attributes": {"POSITION": 0}}]}], "nodes": [{"mesh": 0}],
               "scenes": [{"nodes": [0]}]})  # fmt: skip


USE = {"attributes": {"POSITION": 0}, "indices": 1}
VIEW = {"buffer": 0, "byteOffset": 1, "byteLength": 120_000}
CHAIN = [{"mesh": 0, "children": [k + 1] * (k < 3999)} for k in range(4000)]
EXTRAS = {str(k): 0 for k in range(10**5)}
NEGATIVE = {"componentType": 5126, "count": -9, "type": "VEC3"}
GLTF = {
    "nodes": ("12000000 triangles", 600, 20_000, {}),
    "same view": ("bytes of data", 1, 10_000, {"bufferViews": [VIEW] * 9000}),
    "same primitive": ("vertices in its primitives", 1, 9000, {"meshes": [{"primitives": [USE] * 900}]}),
    "crowd": ("nodes or parts", 200, 1, {"meshes": [{"primitives": [USE] * 200}]}),
    "chain": ("nested more than 64", 0, 1, {"nodes": CHAIN, "scenes": [{"nodes": [0]}]}),
    "parents": ("no tree", 0, 1, {"nodes": [{"children": [1]}, {"mesh": 0}], "scenes": [{"nodes": [0, 1]}]}),
    "name": ("letters in meshes", 1, 1, {"meshes": [{"name": "m" * 10**6, "primitives": []}]}),
    "extras": ("extras of its primitives", 1, 1, {"meshes": [{"extras": EXTRAS, "primitives": [USE] * 900}]}),
    "negative": ("no number of things", 1, 1, {"accessors": [NEGATIVE]}),
}


@pytest.mark.parametrize("kind", GLTF)
def test_gltf(tmp_path: Path, kind: str) -> None:
    words, count, faces, more = GLTF[kind]
    many_nodes(tmp_path / "m.glb", count, faces, **more)
    assert words in said(world(tmp_path, uses("glb", 1)))


def test_gltf_without_data(tmp_path: Path) -> None:
    no_view(tmp_path / "m.glb")
    assert "bytes of data" in said(world(tmp_path, uses("glb", 1)))


@pytest.mark.parametrize("what", ["visual", "collision"])
def test_one_mesh_many_times(tmp_path: Path, what: str) -> None:
    fan(20_000).export(tmp_path / "m.stl")
    assert "triangles at " in said(world(tmp_path, uses("stl", 800, what)))


def test_spheres(tmp_path: Path) -> None:
    ball = "<geometry><sphere><radius>1</radius></sphere></geometry>"
    assert "triangles at " in said(
        world(tmp_path, model(*(f'<visual name="v">{ball}</visual>' for _ in range(19_000))))
    )


def test_includes_without_shapes(tmp_path: Path) -> None:
    for k in range(15):
        (tmp_path / f"a{k}").mkdir()
        inner = f"<include><uri>model://a{k + 1}</uri></include>" * 8
        (tmp_path / f"a{k}" / "model.sdf").write_text(f'<sdf version="1.6"><model name="m">{inner}</model></sdf>')
    assert "elements at " in said(world(tmp_path, "<include><uri>model://a0</uri></include>"))


def test_includes_that_are_missing(tmp_path: Path) -> None:
    parts = (f"<include><uri>model://a{k}</uri></include>" for k in range(80_000))
    assert "model://a0" not in said(world(tmp_path, *parts))


LONG = "n" * 10**6
FRAMES = [f'<frame name="f{k}" attached_to="f{k + 1}"/>' for k in range(40_000)]  # the last one does not exist
AT_FRAMES = [f'<model name="m{k}"><pose relative_to="f{k}"/></model>' for k in range(40_000)]
FILES = {
    "lamps": ("256 lamps", '<light type="point"/>' * 300),
    "suns": ("256 lamps", "<include><uri>model://sun</uri></include>" * 300),
    "long name": ("letters", f'<model name="{LONG}"><link name="l">' + '<visual name="v"/>' * 9000 + "</link></model>"),
    "long address": ("letters", f"<include><uri>http://{LONG}</uri></include>"),
    "deep names": ("letters", f'<model name="{LONG[:450]}">' * 12 + "<link/>" + "</model>" * 12),
    "elements": ("elements", "<a/>" * 300_000),
    "tags": ("tags", "<a/>" * 1_900_000),
    "attributes": ("attributes", f"<a {' '.join(f'a{k}={chr(39) * 2}' for k in range(800_000))}/>"),
    "links": ("", model(*['<link name="l"/>' * 190_000])),
    "frames": ("", "".join(FRAMES + AT_FRAMES)),
    "deep": ("", "<a>" * 90_000 + "</a>" * 90_000),
}


@pytest.mark.parametrize("kind", FILES)
def test_sdf(tmp_path: Path, kind: str) -> None:
    words, text = FILES[kind]
    assert words in said(world(tmp_path, text))


def collada(path: Path, nodes: str, scene: str, geometry: str = "") -> None:
    path.write_text(
        '<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1"><asset><unit meter="1"/></asset>'
        f"<library_geometries>{geometry}</library_geometries><library_nodes>{nodes}</library_nodes>"
        f'<library_visual_scenes><visual_scene id="s">{scene}</visual_scene></library_visual_scenes>'
        '<scene><instance_visual_scene url="#s"/></scene></COLLADA>'
    )


def sheet(points: int, primitives: str) -> str:
    numbers = " ".join(["0 1 2"] * points)
    return (
        f'<geometry id="g"><mesh><source id="p"><float_array id="a" count="{3 * points}">{numbers}</float_array>'
        f'<technique_common><accessor source="#a" count="{points}" stride="3"><param name="X" type="float"/>'
        '<param name="Y" type="float"/><param name="Z" type="float"/></accessor></technique_common></source>'
        f'<vertices id="v"><input semantic="POSITION" source="#p"/></vertices>{primitives}</mesh></geometry>'
    )


def triangles(count: int) -> str:
    """Whose number is not announced."""
    return f'<triangles><input semantic="VERTEX" source="#v" offset="0"/><p>{"0 1 2 " * count}</p></triangles>'


@pytest.mark.parametrize("leaf", ["", '<instance_geometry url="#g"/>'], ids=["nothing", "triangles"])
def test_collada_nodes_of_nodes(tmp_path: Path, leaf: str) -> None:
    nodes = f'<node id="n0">{leaf}</node>' + "".join(
        f'<node id="n{k}">' + f'<instance_node url="#n{k - 1}"/>' * 10 + "</node>" for k in range(1, 12)
    )
    collada(tmp_path / "m.dae", nodes, '<node id="r"><instance_node url="#n11"/></node>', sheet(3, triangles(9)))
    assert "parts of meshes at " in said(world(tmp_path, uses("dae", 1)))


def test_collada_that_announces_nothing(tmp_path: Path) -> None:
    leaves = '<node id="r">' + '<instance_geometry url="#g"/>' * 300 + "</node>"
    collada(tmp_path / "m.dae", "", leaves, sheet(3, triangles(90_000)))
    assert "triangles at " in said(world(tmp_path, uses("dae", 1)))
    collada(tmp_path / "m.dae", "", leaves, sheet(200_000, triangles(1) * 20))
    assert "vertices at " in said(world(tmp_path, uses("dae", 1)))
    collada(tmp_path / "m.dae", "", "", "<a/>" * 600_000)
    assert "tags" in said(world(tmp_path, uses("dae", 1)))


OBJ = {
    "one face": ("2999998 triangles", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf " + "1 2 3 " * 1_000_000),
    "over many lines": ("triangles", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf " + "1 2 3 \\\n" * 800_000),
    "materials": ("", "v 0 0 0\n" * 90_000 + "".join(f"usemtl a{k}\nf 1 2 3\n" for k in range(4000))),
    "same file": ("names", "mtllib m.mtl\nv 0 0 0\nvt 0 0\n" + "usemtl a0\nf 1/1 1/1 1/1\n"),
}


@pytest.mark.parametrize("kind", OBJ)
def test_obj(tmp_path: Path, kind: str) -> None:
    words, text = OBJ[kind]
    (tmp_path / "m.obj").write_text(text)
    Image.fromarray(np.random.default_rng(0).integers(0, 256, (1024, 1024, 3), np.uint8)).save(tmp_path / "p.png")
    (tmp_path / "m.mtl").write_text("".join(f"newmtl a{k}\nmap_Kd p.png\n" for k in range(500)))
    assert words in said(world(tmp_path, uses("obj", 1)))


def painted(folder: Path, name: str) -> Path:
    look = f"<material><pbr><metal><albedo_map>{name}</albedo_map></metal></pbr></material>"
    shape = "<geometry><box><size>1 1 1</size></box></geometry>"
    return world(folder, model(f'<visual name="v">{shape}{look}</visual>'))


def test_many_textures_inside_of_a_mesh(tmp_path: Path) -> None:
    for k in range(20):
        Image.new("L", (5000, 5000), k).save(tmp_path / f"p{k}.png")
    (tmp_path / "m.mtl").write_text("".join(f"newmtl a{k}\nmap_Kd p{k}.png\n" for k in range(20)))
    faces = "".join(f"usemtl a{k}\nf 1/1 2/1 3/1\n" for k in range(9))
    (tmp_path / "m.obj").write_text(f"mtllib m.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 1\nvt 0 0\n{faces}")
    assert said(world(tmp_path, uses("obj", 1))) == ""
    faces = "".join(f"usemtl a{k}\nf 1/1 2/1 3/1\n" for k in range(20))
    (tmp_path / "m.obj").write_text(f"mtllib m.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 1\nvt 0 0\n{faces}")
    assert "20 textures have 500000000 pixels" in said(world(tmp_path, uses("obj", 1)))


@pytest.mark.parametrize(("mode", "kind"), [("CMYK", "jpg"), ("RGBA", "png"), ("RGB", "webp"), ("I;16", "png")])
@pytest.mark.parametrize("size", [(8192, 8192), (8192, 4096)], ids=["refused", "read"])
def test_textures(tmp_path: Path, mode: str, kind: str, size: tuple[int, int]) -> None:
    Image.new(mode, size).save(tmp_path / f"t.{kind}", **({"progressive": True} if kind == "jpg" else {}))
    told = said(painted(tmp_path, f"t.{kind}"))
    assert ("33554432 in all" in told) == (size == (8192, 8192))


def test_a_texture_that_is_a_program(tmp_path: Path) -> None:
    (tmp_path / "t.eps").write_text("%!PS-Adobe-3.0 EPSF-3.0\n%%BoundingBox: 0 0 9 9\n%%EndComments\n")
    assert "cannot be read" in said(painted(tmp_path, "t.eps"))


SCRIPTS = {
    "empty lines": "material M\n{" + "\n" * 900_000 + "}",
    "spaces": "material M {" + " " * 900_000 + "texture",
    "long name": "material M\n{\ntexture " + "t" * 900_000 + "\n}\n",
    "many": "".join(f"material M{k}\n{{\n}}\n" for k in range(40_000)),
}


@pytest.mark.parametrize("kind", SCRIPTS)
def test_ogre_scripts(tmp_path: Path, kind: str) -> None:
    (tmp_path / "m.material").write_text(SCRIPTS[kind])
    look = "<material><script><uri>m.material</uri><name>M{}</name></script></material>"
    shape = "<geometry><box><size>1 1 1</size></box></geometry>"
    visuals = (f'<visual name="v{k}">{shape}{look.format(k or "")}</visual>' for k in range(9000))
    said(world(tmp_path, model(*visuals)))
