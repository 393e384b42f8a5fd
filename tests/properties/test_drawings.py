"""Random drawings: DXF files and solid meshes with flaws have the ground that shapely gives, or are refused."""

import itertools
import re
from pathlib import Path

import numpy as np
import pytest
import shapely

from evac.base.errors import BuildingError
from evac.building.model.building import Building
from evac.building.surface.build import build_building
from evac.contract.registry import Registry, built_in
from evac.simulation.assembly import read_surface
from tests.properties.random_plans import plan_shapes
from tests.properties.seeded import drawn

#: Greatest share by which the ground may differ from what shapely gives [1].
AGREES = 1e-3
#: A message of geometry names a place, or says that there is nothing at all.
PLACE = r"\(-?\d+\.\d\d, -?\d+\.\d\d|no polygon with an area|layers of the floor|enclose nothing"


def check(kind: str, seed: int, folder: Path) -> None:
    """Read a drawing: its ground is that of shapely, or it is refused with a message that names the file."""
    path, options, expected = KINDS[kind](np.random.default_rng(seed), folder)
    importer = Registry(builtins=built_in("importer")).importer_for(path)(**options)
    try:
        building = build_building(read_surface(importer, path), path, need_exit=False)
    except BuildingError as error:
        message = str(error)
    else:
        message = ""
    if message:
        assert path.name in message, message
        assert kind in ("truncated", "mutated") or re.search(PLACE, message), message
        return
    assert kind != "truncated", "a file that is cut off is read"
    if expected is not None:
        ground = sum(float(level.polygon.area) for level in building.levels)
        assert ground == pytest.approx(expected, rel=AGREES, abs=1e-3), (ground, expected, _text(building))


def _text(building: Building) -> str:
    return "; ".join(str(one) for one in building.findings)[:1000]


def _outlines(rng: np.random.Generator, folder: Path) -> tuple[Path, dict, float]:
    """Return closed outlines with flaws, some in a block that is turned and moved, and obstacles."""
    shapes = plan_shapes(rng)
    path = folder / "outlines.dxf"
    corners = [shapely.get_coordinates(one)[:-1] for one in shapes]
    corners = [one for one in corners if len(one) > 2]
    _write(path, [("walkablearea", one, True) for one in corners], rng)
    rings = [shapely.make_valid(shapely.Polygon(one), method="structure", keep_collapsed=False) for one in corners]
    return path, {"unit": 1.0, "obstacles": ""}, float(shapely.union_all(rings).area)


def _lines(rng: np.random.Generator, folder: Path) -> tuple[Path, dict, float | None]:
    """Return the lines of rooms side by side: moved a little, doubled, turned, divided, with spikes, some left out."""
    columns, rows = rng.integers(1, 5, 2)
    x = np.concatenate([[0.0], rng.uniform(3.0, 7.0, columns).cumsum()])
    y = np.concatenate([[0.0], rng.uniform(3.0, 7.0, rows).cumsum()])
    segments = [[(x[i], y[j]), (x[i + 1], y[j])] for i in range(columns) for j in range(rows + 1)]
    segments += [[(x[i], y[j]), (x[i], y[j + 1])] for i in range(columns + 1) for j in range(rows)]
    kept = [one for one in segments if rng.random() > 0.12]
    faces = shapely.polygonize_full([shapely.LineString(one) for one in kept])[0]
    expected = float(shapely.area(faces))
    drawn: list[np.ndarray] = []
    for one in kept:
        ends = np.array(one)
        if rng.random() < 0.2:  # divided by a T-junction that nothing meets
            share = rng.uniform(0.2, 0.8)
            middle = ends[0] + share * (ends[1] - ends[0])
            drawn += [np.array([ends[0], middle]), np.array([middle, ends[1]])]
        else:
            drawn.append(ends)
        if rng.random() < 0.1:
            drawn.append(ends[::-1])
        if rng.random() < 0.1:  # an overshoot
            way = (ends[1] - ends[0]) / np.hypot(*(ends[1] - ends[0]))
            drawn.append(np.array([ends[1], ends[1] + rng.uniform(0.001, 0.08) * way]))
    jitter = float(rng.choice([0.0, 1e-9, 1e-6, 1e-4, 3e-4]))
    moved = [one + rng.normal(0.0, jitter, one.shape) for one in drawn]
    rng.shuffle(moved)
    path = folder / "lines.dxf"
    _write(path, [("walls", one, False) for one in moved], rng)
    options = {"unit": 1.0, "floor": "walls"}
    return path, options, expected if expected > 0.0 else None


def _damaged(rng: np.random.Generator, folder: Path) -> bytes:
    """Return the bytes of a sound drawing."""
    path = folder / "sound.dxf"
    outline = np.array([[0, 0], [8, 0], [8, 5], [0, 5]])
    _write(path, [("walkablearea", outline + rng.uniform(0, 9, 2), True) for _ in range(2)], rng)
    return path.read_bytes()


def _truncated(rng: np.random.Generator, folder: Path) -> tuple[Path, dict, None]:
    """Return a file that ends too early."""
    content = _damaged(rng, folder)
    path = folder / "cut.dxf"
    path.write_bytes(content[: rng.integers(1, len(content) - 8)])
    return path, {"unit": 1.0}, None


def _mutated(rng: np.random.Generator, folder: Path) -> tuple[Path, dict, float | None]:
    """Return a file some of whose tags, mostly among its entities, or some of whose lines, are others."""
    content = _damaged(rng, folder)
    lines = content.decode().splitlines()
    pairs = [lines[k : k + 2] for k in range(0, len(lines) - 1, 2)]
    start = next(k for k, pair in enumerate(pairs) if pair[1] == "ENTITIES") if rng.random() < 0.8 else 0
    for _ in range(rng.integers(1, 5)):
        k = int(rng.integers(start, len(pairs) - 1))
        match rng.integers(6):
            case 0:
                pairs.pop(k)
            case 1:
                pairs.insert(k, pairs[rng.integers(start, len(pairs))])
            case 2:
                pairs[k] = [pairs[k][0], str(rng.choice(np.array(["nan", "1e400", "-1", "7", "1e20", "", "0", "A"])))]
            case 3:
                pairs[k] = [pairs[k][0], bytes(rng.integers(32, 127, 4, dtype=np.uint8)).decode()]
            case 4:
                pairs[k] = [str(rng.integers(-5, 1100)), pairs[k][1]]
            case _:
                other = int(rng.integers(start, len(pairs)))
                pairs[k], pairs[other] = pairs[other], pairs[k]
    text = [line for pair in pairs for line in pair]
    if rng.random() < 0.2:
        text.pop(int(rng.integers(len(text))))
    path = folder / "mutated.dxf"
    path.write_text("\n".join([*text, ""]))
    return path, {"unit": 1.0, "obstacles": ""}, _ground_of(text)


def _ground_of(lines: list[str]) -> float | None:
    """Return the area of the closed polylines in a file, read by the simplest parser; None if it sees anything odd."""
    pairs = list(zip(lines[::2], lines[1::2], strict=False))
    names = [value for _, value in pairs]
    if len(lines) % 2 or names.count("ENTITIES") != 1 or "INSERT" in names:
        return None
    entities: list[list[tuple[int, str]]] = []
    flags: dict[int, str] = {}
    shapes, corners = [], list[tuple[float, float]]()
    try:
        for code, value in pairs[names.index("ENTITIES") + 1 :]:
            if int(code) == 0:
                entities.append([])
            entities[-1].append((int(code), value))
        for entity in entities:
            kind, values = entity[0][1], dict(entity)
            if kind in ("LWPOLYLINE", "VERTEX"):
                corners += [(float(x), float(y)) for (a, x), (b, y) in itertools.pairwise(entity) if (a, b) == (10, 20)]
                if kind == "VERTEX" and [code for code, _ in entity].count(10) != 1:
                    return None
                if 42 in values or 210 in values or 67 in values:
                    return None
            is_end = kind in ("LWPOLYLINE", "SEQEND")
            flags = values if kind in ("LWPOLYLINE", "POLYLINE") else flags
            if kind == "ENDSEC":
                break
            if kind == "POLYLINE" and corners:
                return None
            if is_end:
                if flags.get(8) != "walkablearea" or int(flags.get(70, "0")) != 1 or len(corners) != 4:
                    return None
                shapes.append(shapely.Polygon(corners))
                corners = []
    except (ValueError, IndexError):
        return None
    if corners or not shapes or not all(one.is_valid for one in shapes):
        return None
    return float(shapely.union_all(shapes).area)


def _bodies(rng: np.random.Generator, folder: Path) -> tuple[Path, dict, float]:
    """Return a slab with bodies that stand on it, as an OBJ file: windings turned, cells doubled, sides divided."""
    width, depth, thick = rng.uniform(6.0, 20.0), rng.uniform(6.0, 20.0), rng.uniform(0.1, 0.5)
    boxes = [(0.0, 0.0, -thick, width, depth, 0.0)]
    ground = shapely.box(0.0, 0.0, width, depth)
    for _ in range(rng.integers(0, 6)):
        x, y = rng.uniform(0.5, width - 1.5), rng.uniform(0.5, depth - 1.5)
        size, high = rng.uniform(0.1, 0.5, 2), rng.uniform(0.3, 3.0)
        standing = shapely.box(x, y, x + size[0], y + size[1])
        if ground.buffer(-0.05).contains(standing):
            boxes.append((x, y, 0.0, x + size[0], y + size[1], high))
            ground = ground.difference(standing)
    lines: list[str] = []
    count = 0
    for x1, y1, z1, x2, y2, z2 in boxes:
        corners = [[x, y, z] for z in (z1, z2) for y in (y1, y2) for x in (x1, x2)]
        faces = [[0, 1, 3, 2], [4, 5, 7, 6], [0, 1, 5, 4], [2, 3, 7, 6], [0, 2, 6, 4], [1, 3, 7, 5]]
        lines += ["v " + " ".join(repr(float(value)) for value in corner) for corner in corners]
        for face in (face[::-1] if rng.random() < 0.5 else face for face in faces):
            own = [corner + count + 1 for corner in face]
            pieces = [own] if rng.random() < 0.5 else [own[:3], [own[0], own[2], own[3]]]
            for piece in pieces * (2 if rng.random() < 0.1 else 1):
                lines.append("f " + " ".join(map(str, piece)))
        count += 8
    path = folder / "bodies.obj"
    path.write_text("\n".join(lines) + "\n")
    return path, {}, float(ground.area)


def _write(path: Path, lines: list[tuple[str, np.ndarray, bool]], rng: np.random.Generator) -> None:
    """Write polylines on layers to a DXF file, one in four in a block of its own."""
    import ezdxf

    document = ezdxf.new(rng.choice(["R12", "R2000", "R2013"]))
    space = document.modelspace()
    for number, (layer, corners, is_closed) in enumerate(lines):
        target, points = space, corners
        if rng.random() < 0.25:
            target, points = document.blocks.new(f"block{number}"), corners - corners[0]
            space.add_blockref(f"block{number}", corners[0], dxfattribs={"layer": layer})
        attributes = {"layer": "0" if target is not space else layer}
        if document.dxfversion == "AC1009":
            target.add_polyline2d(points.tolist(), close=is_closed, dxfattribs=attributes)
        else:
            target.add_lwpolyline(points.tolist(), close=is_closed, dxfattribs=attributes)
    document.saveas(path)


KINDS = {"outlines": _outlines, "lines": _lines, "truncated": _truncated, "mutated": _mutated, "bodies": _bodies}


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("kind", KINDS)
@drawn(5)
def test_a_drawing_has_the_ground_that_shapely_gives_or_is_refused_with_a_place(kind, seed, tmp_path_factory):
    check(kind, seed, tmp_path_factory.mktemp("drawing"))
