import dataclasses
import pickle

import numpy as np
import pytest
import wall_scene as scene

from vsx_ros.config import DenseConfig
from vsx_ros.dense.cells import CellKind
from vsx_ros.dense.densify import DenseMap, Densifier
from vsx_ros.dense.planes import PlaneKind
from vsx_ros.geometry.se3 import SE3
from vsx_ros.slam.snapshot import MapSnapshot

CONFIG = DenseConfig()
X = 2.2
GAP = 0.3
ALL = 10**9  # cells in one update
FLOOR = scene.floor(grey=90.0, contrast=40.0, seed=1)
BACK = scene.wall(4.5, -5.0, 5.0, 2.5, grey=120.0, contrast=60.0, seed=8)


def box(y_from: float, y_to: float, contrast: float, seed: int) -> scene.Rectangle:
    return scene.wall(X, y_from, y_to, 0.6, grey=170.0, contrast=contrast, seed=seed)


TEXTURED = [FLOOR, BACK, box(-1.1, -GAP, 50.0, 4), box(GAP, 1.1, 50.0, 5)]
PLAIN = [FLOOR, BACK, box(-1.1, -GAP, 0.0, 4), box(GAP, 1.1, 0.0, 5)]


def points_on_boxes(n: int) -> np.ndarray:
    """Half a centimetre off the two boxes, at half their height: what notices on them would give."""
    rng = np.random.default_rng(2)
    y = rng.uniform(GAP + 0.05, 0.9, n) * np.where(np.arange(n) % 2, 1, -1)
    return np.stack([X + rng.normal(0, 0.005, n), y, rng.uniform(0.35, 0.55, n)], axis=1)


@pytest.fixture(scope="module")
def textured() -> MapSnapshot:
    return scene.snapshot(TEXTURED, scene.DRIVE, points_on_boxes(120))


@pytest.fixture(scope="module")
def plain() -> MapSnapshot:
    return scene.snapshot(PLAIN, scene.DRIVE, points_on_boxes(120))


def first(snapshot: MapSnapshot, n: int) -> MapSnapshot:
    """The same map when it had n keyframes."""
    kept = snapshot.obs_keyframe < n
    return dataclasses.replace(
        snapshot,
        version=n,
        keyframe_ids=snapshot.keyframe_ids[:n],
        keyframe_stamps_ns=snapshot.keyframe_stamps_ns[:n],
        T_world_cams=snapshot.T_world_cams[:n],
        images=snapshot.images[:n],
        **{name: getattr(snapshot, name)[kept] for name in ("obs_keyframe", "obs_point", "obs_uv", "obs_level")},
    )


def shifted(snapshot: MapSnapshot, x: float, y: float) -> MapSnapshot:
    """The same map, all of it corrected by this much [m]."""
    shift = SE3(np.eye(3), np.array([x, y, 0.0]))
    return dataclasses.replace(
        snapshot,
        T_world_cams=tuple(shift @ T for T in snapshot.T_world_cams),
        points_world=shift @ snapshot.points_world,
    )


def densifier() -> Densifier:
    return Densifier(scene.CAMERA, scene.MOUNT, CONFIG)


def low_columns(dense: DenseMap) -> np.ndarray:
    """(N,) y of the cells of the boxes' plane where a robot would touch them."""
    centres = dense.cells.centre
    return centres[(np.abs(centres[:, 0] - X) < 0.05) & (centres[:, 2] < 0.3) & (centres[:, 2] > 0.0), 1]


@pytest.mark.parametrize("look", ["textured", "plain"])
def test_faces_are_filled_to_the_floor_and_the_gap_between_stays_open(
    look: str, request: pytest.FixtureRequest
) -> None:
    dense = densifier().update(request.getfixturevalue(look))
    y = low_columns(dense)
    wanted = np.arange(GAP + 0.04, 0.9, 0.08)
    found = [np.abs(y - side * at).min() < 0.06 for at in wanted for side in (-1, 1)]
    assert np.mean(found) > 0.9
    assert np.abs(y).min() > GAP - 0.08


def test_plain_faces_are_known_from_the_floor_and_textured_ones_from_what_they_show(
    plain: MapSnapshot, textured: MapSnapshot
) -> None:
    for snapshot, kind, least in ((plain, CellKind.CONTACT, 20), (textured, CellKind.PHOTO, 60)):
        cells = densifier().update(snapshot).cells
        assert np.count_nonzero(cells.kind == kind) >= least


def test_cells_lie_in_their_planes_and_name_keyframes_and_planes_that_are_there(textured: MapSnapshot) -> None:
    dense = densifier().update(textured)
    planes = {plane.id: plane for plane in dense.planes}
    cells = dense.cells
    assert len(cells.plane) > 50
    assert dense.version == textured.version
    for number in np.unique(cells.plane):
        plane, mine = planes[int(number)], cells.plane == number
        assert np.abs(plane.distances(cells.centre[mine])).max() < 1e-9
        assert (np.floor(plane.coordinates(cells.centre[mine]) / CONFIG.cell_m) == cells.cell[mine]).all()
    assert 0 <= cells.keyframe.min() <= cells.keyframe.max() < len(textured.images)
    assert 0.0 <= cells.score.min() <= cells.score.max() <= 1.0


def test_the_same_snapshots_give_the_same_bits(textured: MapSnapshot) -> None:
    runs = []
    for _ in range(2):
        dense = densifier()
        dense.update(first(textured, 9))
        runs.append(dense.update(textured))
    assert all(np.array_equal(a, b) for a, b in zip(runs[0].cells, runs[1].cells))


def looked_through(densifier: Densifier, dense: DenseMap) -> dict[tuple[int, int], int]:
    """How many keyframes look through each cell of the boxes' plane, where any does."""
    boxes = next(plane for plane in dense.planes if abs(abs(plane.offset) - X) < 0.1)
    surface = densifier._surfaces[boxes.id]
    cells = np.argwhere(surface._passing > 0)
    return {tuple((cell + surface.low).tolist()): int(surface._passing[tuple(cell)]) for cell in cells}


def test_cells_that_a_plane_gains_know_who_looked_through_them_before() -> None:
    """First only the left box is known, then the right one, in the same plane. Over both the wall behind is seen."""
    rng = np.random.default_rng(5)
    y, z = rng.uniform(GAP + 0.05, 1.05, 240), rng.uniform(0.1, 0.55, 240)
    boxes = np.stack([X + rng.normal(0.0, 0.005, 240), np.where(np.arange(240) < 120, -y, y), z], axis=1)
    back = np.stack([4.5 + rng.normal(0.0, 0.01, 400), rng.uniform(-2, 2, 400), rng.uniform(1.1, 2.0, 400)], axis=1)
    left = scene.snapshot(PLAIN, scene.DRIVE, np.vstack([back, boxes[:120]]))
    both = scene.snapshot(PLAIN, scene.DRIVE, np.vstack([back, boxes]), version=2)
    growing, at_once = densifier(), densifier()
    before = looked_through(growing, growing.update(left))
    after = looked_through(growing, growing.update(both))
    assert len(after) > len(before) > 0
    assert after == looked_through(at_once, at_once.update(both))


def test_a_map_that_grew_is_as_full_as_one_made_at_once(textured: MapSnapshot) -> None:
    growing = densifier()
    for n in range(3, len(textured.images) + 1):
        grow_regions = growing.update(first(textured, n))
    at_once = densifier().update(textured)
    assert grow_regions.complete
    assert len(grow_regions.cells.plane) == pytest.approx(len(at_once.cells.plane), rel=0.1)


def test_work_beyond_the_budget_waits_for_the_next_update(textured: MapSnapshot) -> None:
    growing = densifier()
    some = growing.update(textured, 150)
    assert not some.complete
    updates = 0
    while not some.complete:
        some = growing.update(textured, 150)
        updates += 1
    assert 2 <= updates <= 40
    assert {tuple(c) for c in some.cells.cell.tolist()} == {
        tuple(c) for c in densifier().update(textured).cells.cell.tolist()
    }


def test_the_whole_map_may_move_and_its_cells_move_along(textured: MapSnapshot) -> None:
    dense = densifier()
    before = dense.update(textured)
    after = dense.update(shifted(textured, 0.3, 0.2))
    low, high = before.cells.centre.mean(axis=0), after.cells.centre.mean(axis=0)
    assert high - low == pytest.approx([0.3, 0.2, 0.0], abs=0.04)


@pytest.mark.parametrize("look", ["textured", "plain"])
def test_cells_are_right_again_after_the_map_slid_along_their_plane(look: str, request: pytest.FixtureRequest) -> None:
    snapshot = request.getfixturevalue(look)
    dense = densifier()
    for slid in (snapshot, shifted(snapshot, 0.0, 0.5)):
        dense.update(slid, ALL, settled=True)
    after, fresh = (each.update(slid, ALL, settled=True).cells for each in (dense, densifier()))
    for name in ("cell", "kind", "score", "keyframe", "witnesses"):
        assert np.array_equal(getattr(after, name), getattr(fresh, name)), name


def test_a_plane_that_moves_keeps_its_cells_until_they_are_judged_again(textured: MapSnapshot) -> None:
    dense = densifier()
    before, moved = dense.update(textured, ALL, settled=True).cells, shifted(textured, 0.05, 0.0)
    waiting = dense.update(moved, 0, settled=True)
    assert not waiting.complete
    assert len(waiting.cells.plane) >= 0.95 * len(before.plane)
    assert np.median(waiting.cells.centre[:, 0]) == pytest.approx(np.median(before.centre[:, 0]) + 0.05, abs=0.01)
    after, fresh = (each.update(moved, ALL, settled=True).cells for each in (dense, densifier()))
    assert np.array_equal(after.cell, fresh.cell)


def test_a_plane_that_moves_far_is_another(textured: MapSnapshot) -> None:
    """It keeps its id while it shares points with what it was, even when most are of another wall."""
    dense = densifier()
    dense.update(textured, ALL, settled=True)
    moved = shifted(textured, 0.6, 0.0)
    known, fresh = (each.update(moved, 0, settled=True) for each in (dense, densifier()))
    walls = [plane.id for plane in known.planes if plane.kind is PlaneKind.WALL]
    assert walls
    of_walls = (np.isin(each.cells.plane, walls) for each in (known, fresh))
    assert np.array_equal(*(each.cells.cell[of] for each, of in zip((known, fresh), of_walls)))


def test_millimetres_of_adjustment_make_no_work(textured: MapSnapshot) -> None:
    dense = densifier()
    dense.update(textured, ALL)
    assert dense.update(shifted(textured, 0.0, 0.003), 0).complete


def test_planes_without_keyframes_yet_settled_give_no_cell(textured: MapSnapshot) -> None:
    dense = densifier().update(first(textured, 2))
    assert not np.isin(dense.cells.kind, (CellKind.PHOTO, CellKind.CONTACT)).any()
    assert dense.planes
    assert dense.complete, "a run resumed in so small a map waits for it"


def test_a_map_without_points_has_no_cell() -> None:
    empty = scene.snapshot([FLOOR], [], np.zeros((0, 3)))
    dense = densifier().update(empty)
    assert dense.planes == ()
    assert len(dense.cells.plane) == 0
    assert dense.complete


def test_without_a_floor_nothing_stands_on_it_but_textured_planes_are_found(textured: MapSnapshot) -> None:
    dense = Densifier(scene.CAMERA, None, CONFIG).update(textured)
    assert np.count_nonzero(dense.cells.kind == CellKind.PHOTO) > 30
    assert not (dense.cells.kind == CellKind.CONTACT).any()


def test_the_size_told_is_that_of_images_and_evidence(textured: MapSnapshot) -> None:
    here = densifier()
    nbytes = here.update(textured).nbytes
    unused = here._images._store[len(here.stored) :].nbytes  # zeros that take no memory, but are pickled
    assert nbytes < len(pickle.dumps(here)) - unused < 1.4 * nbytes  # the lens's tables are of one size for any map
