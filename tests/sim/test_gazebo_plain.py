"""Solids where nothing is drawn are drawn plain; those that something shows are not covered."""

from pathlib import Path

import numpy as np
import pytest
from gazebo_files import write_world

from vsx_ros.arrays import FloatArray
from vsx_ros.sim.gazebo.assemble import Parts, assemble
from vsx_ros.sim.gazebo.budget import Budget
from vsx_ros.sim.gazebo.geometry import box, cylinder, pose_matrix
from vsx_ros.sim.gazebo.paths import ModelFolders
from vsx_ros.sim.gazebo.plain import inset, is_shown
from vsx_ros.sim.gazebo.sdf import read_layout


def part(kind: str, pose: str, geometry: str) -> str:
    return f'<{kind} name="{kind}"><pose>{pose}</pose><geometry>{geometry}</geometry></{kind}>'


def cuboid(kind: str, pose: str, size: str) -> str:
    return part(kind, pose, f"<box><size>{size}</size></box>")


def parts_of(folder: Path, *shapes: str, pose: str = "0 0 0 0 0 0") -> Parts:
    model = f'<model name="m"><pose>{pose}</pose><link name="l">{"".join(shapes)}</link></model>'
    folders, budget = ModelFolders([]), Budget()
    return assemble(read_layout(write_world(folder, model), folders, budget), folders, budget)


def drawn_below(parts: Parts, z_m: float) -> FloatArray:
    """Lowest and highest corner of what is drawn below a height, (2, 3)."""
    points = parts.seen.corners.reshape(-1, 3)
    points = points[points[:, 2] < z_m]
    assert len(points)
    return np.array([points.min(axis=0), points.max(axis=0)])


@pytest.mark.parametrize("height_m", [0.6, 0.68])  # 8 cm below the top, and right below it
@pytest.mark.parametrize("yaw", ["0", "0.7"])
def test_a_block_below_a_drawn_top_is_drawn(tmp_path: Path, height_m: float, yaw: str) -> None:
    top = "0 0 0.7 0 0 0", "1 0.6 0.04"
    block = cuboid("collision", f"0 0 {height_m / 2} 0 0 0", f"1 0.6 {height_m}")
    parts = parts_of(tmp_path, cuboid("visual", *top), cuboid("collision", *top), block, pose=f"0 0 0 0 0 {yaw}")
    assert len(parts.seen.corners) == 12 + 12
    low, high = drawn_below(parts, 0.679)
    assert low[2] == pytest.approx(0.005)
    assert high[2] == pytest.approx(height_m - 0.005)
    assert parts.remarks == ["m/l shows nothing at 1 of its 2 solid parts: drawn plain there"]


@pytest.mark.parametrize("broken", ["<mesh><uri>none.dae</uri></mesh>", "<heightmap/>"])
def test_a_label_does_not_hide_the_solid_of_a_visual_that_cannot_be_drawn(tmp_path: Path, broken: str) -> None:
    label = cuboid("visual", "0 0 1 0 0 0", "0.05 0.05 0.05")
    parts = parts_of(
        tmp_path, part("visual", "0 0 0 0 0 0", broken), label, cuboid("collision", "0 0 0.5 0 0 0", "0.6 0.6 1")
    )
    assert np.ptp(drawn_below(parts, 0.9), axis=0)[:2].tolist() == pytest.approx([0.59, 0.59])
    assert any("m/l has a visual that cannot be drawn" in remark for remark in parts.remarks)


@pytest.mark.parametrize("height_m", ["0.5", "0.3"])
def test_a_clear_visual_hides_nothing(tmp_path: Path, height_m: str) -> None:
    clear = cuboid("visual", "0 0 0.5 0 0 0", "0.6 0.6 1").replace(
        "<geometry>", "<transparency>1</transparency><geometry>"
    )
    parts = parts_of(tmp_path, clear, cuboid("collision", f"0 0 {height_m} 0 0 0", "0.6 0.6 1"))
    assert len(parts.seen.corners) == 12


SEEN = {
    "the same box": ("0 0 0.5 0 0 0", "0.6 0.6 1"),
    "a larger box": ("0 0 0.5 0 0 0", "0.62 0.62 1.02"),
    "a post in it": ("0 0 0.5 0 0 0", "0.1 0.1 1"),
    "a thin panel in it": ("0 0 0.5 0 0 0", "0.6 0.002 1"),
    "a turned box": ("0 0 0.5 0 0 0.7", "0.5 0.5 1"),
}


@pytest.mark.parametrize("name", SEEN)
def test_a_solid_that_is_shown_is_not_covered(tmp_path: Path, name: str) -> None:
    parts = parts_of(tmp_path, cuboid("visual", *SEEN[name]), cuboid("collision", "0 0 0.5 0 0 0", "0.6 0.6 1"))
    assert len(parts.seen.corners) == 12
    assert not parts.remarks


def test_a_plane_on_a_slab_stays_visible(tmp_path: Path) -> None:
    plane = part("visual", "0 0 0 0 0 0", "<plane><normal>0 0 1</normal><size>4 4</size></plane>")
    parts = parts_of(tmp_path, plane, cuboid("collision", "0 0 -0.1 0 0 0", "4 4 0.2"))
    below = parts.seen.corners[2:]
    assert len(below) == 12
    assert below[..., 2].max() == pytest.approx(-0.005)


def test_flat_solids_are_shown_by_what_lies_on_them(tmp_path: Path) -> None:
    plane = "<plane><normal>0 0 1</normal><size>4 4</size></plane>"
    for z in ("0", "0.01", "-0.015"):
        parts = parts_of(tmp_path, part("visual", f"0 0 {z} 0 0 0", plane), part("collision", "0 0 0 0 0 0", plane))
        assert len(parts.seen.corners) == 2


def test_many_triangles_are_thinned_to_the_safe_side() -> None:
    T = pose_matrix(1.0, 2.0, 3.0, 0.1, 0.2, 0.3)
    solid = box(1.0, 1.0, 1.0).corners @ T[:3, :3].T + T[:3, 3]
    post = cylinder(0.1, 1.0).corners @ T[:3, :3].T + T[:3, 3]
    assert is_shown(solid, T, [post], 1)
    assert is_shown(solid, T, [post], 7)
    assert not is_shown(solid, T, [post + 2.0], 1)
    assert not is_shown(solid, T, [], 1)


def test_a_plain_solid_is_a_little_smaller_in_its_own_axes() -> None:
    T = pose_matrix(1.0, 2.0, 3.0, 0.1, 0.2, 0.3)
    for size, expected in (((1.0, 0.5, 0.2), (0.99, 0.49, 0.19)), ((1.0, 0.004, 0.2), (0.99, 0.002, 0.19))):
        smaller = inset(box(*size).corners @ T[:3, :3].T + T[:3, 3], T)
        np.testing.assert_allclose(smaller, box(*expected).corners @ T[:3, :3].T + T[:3, 3], atol=1e-12)
