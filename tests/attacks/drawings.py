"""Attacks by drawings: DXF files and solid meshes with flaws have the ground that shapely gives, or are refused."""

import random
import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
import shapely

from evac.assembly import read_surface
from evac.building.build import build_building
from evac.building.model import Building
from evac.errors import BuildingError
from evac.registry import BUILTIN_IMPORTERS, Registry
from tests.building.random_plans import plan_shapes

#: Greatest share by which the ground may differ from what shapely gives [1].
AGREES = 1e-3
#: A message of geometry names a place, or says that there is nothing at all.
PLACE = r"\(-?\d+\.\d\d, -?\d+\.\d\d|no polygon with an area|nothing on the layers|enclose nothing"


@dataclass(frozen=True)
class Case:
    """One drawing, which a number determines."""

    kind: str
    seed: int

    def __str__(self) -> str:
        return f"{self.kind}-{self.seed}"


#: What once went wrong.
CRASHERS: tuple[Case, ...] = ()


def cases(number: int, seed: int) -> Iterator[Case]:
    """Yield the crashers, then cases that the seed determines; each kind in turn."""
    yield from CRASHERS
    generator = random.Random(seed)
    for k in range(number):
        yield Case(list(KINDS)[k % len(KINDS)], generator.randrange(10**6))


def run(case: Case, folder: Path) -> str:
    """Read a drawing: its ground is that of shapely, or it is refused with a message that names the file."""
    path, options, expected = KINDS[case.kind](np.random.default_rng(case.seed), folder)
    importer = Registry(builtins=BUILTIN_IMPORTERS).importer_for(path)(**options)
    try:
        building = build_building(read_surface(importer, path), path, need_exit=False)
    except BuildingError as error:
        message = str(error)
    else:
        message = ""
    if message:
        assert path.name in message, message
        assert case.kind in ("truncated", "mutated") or re.search(PLACE, message), message
        return f"{case.kind} refused"
    assert case.kind != "truncated", "a file that is cut off is read"
    if expected is not None:
        ground = sum(float(level.polygon.area) for level in building.levels)
        assert ground == pytest.approx(expected, rel=AGREES, abs=1e-3), (ground, expected, _text(building))
    return f"{case.kind} read"


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
    shapes = [(("walkablearea"), np.array([[0, 0], [8, 0], [8, 5], [0, 5]]) + rng.uniform(0, 9, 2), True)]
    shapes.append(("obstacles", np.array([[9.5, 9.5], [10, 9.5], [10, 10]]), True))
    _write(path, shapes, rng)
    return path.read_bytes()


def _truncated(rng: np.random.Generator, folder: Path) -> tuple[Path, dict, None]:
    """Return a file that ends too early."""
    content = _damaged(rng, folder)
    path = folder / "cut.dxf"
    path.write_bytes(content[: rng.integers(1, len(content) - 8)])
    return path, {"unit": 1.0}, None


def _mutated(rng: np.random.Generator, folder: Path) -> tuple[Path, dict, None]:
    """Return a file some of whose bytes or lines, mostly among its entities, are others."""
    content = _damaged(rng, folder)
    lines = content.splitlines(keepends=True)
    start = next(k for k, line in enumerate(lines) if line.strip() == b"ENTITIES") if rng.random() < 0.7 else 0
    for _ in range(rng.integers(1, 6)):
        k = int(rng.integers(start, len(lines)))
        match rng.integers(5):
            case 0:
                lines.pop(k)
            case 1:
                lines.insert(k, lines[rng.integers(len(lines))])
            case 2:
                lines[k] = bytes(rng.integers(0, 256, 4, dtype=np.uint8)) + b"\n"
            case 3:
                lines[k] = rng.choice(np.array([b"nan\n", b"1e400\n", b"-1\n", b"999999999999\n", b"\n", b"0\n"]))
            case _:
                other = int(rng.integers(start, len(lines)))
                lines[k], lines[other] = lines[other], lines[k]
        start = min(start, len(lines) - 1)
    path = folder / "mutated.dxf"
    path.write_bytes(b"".join(lines))
    return path, {"unit": float(rng.choice([0.0, 1.0]))}, None


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
