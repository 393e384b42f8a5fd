"""Random and damaged meshes, each with the ground that it draws: what `read_building` must measure or refuse."""

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import meshio
import numpy as np
import shapely

Corners = np.ndarray  # (3, 3) or (4, 3) float64 [m]


@dataclass
class RandomMesh:
    """Cells as they are written to a file, every one with its own corners."""

    kind: str
    cells: list[Corners] = field(default_factory=list)
    #: What each cell belongs to: cells of one part draw the same ground, those of two do not.
    parts: list[str] = field(default_factory=list)
    #: Coordinates are written as float32, in a VTU file, or with so many significant digits.
    is_single: bool = False
    digits: int | None = None

    def add(self, part: str, *cells: Corners) -> None:
        self.cells += [np.asarray(cell, dtype=float) for cell in cells]
        self.parts += [part] * len(cells)

    def move(self, shift: Callable[[np.ndarray], np.ndarray]) -> None:
        self.cells = [shift(cell) for cell in self.cells]

    def written(self) -> list[Corners]:
        """Return the cells with the coordinates that the file holds."""
        if self.is_single:
            return [cell.astype(np.float32).astype(float) for cell in self.cells]
        if self.digits is not None:
            return [
                np.array([[float(f"{x:.{self.digits}g}") for x in corner] for corner in cell]) for cell in self.cells
            ]
        return self.cells

    def area(self) -> float:
        """Return the ground [m2] that can be walked on, by shapely and a slope of its own."""
        ground: dict[str, list[shapely.Polygon]] = {}
        for cell, part in zip(self.written(), self.parts, strict=True):
            for corners in (cell[[0, i, i + 1]] for i in range(1, len(cell) - 1)):
                plan = shapely.Polygon(corners[:, :2])
                normal = np.cross(corners[1] - corners[0], corners[2] - corners[0])
                true_area = 0.5 * float(np.linalg.norm(normal))
                if true_area > 0.0 and plan.area >= np.cos(np.radians(50.0)) * true_area:
                    ground.setdefault(part, []).append(plan)
        return sum(float(shapely.union_all(plans, grid_size=1e-7).area) for plans in ground.values())

    def write(self, folder: Path) -> Path:
        """Write an OBJ file, or a VTU file of float32; equal corners share a vertex."""
        points: dict[tuple[float, ...], int] = {}
        faces = [[points.setdefault(tuple(corner), len(points)) for corner in cell.tolist()] for cell in self.written()]
        if not self.is_single:
            path = folder / "mesh.obj"
            lines = ["v " + " ".join(map(repr, point)) for point in points]
            lines += ["f " + " ".join(str(corner + 1) for corner in face) for face in faces]
            path.write_text("\n".join(lines) + "\n")
            return path
        path = folder / "mesh.vtu"
        blocks = [("triangle" if len(face) == 3 else "quad", [face]) for face in faces]
        meshio.write(path, meshio.Mesh(np.array(list(points), np.float32), blocks))
        return path


def random_mesh(seed: int) -> RandomMesh:
    """Return a mesh of the kind whose turn it is."""
    rng = np.random.default_rng(seed)
    kind, make = list(KINDS.items())[seed % len(KINDS)]
    mesh = make(rng)
    mesh.kind = kind
    if rng.random() < 0.5:
        angle, offset = rng.uniform(0.0, 2.0 * np.pi), rng.uniform(-100.0, 100.0, 3)
        turn = np.array([[np.cos(angle), -np.sin(angle), 0.0], [np.sin(angle), np.cos(angle), 0.0], [0.0, 0.0, 1.0]])
        mesh.move(lambda cell: cell @ turn.T + offset)
    if kind.startswith("far"):
        far = 10.0 ** rng.uniform(3.0, 6.7, 2)
        mesh.move(lambda cell: cell + np.append(far, 0.0))
    _shuffle(rng, mesh)
    return mesh


def _shuffle(rng: np.random.Generator, mesh: RandomMesh) -> None:
    """Change order, first corner and winding of the cells."""
    order = rng.permutation(len(mesh.cells))
    mesh.parts = [mesh.parts[row] for row in order]
    cells = [np.roll(mesh.cells[row], rng.integers(3), axis=0) for row in order]
    mesh.cells = [cell[::-1] if rng.random() < 0.5 else cell for cell in cells]


def _rectangles(rng: np.random.Generator, width: float, depth: float, cuts: int) -> list[tuple[float, ...]]:
    """Cut a rectangle in two again and again: sides meet in T-junctions."""
    pieces = [(0.0, 0.0, width, depth)]
    for _ in range(cuts):
        x1, y1, x2, y2 = pieces.pop(int(np.argmax([(p[2] - p[0]) * (p[3] - p[1]) for p in pieces])))
        share = rng.uniform(0.25, 0.75)
        if x2 - x1 > y2 - y1:
            x = x1 + share * (x2 - x1)
            pieces += [(x1, y1, x, y2), (x, y1, x2, y2)]
        else:
            y = y1 + share * (y2 - y1)
            pieces += [(x1, y1, x2, y), (x1, y, x2, y2)]
    return pieces


def _rectangle(x1: float, y1: float, x2: float, y2: float, z1: float = 0.0, z2: float | None = None) -> Corners:
    """Return a quad that rises from z1 at x1 to z2 at x2."""
    z2 = z1 if z2 is None else z2
    return np.array([[x1, y1, z1], [x2, y1, z2], [x2, y2, z2], [x1, y2, z1]])


def _triangles(cell: Corners) -> list[Corners]:
    return [cell[[0, 1, 2]], cell[[0, 2, 3]]]


def _plan(rng: np.random.Generator, mesh: RandomMesh, part: str = "floor", z: float = 0.0) -> RandomMesh:
    """Add a floor of rectangles, some left out."""
    pieces = _rectangles(rng, rng.uniform(6.0, 20.0), rng.uniform(6.0, 20.0), int(rng.integers(2, 14)))
    for row in np.flatnonzero(rng.random(len(pieces)) < 0.85):
        quad = _rectangle(*pieces[row], z)
        mesh.add(part, *(_triangles(quad) if rng.random() < 0.5 else [quad]))
    return mesh if mesh.cells else _plan(rng, mesh, part, z)


def _delaunay(rng: np.random.Generator) -> RandomMesh:
    """Return a conforming triangulation of random points."""
    from scipy.spatial import Delaunay

    mesh = RandomMesh("")
    points = rng.uniform(0.0, 15.0, (int(rng.integers(8, 60)), 2))
    triangles = Delaunay(points).simplices
    keep = rng.random(len(triangles)) < rng.choice([0.8, 1.0])
    space = np.column_stack([points, np.zeros(len(points))])
    mesh.add("floor", *space[triangles[keep] if keep.any() else triangles])
    return mesh


def _soup(rng: np.random.Generator) -> RandomMesh:
    """Return triangles anywhere on one plane."""
    mesh = RandomMesh("")
    centre = rng.uniform(0.0, 10.0 * np.sqrt(number := int(rng.integers(2, 12))), (number, 1, 2))
    plan = centre + rng.uniform(-2.0, 2.0, (number, 3, 2))
    mesh.add("floor", *np.concatenate([plan, np.zeros((number, 3, 1))], axis=2))
    return mesh


def _soup_in_space(rng: np.random.Generator) -> RandomMesh:
    """Return triangles anywhere in space, all of them level or each at a slope of its own."""
    mesh = RandomMesh("")
    is_level = rng.random() < 0.7
    for number in range(int(rng.integers(2, 12))):
        cell = rng.uniform(0.0, 1.0, (3, 3)) * [6.0, 6.0, 3.0] + rng.uniform(0.0, 1.0, 3) * [20.0, 20.0, 15.0]
        if is_level:
            cell[:, 2] = cell[0, 2]
        mesh.add(f"cell {number}", cell)
    return mesh


def _slivers(rng: np.random.Generator) -> RandomMesh:
    """Return a floor with thin cells in between: on seams, on the outline, anywhere."""
    mesh = _plan(rng, RandomMesh(""))
    for _ in range(int(rng.integers(1, 6))):
        cell = mesh.cells[rng.integers(len(mesh.cells))]
        a, b = cell[0], cell[1]
        off = 10.0 ** rng.uniform(-5.0, -1.5)
        normal = np.array([b[1] - a[1], a[0] - b[0], 0.0]) / np.linalg.norm(b - a)
        mesh.add("floor", np.array([a, b, a + rng.uniform(-0.2, 1.2) * (b - a) + rng.choice([-1, 1]) * off * normal]))
    return mesh


def _near_pair(rng: np.random.Generator) -> RandomMesh:
    """Return thin triangles with sides that nearly coincide."""
    mesh = RandomMesh("")
    a, b = np.array([0.0, 0.0, 0.0]), np.append(rng.uniform(5.0, 20.0, 2), 0.0)
    for _ in range(int(rng.integers(2, 5))):
        c = rng.choice([a, b]) + np.append(rng.normal(0.0, 10.0 ** rng.uniform(-3.0, 1.0), 2), 0.0)
        jitter = rng.normal(0.0, 10.0 ** rng.uniform(-4.5, -2.0), (3, 3)) * [1.0, 1.0, 0.3]
        mesh.add("floor", np.array([a, b, c]) + jitter)
    return mesh


def _fan(rng: np.random.Generator) -> RandomMesh:
    """Return a fan of many thin triangles about one point, as of a finely divided arc."""
    mesh = RandomMesh("")
    radius, count = rng.uniform(0.5, 10.0), int(10.0 ** rng.uniform(0.8, 3.3))
    angle = np.linspace(0.0, rng.uniform(0.5, 2.0 * np.pi), count)
    rim = radius * np.column_stack([np.cos(angle), np.sin(angle), np.zeros(count)])
    mesh.add("floor", *(np.array([np.zeros(3), rim[i], rim[i + 1]]) for i in range(count - 1)))
    return mesh


def _strips(rng: np.random.Generator) -> RandomMesh:
    """Return a floor cut into strips about as wide as the weld."""
    mesh = RandomMesh("")
    width, depth = 10.0 ** rng.uniform(-4.0, -1.0), rng.uniform(1.0, 5.0)
    for number in range(int(rng.integers(20, 300))):
        mesh.add("floor", *_triangles(_rectangle(number * width, 0.0, (number + 1) * width, depth)))
    return mesh


def _duplicates(rng: np.random.Generator) -> RandomMesh:
    """Return a floor with cells written twice, as they are or cut otherwise."""
    mesh = _plan(rng, RandomMesh(""))
    for row in rng.integers(len(mesh.cells), size=int(rng.integers(1, 4))):
        cell = mesh.cells[row]
        other = rng.random()
        mesh.add("floor", *(_triangles(np.roll(cell, 1, axis=0)) if len(cell) == 4 and other < 0.3 else [cell]))
    return mesh


def _without_extent(rng: np.random.Generator) -> RandomMesh:
    """Return a floor with cells of no area: repeated corners, three in a row."""
    mesh = _plan(rng, RandomMesh(""))
    for row in rng.integers(len(mesh.cells), size=int(rng.integers(1, 6))):
        a, b = mesh.cells[row][:2]
        mesh.add("floor", np.array([a, b, rng.choice([a, b, a + rng.random() * (b - a)])]))
    return mesh


def _jitter(rng: np.random.Generator) -> RandomMesh:
    """Return a floor whose cells do not quite share their corners, from far below the weld to far above."""
    mesh = _plan(rng, RandomMesh("")) if rng.random() < 0.5 else _delaunay(rng)
    size = 10.0 ** rng.uniform(-6.0, -1.5)
    mesh.move(lambda cell: cell + size * rng.uniform(-1.0, 1.0, cell.shape) * [1.0, 1.0, 0.2])
    return mesh


def _folded(rng: np.random.Generator) -> RandomMesh:
    """Return a triangulation one of whose vertices was moved far off, so that cells fold over others."""
    mesh = _delaunay(rng)
    cell = mesh.cells[rng.integers(len(mesh.cells))]
    moved, to = cell[0].copy(), cell[0] + np.append(rng.normal(0.0, 3.0, 2), rng.choice([0.0, 0.3]))
    mesh.move(lambda cell: np.where((cell == moved).all(axis=1)[:, None], to, cell))
    return mesh


def _storeys(rng: np.random.Generator) -> RandomMesh:
    """Return floors over each other with straight stairs between them, walls among the cells."""
    mesh = RandomMesh("")
    height, width, depth = rng.uniform(2.5, 4.0), rng.uniform(8.0, 15.0), rng.uniform(4.0, 8.0)
    run, wide = rng.uniform(1.3, 2.0) * height, rng.uniform(1.2, 2.0)
    count, way = int(rng.integers(2, 5)), rng.choice([0.0, 1.2])
    for storey in range(count):
        z = storey * height
        # The floor, beyond the well of the stairs the landings that they start and end on, and perhaps a way beside it.
        mesh.add(f"floor {storey}", *(_rectangle(*piece, z) for piece in _rectangles(rng, width, depth, 4)))
        mesh.add(f"floor {storey}", _rectangle(width + run, 0.0, width + run + 2.0, 2.0 * wide + way, z))
        if storey == 0 or way:
            beside = (0.0, wide) if storey == 0 else (2.0 * wide, 2.0 * wide + way)
            mesh.add(f"floor {storey}", _rectangle(width, beside[0], width + run, beside[1], z))
        if storey < count - 1:
            y = wide * (1 - storey % 2)
            ends = (z, z + height) if storey % 2 == 0 else (z + height, z)
            mesh.add(f"stair {storey}", _rectangle(width, y, width + run, y + wide, *ends))
        if rng.random() < 0.5:
            mesh.add("walls", np.array([[0, 0, z], [width, 0, z], [width, 0, z + height], [0, 0, z + height]]))
    return mesh


def _damaged_storeys(rng: np.random.Generator) -> RandomMesh:
    """Return such a building with jitter, missing cells or a cell moved."""
    mesh = _storeys(rng)
    size = 10.0 ** rng.uniform(-5.0, -2.0)
    if rng.random() < 0.7:
        mesh.move(lambda cell: cell + size * rng.uniform(-1.0, 1.0, cell.shape))
    if rng.random() < 0.5:
        row = int(rng.integers(len(mesh.cells)))
        del mesh.cells[row], mesh.parts[row]
    if rng.random() < 0.3:
        row = int(rng.integers(len(mesh.cells)))
        mesh.cells[row], mesh.parts[row] = mesh.cells[row] + rng.normal(0.0, 0.5, 3), "moved"
    return mesh


def _far_single(rng: np.random.Generator) -> RandomMesh:
    """Return a floor to be written as float32 far from the origin."""
    mesh = _plan(rng, RandomMesh(""))
    mesh.is_single = True
    return mesh


def _far_digits(rng: np.random.Generator) -> RandomMesh:
    """Return a floor to be written with few digits far from the origin."""
    mesh = _plan(rng, RandomMesh(""))
    mesh.digits = int(rng.integers(6, 8))
    return mesh


def _with_gaps(rng: np.random.Generator) -> RandomMesh:
    """Return a floor whose cells shrink away from each other, from far below the weld to walls between them."""
    mesh = _plan(rng, RandomMesh(""))
    gap = 10.0 ** rng.uniform(-5.0, -0.5)
    mesh.move(lambda cell: cell + gap * np.sign(cell.mean(axis=0) - cell))
    return mesh


#: Every kind of mesh.
KINDS: dict[str, Callable[[np.random.Generator], RandomMesh]] = {
    "plan": lambda rng: _plan(rng, RandomMesh("")),
    "triangulation": _delaunay,
    "soup": _soup,
    "soup in space": _soup_in_space,
    "slivers": _slivers,
    "near pair": _near_pair,
    "fan": _fan,
    "strips": _strips,
    "duplicates": _duplicates,
    "without extent": _without_extent,
    "jitter": _jitter,
    "folded": _folded,
    "storeys": _storeys,
    "damaged storeys": _damaged_storeys,
    "far": lambda rng: _plan(rng, RandomMesh("")),
    "far float32": _far_single,
    "far digits": _far_digits,
    "with gaps": _with_gaps,
}
