"""Meshes as people and generators really hand them in, each with what has to survive.

`truth` is the clean solid that a spoilt mesh was made from: where it is thick, the result may not deviate from it.
`empty` are places that must stay open (eyes, bores, slots, gaps), `full` places that must be material.
"""

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
import trimesh

from fabcraft.mesh import Mesh, concatenate

Points = tuple[tuple[float, float, float], ...]


@dataclass(frozen=True, eq=False)
class Nasty:
    """A mesh and what its solid has to keep; None: not defined for it."""

    mesh: Mesh
    parts: int | None = 1
    genus: int | None = 0
    truth: Mesh | None = None
    empty: Points = ()
    full: Points = ()
    body: Mesh | None = field(default=None)
    """The wearer, to be kept clear of by 0.5 mm."""


def mesh_of(shape: trimesh.Trimesh, *move: float) -> Mesh:
    points = np.array(shape.vertices) + (move or (0.0, 0.0, 0.0))
    return Mesh(points, np.array(shape.faces, dtype=np.int32))


def moved(mesh: Mesh, *by: float) -> Mesh:
    return mesh.with_vertices(mesh.vertices + np.array(by))


def box(*size: float) -> Mesh:
    return mesh_of(trimesh.creation.box(size))


def ball(radius: float, fineness: int = 4) -> Mesh:
    return mesh_of(trimesh.creation.icosphere(fineness, radius))


def torus(radius: float = 30.0, tube: float = 3.0, around: int = 96, across: int = 32) -> Mesh:
    return mesh_of(trimesh.creation.torus(radius, tube, major_sections=around, minor_sections=across))


def rod(radius: float, length: float, sides: int = 16) -> Mesh:
    return mesh_of(trimesh.creation.cylinder(radius, length, sections=sides))


def turned(mesh: Mesh, axis: tuple[float, float, float], degrees: float) -> Mesh:
    return mesh.transformed(trimesh.transformations.rotation_matrix(np.radians(degrees), axis))


def inverted(mesh: Mesh) -> Mesh:
    return Mesh(mesh.vertices, mesh.faces[:, ::-1])


def soup(mesh: Mesh, noise_mm: float = 0.0, dropped: float = 0.0) -> Mesh:
    """Every face with its own corners, each moved a little; some faces left out."""
    chance = np.random.default_rng(7)
    corners = mesh.corners[chance.random(len(mesh.faces)) >= dropped].reshape(-1, 3)
    corners = corners + chance.normal(0.0, 1.0, corners.shape) * noise_mm
    return Mesh(corners, np.arange(len(corners), dtype=np.int32).reshape(-1, 3))


def flipped(mesh: Mesh, share: float) -> Mesh:
    turn = np.random.default_rng(3).random(len(mesh.faces)) < share
    return Mesh(mesh.vertices, np.where(turn[:, None], mesh.faces[:, ::-1], mesh.faces).astype(np.int32))


def woven(points: np.ndarray, close_rows: bool = False, close_columns: bool = False) -> Mesh:
    """A grid of points (R, C, 3) as a sheet; closing joins the last row or column to the first."""
    rows, columns = points.shape[:2]
    index = np.arange(rows * columns).reshape(rows, columns)
    if close_rows:
        index = np.concatenate([index, index[:1]])
    if close_columns:
        index = np.concatenate([index, index[:, :1]], 1)
    a, b, c, d = (part.ravel() for part in (index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:]))
    faces = np.stack([np.stack([a, b, c], 1), np.stack([a, c, d], 1)], 1).reshape(-1, 3)
    return Mesh(points.reshape(-1, 3), faces.astype(np.int32))


def sheet(
    width: float, depth: float, step: float, height: Callable[[np.ndarray, np.ndarray], np.ndarray]
) -> Mesh:
    x, y = np.meshgrid(
        np.linspace(-width / 2, width / 2, int(width / step) + 1),
        np.linspace(-depth / 2, depth / 2, int(depth / step) + 1),
        indexing="ij",
    )
    return woven(np.stack([x, y, height(x, y)], 2))


def cells(woven_sheet: Mesh) -> tuple[np.ndarray, np.ndarray]:
    """x and y of the middle of every face's cell, so that both halves of a cell go together."""
    middles = woven_sheet.corners.reshape(-1, 6, 3).mean(1).repeat(2, axis=0)
    return middles[:, 0], middles[:, 1]


def tube(line: np.ndarray, radius: float, sides: int = 16) -> Mesh:
    """A closed round tube along a polyline (N, 3)."""
    along = np.gradient(line, axis=0)
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    side = np.cross(along, [0.31, 0.52, 0.8])
    side /= np.linalg.norm(side, axis=1, keepdims=True)
    up = np.cross(along, side)
    angle = np.linspace(0, 2 * np.pi, sides, endpoint=False)
    rings = line[:, None] + radius * (
        np.cos(angle)[None, :, None] * side[:, None] + np.sin(angle)[None, :, None] * up[:, None]
    )
    skin = woven(rings, close_columns=True)
    count = len(skin.vertices)
    caps = []
    for centre, first, turn in ((count, 0, 1), (count + 1, count - sides, -1)):
        ring = first + np.arange(sides)
        caps.append(np.stack([np.full(sides, centre), np.roll(ring, -1), ring], 1)[:, ::turn])
    faces = np.concatenate([skin.faces, *caps]).astype(np.int32)
    closed = Mesh(np.concatenate([skin.vertices, line[[0, -1]]]), faces)
    return closed if closed.volume_mm3 > 0 else inverted(closed)


def mask() -> Mesh:
    """A bent sheet with two eye holes."""
    bent = sheet(120, 140, 2.0, lambda x, y: 60.0 - (x**2 + y**2) / 120)
    x, y = cells(bent)
    return bent.submesh((np.abs(np.abs(x) - 30) > 13) | (np.abs(y - 15) > 8))


_EYES = ((30.0, 15.0, 50.6), (-30.0, 15.0, 50.6))


def helmet(fineness: int, wall_mm: float = 0.4) -> Mesh:
    """Two skins a paper's width apart, rims open, as image-to-mesh models make them."""
    double = concatenate([ball(60.0, fineness), inverted(ball(60.0 - wall_mm, fineness))])
    return double.submesh(double.corners[:, :, 2].mean(1) > -15)


def relief(fineness: int) -> Mesh:
    """A thick ball with waves on it."""
    smooth = ball(30.0, fineness)
    unit = smooth.vertices / 30.0
    waves = np.sin(9 * unit[:, 0]) * np.sin(11 * unit[:, 1]) * np.sin(7 * unit[:, 2])
    return smooth.with_vertices(unit * (30 + 1.2 * waves)[:, None])


def chain(links: int, gap_mm: float) -> Mesh:
    """Interlinked rings, every other one upright, `gap_mm` between neighbours' tubes."""
    radius, tube_mm = 8.0, 1.2
    step = 2 * radius - 2 * tube_mm - gap_mm
    flat, upright = torus(radius, tube_mm, 48, 16), turned(torus(radius, tube_mm, 48, 16), (1, 0, 0), 90)
    return concatenate([moved((flat, upright)[k % 2], k * step, 0, 0) for k in range(links)])


def cut(one: Mesh, *others: Mesh, how: str = "difference") -> Mesh:
    shapes = [trimesh.Trimesh(np.array(m.vertices), np.array(m.faces), process=False) for m in (one, *others)]
    return mesh_of(getattr(trimesh.boolean, how)(shapes, engine="manifold"))


def hook() -> Mesh:
    """A bent wire of 0.8 mm with a straight shank."""
    angle = np.linspace(0, 1.5 * np.pi, 60)
    bend = np.stack([8 * np.cos(angle), 8 * np.sin(angle), 0 * angle], 1)
    shank = np.stack([np.full(20, 8.0), np.linspace(-30, -1, 20), np.zeros(20)], 1)
    return tube(np.concatenate([shank, bend]), 0.4)


def moebius() -> Mesh:
    angle, across = np.meshgrid(np.linspace(0, 2 * np.pi, 121), np.linspace(-6, 6, 13), indexing="ij")
    radius = 25 + across * np.cos(angle / 2)
    return woven(np.stack([radius * np.cos(angle), radius * np.sin(angle), across * np.sin(angle / 2)], 2))


def crossed() -> Mesh:
    """A strip whose section is an eight: it passes through itself."""
    angle, along = np.meshgrid(np.linspace(0, 2 * np.pi, 81), np.linspace(-15, 15, 16), indexing="ij")
    return woven(np.stack([20 * np.sin(angle), 12 * np.sin(2 * angle), along], 2))


def helix() -> Mesh:
    """A coil whose turns run into each other."""
    angle = np.linspace(0, 6 * np.pi, 160)
    return tube(np.stack([12 * np.cos(angle), 12 * np.sin(angle), 3.0 * angle / (2 * np.pi)], 1), 2.0)


def lattice() -> Mesh:
    """A cube of struts of 0.7 mm, each a body of its own."""
    places = (-10.0, 0.0, 10.0)
    along = [moved(box(20.7, 0.7, 0.7), 0, a, b) for a in places for b in places]
    along += [moved(box(0.7, 20.7, 0.7), a, 0, b) for a in places for b in places]
    along += [moved(box(0.7, 0.7, 20.7), a, b, 0) for a in places for b in places]
    return concatenate(along)


def t_junctions() -> Mesh:
    """A box whose top is finer than its sides: every finer vertex lies on a coarser edge."""
    whole, fine = box(20, 20, 20), mesh_of(trimesh.creation.box((20, 20, 20)).subdivide().subdivide())
    top = whole.corners[:, :, 2].min(1) > 9.9
    return concatenate([whole.submesh(~top), fine.submesh(fine.corners[:, :, 2].min(1) > 9.9)])


def needles() -> Mesh:
    """A cylinder in slivers, with faces that have no area."""
    shape = rod(8.0, 40.0, 720)
    flat = np.array([[0, 0, 1], [2, 3, 3]], dtype=np.int32)
    return Mesh(shape.vertices, np.concatenate([shape.faces, flat]))


def fin() -> Mesh:
    """A block with a face standing on one of its edges."""
    block = box(20, 20, 10)
    top = block.corners.reshape(-1, 3)
    edge = np.flatnonzero((block.vertices[:, 2] > 0) & (block.vertices[:, 0] > 0))
    count = len(block.vertices)
    raised = block.vertices[edge] + [0.0, 0.0, 12.0]
    assert len(top) and len(edge) == 2
    faces = np.array([[edge[0], edge[1], count + 1], [edge[0], count + 1, count]], dtype=np.int32)
    return Mesh(np.concatenate([block.vertices, raised]), np.concatenate([block.faces, faces]))


def divided() -> Mesh:
    """A box with a wall inside that shares its edges: an edge of three faces all round."""
    left, right = moved(box(10, 20, 20), -5, 0, 0), moved(box(10, 20, 20), 5, 0, 0)
    both = concatenate([left, right])
    _, index = np.unique(both.vertices.round(9), axis=0, return_inverse=True)
    points = np.zeros((int(index.max()) + 1, 3))
    points[index.reshape(-1)] = both.vertices
    faces = index.reshape(-1)[both.faces].astype(np.int32)
    _, single = np.unique(np.sort(faces, 1), axis=0, return_index=True)
    return Mesh(points, faces[np.sort(single)])


def glasses() -> Mesh:
    """Rims, bridge and temples run through each other, lenses are open discs, a tenth of the faces is flipped."""
    rims = [moved(torus(22, 2.0, 64, 16), side * 30.0, 0, 0) for side in (-1, 1)]
    disc = sheet(60, 60, 2.0, lambda x, y: 0 * x)
    lens = disc.submesh(np.linalg.norm(disc.corners.mean(1), axis=1) < 21.5)
    rest = [box(20, 4, 4)] + [moved(box(4, 4, 100), side * 53.0, 0, -50) for side in (-1, 1)]
    return flipped(concatenate([*rims, *(moved(lens, side * 30.0, 0, 0) for side in (-1, 1)), *rest]), 0.1)


def spikes() -> Mesh:
    cone = mesh_of(trimesh.creation.cone(2.0, 15.0, sections=32))
    turns = [((1, 0, 0), 0), ((1, 0, 0), 90), ((1, 0, 0), 180), ((1, 0, 0), 270), ((0, 1, 0), 90)]
    return concatenate([ball(8.0), *(turned(moved(cone, 0, 0, 6.5), axis, angle) for axis, angle in turns)])


def crumbs() -> Mesh:
    """A cube and fifty specks beside it."""
    places = np.random.default_rng(1).uniform(15, 30, (50, 3))
    return concatenate([box(20, 20, 20), *(moved(box(0.2, 0.2, 0.2), *place) for place in places)])


def slotted() -> Mesh:
    return cut(box(30, 20, 20), moved(box(0.3, 30, 16), 0, 0, 4))


def head() -> Mesh:
    return ball(1.0, 5).transformed(np.diag([58.0, 60.0, 61.0, 1.0]))


def plate_with_holes() -> Mesh:
    flat = sheet(60, 40, 1.0, lambda x, y: 0 * x)
    x, y = cells(flat)
    return flat.submesh((np.hypot(x - 20, y) > 2.5) & (np.hypot(x + 20, y) > 2.5))


def all_nasty() -> dict[str, Callable[[], Nasty]]:
    """Every case by name; called when wanted."""
    both = lambda mesh: Mesh(mesh.vertices, np.concatenate([mesh.faces, mesh.faces[:, ::-1]]))  # noqa: E731
    bore = ((0.0, 0.0, 0.0), (8.0, 0.0, 0.0))
    return {
        "cube": lambda: Nasty(box(20, 20, 20), truth=box(20, 20, 20)),
        "relief ball 20k": lambda: Nasty(relief(5), truth=relief(5)),
        "relief ball 82k": lambda: Nasty(relief(6), truth=relief(6)),
        "sheet with two holes": lambda: Nasty(
            plate_with_holes(), genus=2, empty=((20.0, 0.0, 0.0), (-20.0, 0.0, 0.0))
        ),
        "mask": lambda: Nasty(mask(), genus=2, empty=_EYES),
        "mask, both sides": lambda: Nasty(both(mask()), genus=2, empty=_EYES),
        "mask on a head": lambda: Nasty(mask(), genus=2, empty=_EYES, body=head()),
        "open bowl": lambda: Nasty(
            ball(20.0).submesh(ball(20.0).corners[:, :, 2].mean(1) > 0), empty=((0.0, 0.0, 10.0),)
        ),
        "overlapping parts": lambda: Nasty(
            concatenate([box(20, 20, 20), moved(box(20, 20, 20), 11, 3, 2), moved(ball(9), -10, 5, 5)]),
            truth=cut(
                box(20, 20, 20), moved(box(20, 20, 20), 11, 3, 2), moved(ball(9), -10, 5, 5), how="union"
            ),
        ),
        "glasses": lambda: Nasty(glasses(), genus=None),
        "double shell 0.4": lambda: Nasty(
            concatenate([ball(20.0), inverted(ball(19.6))]), genus=None, empty=((0.0, 0.0, 0.0),)
        ),
        "double helmet 8k": lambda: Nasty(helmet(5), empty=((0.0, 0.0, 0.0), (0.0, 0.0, 40.0))),
        "double helmet 100k": lambda: Nasty(helmet(6), empty=((0.0, 0.0, 0.0), (0.0, 0.0, 40.0))),
        "a third flipped": lambda: Nasty(flipped(torus(), 0.33), genus=1, truth=torus(), empty=bore),
        "inside out": lambda: Nasty(inverted(torus()), genus=1, truth=torus(), empty=bore),
        "soup": lambda: Nasty(soup(torus()), genus=1, truth=torus(), empty=bore),
        "soup, noise 0.02": lambda: Nasty(soup(torus(), 0.02), genus=1, truth=torus(), empty=bore),
        "soup, noise and holes": lambda: Nasty(soup(torus(), 0.02, 0.01), genus=1, truth=torus(), empty=bore),
        "soup, noise 0.15": lambda: Nasty(soup(torus(), 0.15, 0.01), genus=1, empty=bore),
        "soup of a mask": lambda: Nasty(soup(mask(), 0.02), genus=2, empty=_EYES),
        "chain, gaps 0.4": lambda: Nasty(chain(8, 0.4), parts=8, genus=8, truth=chain(8, 0.4)),
        "chain as soup": lambda: Nasty(soup(chain(4, 0.4)), parts=4, genus=4, truth=chain(4, 0.4)),
        "every face twice": lambda: Nasty(
            Mesh(torus().vertices, np.concatenate([torus().faces] * 2)), genus=1, truth=torus(), empty=bore
        ),
        "every face both ways": lambda: Nasty(both(torus()), genus=1, truth=torus(), empty=bore),
        "T-junctions": lambda: Nasty(t_junctions(), truth=box(20, 20, 20), full=((0.0, 0.0, 0.0),)),
        "needle faces": lambda: Nasty(needles(), truth=rod(8.0, 40.0, 720)),
        "two boxes on one edge": lambda: Nasty(
            concatenate([box(10, 10, 10), moved(box(10, 10, 10), 10, 10, 0)]), parts=None, genus=None
        ),
        "a fin on an edge": lambda: Nasty(fin(), full=((0.0, 0.0, 0.0), (10.0, 0.0, 10.0))),
        "an inner wall": lambda: Nasty(
            divided(), truth=box(20, 20, 20), full=((5.0, 0.0, 0.0), (-5.0, 0.0, 0.0))
        ),
        "boxes on one face": lambda: Nasty(
            concatenate([box(10, 20, 20), moved(box(10, 20, 20), 10, 0, 0)]),
            full=((5.0, 0.0, 0.0),),
            truth=moved(box(20, 20, 20), 5, 0, 0),
        ),
        "gap 0.3": lambda: Nasty(
            concatenate([box(20, 20, 20), moved(box(20, 20, 20), 20.3, 0, 0)]),
            parts=2,
            empty=((10.15, 0.0, 0.0),),
            truth=concatenate([box(20, 20, 20), moved(box(20, 20, 20), 20.3, 0, 0)]),
        ),
        "slot 0.3": lambda: Nasty(slotted(), truth=slotted(), empty=((0.0, 0.0, 5.0), (0.0, 0.0, -3.0))),
        "thin ring": lambda: Nasty(
            cut(rod(10.5, 6.0, 128), rod(10.0, 8.0, 128)), genus=1, empty=((0.0, 0.0, 0.0), (9.0, 0.0, 0.0))
        ),
        "crossed strip": lambda: Nasty(crossed(), genus=2),
        "paper-thin plate": lambda: Nasty(box(40, 30, 0.05), full=((0.0, 0.0, 0.0),)),
        "flat on itself": lambda: Nasty(box(40, 30, 1.0).transformed(np.diag([1, 1, 0, 1.0]))),
        "nested cavities": lambda: Nasty(
            concatenate([ball(20), inverted(ball(14)), ball(8)]),
            parts=2,
            genus=None,
            empty=((11.0, 0.0, 0.0),),
        ),
        "knife edge": lambda: Nasty(
            Mesh(
                np.array(
                    [[0, 0, 0], [30, 0, -3], [30, 0, 3], [0, 20, 0], [30, 20, -3], [30, 20, 3]],
                    dtype=np.float64,
                ),
                np.array(
                    [[0, 1, 2], [3, 5, 4], [0, 3, 4], [0, 4, 1], [1, 4, 5], [1, 5, 2], [2, 5, 3], [2, 3, 0]],
                    dtype=np.int32,
                ),
            )
        ),
        "hook": lambda: Nasty(hook()),
        "rod 0.5 x 150": lambda: Nasty(rod(0.25, 150.0)),
        "Moebius strip": lambda: Nasty(moebius(), genus=1),
        "coil through itself": lambda: Nasty(helix(), genus=None),
        "lattice of struts": lambda: Nasty(lattice(), genus=28),
        "spikes": lambda: Nasty(spikes()),
        "pinhole": lambda: Nasty(
            ball(20).submesh(np.arange(1, len(ball(20).faces))), truth=ball(20), full=((0.0, 0.0, 0.0),)
        ),
        "crumbs": lambda: Nasty(crumbs(), truth=box(20, 20, 20)),
        "far away": lambda: Nasty(
            moved(torus(), 5e4, 5e4, 5e4),
            genus=1,
            truth=moved(torus(), 5e4, 5e4, 5e4),
            empty=((5e4, 5e4, 5e4),),
        ),
        "balls that touch": lambda: Nasty(concatenate([ball(10), moved(ball(10), 20, 0, 0)]), parts=None),
        "one triangle": lambda: Nasty(
            Mesh(np.array([[0.0, 0, 0], [20, 0, 0], [0, 20, 0]]), np.array([[0, 1, 2]], dtype=np.int32))
        ),
        "solid into a head": lambda: Nasty(torus(62, 5, 96, 24), genus=1, body=head()),
    }
