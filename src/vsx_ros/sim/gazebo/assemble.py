"""The shapes of a Gazebo world as triangles in the world: those that are seen, and those that are solid."""

from collections import Counter
from pathlib import Path
from typing import NamedTuple

import numpy as np

from vsx_ros.arrays import Float32Array, FloatArray, Int32Array, IntArray
from vsx_ros.errors import InputError
from vsx_ros.sim.gazebo.budget import Budget
from vsx_ros.sim.gazebo.elements import MeshUse
from vsx_ros.sim.gazebo.geometry import placed
from vsx_ros.sim.gazebo.mesh_parts import Mesh, MeshPart
from vsx_ros.sim.gazebo.meshes import read_mesh
from vsx_ros.sim.gazebo.paths import ModelFolders
from vsx_ros.sim.gazebo.pictures import Picture, Textures, joined, pack
from vsx_ros.sim.gazebo.plain import MOST_PAIRS, inset, is_shown
from vsx_ros.sim.gazebo.sdf import Layout, Shape
from vsx_ros.sim.gazebo.surfaces import GREY, Surface

FAR_AWAY_M = 1000.0  # from the origin: what lies farther is left out
GROUP = 512  # triangles that are culled together, at most


class Seen(NamedTuple):
    """T triangles to draw of M surfaces: corners (T, 3, 3) [m], uv (T, 3, 2), kinds (T,) surface; starts (K + 1,) of
    groups of neighbours. colours (M, 3): as of ``Surface``; pictures (M,): row of textures, or -1."""

    corners: Float32Array
    uv: Float32Array
    kinds: Int32Array
    starts: IntArray
    colours: FloatArray
    pictures: IntArray
    textures: Textures


def with_more(seen: Seen, more: Seen) -> Seen:
    """Both; the triangles, groups and surfaces of ``more`` come last."""
    return Seen(
        corners=np.concatenate([seen.corners, more.corners]),
        uv=np.concatenate([seen.uv, more.uv]),
        kinds=np.concatenate([seen.kinds, more.kinds + np.int32(len(seen.colours))]),
        starts=np.concatenate([seen.starts, more.starts[1:] + len(seen.corners)]),
        colours=np.concatenate([seen.colours, more.colours]),
        pictures=np.concatenate([seen.pictures, more.pictures + len(seen.textures.logs) * (more.pictures >= 0)]),
        textures=joined(seen.textures, more.textures),
    )


class Parts(NamedTuple):
    """solids: (N, 3, 3) triangles that stop the robot; owners (N,): their shapes in names. remarks: what is missing."""

    seen: Seen
    solids: FloatArray
    owners: IntArray
    names: list[str]
    remarks: list[str]


def assemble(layout: Layout, folders: ModelFolders, budget: Budget) -> Parts:
    """All shapes in place. Solids where their link shows nothing are drawn in plain grey, and all of a link with a
    visual that cannot be drawn: no obstacle is invisible. Raises InputError for a mesh or picture that is damaged, or
    for more than the budget has."""
    return _Assembly(folders, budget).of(layout)


class _Link(NamedTuple):
    """Of one link: corners (T, 3, 3) of the parts that are drawn, names of visuals that cannot be, and the solids."""

    drawn: list[FloatArray]
    failed: list[str]
    solids: list[tuple[Shape, MeshPart]]


class _Assembly:
    def __init__(self, folders: ModelFolders, budget: Budget) -> None:
        self._folders, self._budget = folders, budget
        self._meshes: dict[Path, Mesh] = {}
        self._drawn: list[tuple[Float32Array, Float32Array, int]] = []
        self._surfaces: dict[Surface, int] = {}
        self._remarks: list[str] = []

    def of(self, layout: Layout) -> Parts:
        links: dict[str, _Link] = {}
        names: list[str] = []
        solids: list[FloatArray] = []
        owners: list[IntArray] = []
        for shape in layout.shapes:
            parts = self._parts(shape)
            link = links.setdefault(shape.link, _Link([], [], []))
            if not shape.solid:
                for part in parts:
                    self._draw(part)
                link.drawn.extend(part.corners for part in parts)
                link.failed.extend([] if parts else [shape.name])
                continue
            link.solids.extend((shape, part) for part in parts)
            for part in parts:
                solids.append(part.corners)
                owners.append(np.full(len(part.corners), len(names), np.int64))
            names.append(shape.link)
        self._draw_plain(links)
        told = [f"{what} ({n} times)" if n > 1 else what for what, n in Counter(self._remarks).items()]
        return Parts(
            seen=self._seen(),
            solids=np.concatenate(solids) if solids else np.zeros((0, 3, 3)),
            owners=np.concatenate(owners) if owners else np.zeros(0, np.int64),
            names=names,
            remarks=[*layout.remarks, *told],
        )

    def _draw_plain(self, links: dict[str, "_Link"]) -> None:
        """The solids that nothing shows."""
        pairs = sum(len(link.solids) * sum(map(len, link.drawn)) for link in links.values())
        step = 1 + pairs // MOST_PAIRS
        for name, link in links.items():
            bare = [
                (shape, part)
                for shape, part in link.solids
                if link.failed or not is_shown(part.corners, shape.T_world, link.drawn, step)
            ]
            if bare and not link.drawn:
                self._remarks.append(f"{name} has no visual that can be drawn: its collision is drawn plain")
            elif bare and link.failed:
                self._remarks.append(f"{name} has a visual that cannot be drawn: its collision is drawn plain, too")
            elif bare:
                count = f"{len(bare)} of its {len(link.solids)} solid parts"
                self._remarks.append(f"{name} shows nothing at {count}: drawn plain there")
            for shape, part in bare:
                self._budget.take("triangles", len(part.corners), part.name)
                corners = inset(part.corners, shape.T_world) if link.drawn else part.corners
                self._draw(part._replace(corners=corners, surface=Surface(GREY)))

    def _draw(self, part: MeshPart) -> None:
        surface = self._surfaces.setdefault(part.surface, len(self._surfaces))
        self._drawn.append((part.corners.astype(np.float32), part.uv.astype(np.float32), surface))

    def _parts(self, shape: Shape) -> list[MeshPart]:
        """The triangles of a shape in the world, without those that lie far away."""
        if shape.missing:
            self._remarks.append(f"{shape.name}: {shape.missing}")
        if shape.geometry is None:
            return []
        if isinstance(shape.geometry, MeshUse):
            found = self._mesh_parts(shape, shape.geometry)
        else:
            surface = shape.surface or Surface(GREY)
            found = [MeshPart(corners=shape.geometry.corners, uv=shape.geometry.uv, surface=surface, name="")]
        parts = []
        for part in found:
            corners = placed(part.corners, shape.T_world)
            near = np.abs(corners).max(axis=(1, 2)) < FAR_AWAY_M
            if not near.all():
                at = corners[~near][0, 0]
                words = f"{at[0]:.0f}, {at[1]:.0f}, {at[2]:.0f} m"
                self._remarks.append(f"{shape.name} reaches as far as {words}: that part is left out")
            if near.any():
                parts.append(part._replace(corners=corners[near], uv=part.uv[near], name=shape.name))
        return parts

    def _mesh_parts(self, shape: Shape, use: MeshUse) -> list[MeshPart]:
        if use.path is None:
            self._remarks.append(f"{shape.name}: mesh {use.uri} does not exist; it is left out")
            return []
        if use.path not in self._meshes:
            self._meshes[use.path] = read_mesh(use.path, self._folders.find_texture, self._budget)
            self._remarks.extend(self._meshes[use.path].remarks)
        parts, _, lost = self._meshes[use.path]
        if lost and shape.solid:
            raise InputError(f"{shape.name}: mesh {use.path} is damaged ({lost[0]}), and solid; export it again")
        self._budget.take("parts of meshes", len(parts), shape.name)
        if not parts:
            self._remarks.append(f"{shape.name}: {use.path.name} shows no triangles; it is left out")
            return []
        if use.submesh:
            named = [part for part in parts if part.node == use.submesh]  # as Gazebo
            parts = named or [part for part in parts if part.name == use.submesh]
        self._budget.take("triangles", sum(len(part.corners) for part in parts), shape.name)
        if use.submesh and not parts:
            self._remarks.append(f"{shape.name}: {use.path.name} has no submesh {use.submesh}; it is left out")
        if use.centred and parts:
            points = np.concatenate([part.corners.reshape(-1, 3) for part in parts])
            middle = 0.5 * (points.min(axis=0) + points.max(axis=0))
            parts = [part._replace(corners=part.corners - middle) for part in parts]
        if shape.surface is not None:
            parts = [part._replace(surface=shape.surface) for part in parts]
        return [part._replace(corners=part.corners * use.scale).unmirrored(np.diag(use.scale)) for part in parts]

    def _seen(self) -> Seen:
        starts, at = [0], 0
        for corners, _, _ in self._drawn:
            starts += [at + step for step in range(GROUP, len(corners), GROUP)]
            at += len(corners)
            starts.append(at)
        none = (np.zeros((0, 3, 3), np.float32), np.zeros((0, 3, 2), np.float32), 0)
        all_corners, all_uv, kinds = zip(*(self._drawn or [none]))
        surfaces = list(self._surfaces) or [Surface(GREY)]
        rows: dict[Picture | None, int] = {None: -1}
        for surface in surfaces:
            rows.setdefault(surface.picture, len(rows) - 1)
        return Seen(
            corners=np.concatenate(all_corners),
            uv=np.concatenate(all_uv),
            kinds=np.repeat(np.array(kinds, np.int32), [len(c) for c in all_corners]),
            starts=np.array(starts, np.int64),
            colours=np.array([surface.colour for surface in surfaces], float),
            pictures=np.array([rows[surface.picture] for surface in surfaces], np.int64),
            textures=pack([picture for picture in rows if picture is not None]),
        )
