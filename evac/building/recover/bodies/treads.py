"""Convert the faces of stairs and ramps to runs of treads, with the edges of their flights, and landings."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import NamedTuple

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from evac.base.arrays import FloatArray
from evac.building.geometry import cut, united
from evac.building.plan.outlines import normal
from evac.building.recover.bodies.body import LEVEL, Body, closed, in_plan
from evac.building.surface.foreign import chains, direction_of

#: Minimum area [m2] and depth [m] of a tread.
LEAST_TREAD, LEAST_DEPTH = 0.05, 0.1
#: Nobody can step on a face with less clear height than this above it [m].
CLEAR = 1.8
#: A face larger than the median tread by this factor is a landing.
LANDING = 2.2
#: Minimum depth of a landing between flights in one direction; a shorter one is treated as a deep tread [m].
SHORT = 1.0
#: A tread of a winding flight is walked on where its depth is at least this and its riser, so at most 45 degrees [m].
LEAST_GOING = 0.15
#: Distances tried in turn within which consecutive treads meet [m].
MEET = (0.002, 0.03, 0.11)
#: Least length of the edge along which they meet [m].
LEAST_EDGE = 0.1
#: Least length of the treads of a stair that winds, and the width that people need in single file [m].
SHORTEST, SINGLE_FILE = 0.55, 0.5
#: Steps by which edges are shortened at their inner ends [m].
TRIM = 0.01
#: Cosine of the slope of the steepest inclined face that is walked on.
STEEPEST = float(np.cos(np.radians(50.0)))
#: Least width and length of an inclined face [m].
LEAST_SIDE = 0.5


class Landing(NamedTuple):
    """A level face of a stair: a landing, or a tread."""

    plan: BaseGeometry
    z: float


@dataclass(frozen=True)
class Run:
    """Consecutive treads, or an inclined face."""

    names: tuple[str, ...]  # names of the bodies that the treads belong to
    # list of (polygon, float [m]): plan and height of each tread, from bottom to top; both ends of an inclined face
    treads: list[Landing]
    edges: FloatArray  # (e, 2, 2) float64 [m]: front edge of each tread and back edge of the last one, right end first
    riser: float  # [m]; 0 for an inclined face
    winds: bool = False  # whether its treads turn
    width: float = np.inf  # if they do, their least width where they are deep enough [m]

    @property
    def place(self) -> tuple[float, float]:
        """Where it is, for findings [m]."""
        x, y = self.treads[len(self.treads) // 2][0].centroid.coords[0]
        return x, y


@dataclass
class Treads:
    """Parts of stairs: runs, landings, short landings within runs, and bodies without any of them."""

    runs: list[Run] = field(default_factory=list)
    landings: list[Landing] = field(default_factory=list)
    short: list[Landing] = field(default_factory=list)
    bare: list[Body] = field(default_factory=list)


def treads_of(bodies: Sequence[Body]) -> Treads:
    """Find runs and landings in bodies that are whole stairs, flights or landings."""
    treads = Treads()
    for body in bodies:
        faces = _faces(body)
        if body.kind == "landing":
            treads.landings += faces[-1:]
            continue
        usual = float(np.median([plan.area for plan, _ in faces])) if faces else 0.0
        landings = [face for face in faces if len(faces) > 2 and face[0].area > LANDING * usual]
        short = [face for face in landings if _depth(face[0]) < SHORT]
        rows = _rows([face for face in faces if face not in landings or face in short])
        if any(len(chain) > 1 and _run(body.name, chain).winds for chain in rows):
            short = []
            rows = _rows([face for face in faces if face not in landings])
        treads.short += short
        treads.landings += [face for face in landings if face not in short]
        made = [_run(body.name, chain) for chain in rows if len(chain) > 1]
        if not made:
            made = [
                Run((body.name,), [Landing(plan, z) for z in heights], edges, 0.0)
                for plan, edges, heights in _inclined_faces(body)
            ]
            treads.landings += [face for face in faces if made and face not in landings]
        treads.runs += made
        treads.bare += [] if made else [body]
    return treads


def _faces(body: Body) -> list[Landing]:
    """Return the level faces of a stair that people can step on, from bottom to top; nosings belong to their treads."""
    # What is below another face, such as the steps of a stringer on which treads lie, is no part of them.
    faces: list[Landing] = []
    tops = [(closed(plan, 0.02), z) for plan, z in body.tops]
    for row, (plan, z) in enumerate(tops):
        over = [higher for higher, top in tops[row + 1 :] if top - z < CLEAR]
        for part in shapely.get_parts(cut(plan, united(over)) if over else plan):
            if part.area >= LEAST_TREAD and _depth(part) >= LEAST_DEPTH:
                faces.append(Landing(part, z))
    return sorted(faces, key=lambda face: face[1])


def _depth(plan: BaseGeometry) -> float:
    """Return the shorter side of the minimum rotated rectangle of a face [m]."""
    box = shapely.get_coordinates(shapely.minimum_rotated_rectangle(plan))
    return float(np.hypot(*np.diff(box[:3], axis=0).T).min()) if len(box) == 5 else 0.0


def _rows(faces: Sequence[Landing]) -> list[list[Landing]]:
    return [[faces[k] for k in row] for row in chains(faces)]


def _run(name: str, chain: list[Landing]) -> Run:
    """Return a chain of treads as a run, which winds if its treads turn."""
    treads = [plan for plan, _ in chain]
    riser = float(np.median(np.diff([height for _, height in chain])))
    direction, winds = direction_of(treads)
    edges, width = _winding_edges(treads, riser) if winds else (_straight_edges(treads, direction), np.inf)
    return Run((name,), chain, edges, riser, winds, width)


def _straight_edges(treads: Sequence[BaseGeometry], direction: FloatArray) -> FloatArray:
    """Return the edges (t + 1, 2, 2) of treads in one direction, a unit vector (2,) uphill."""
    direction = _squared(direction, treads)
    across = np.array([-direction[1], direction[0]])
    corners = [shapely.get_coordinates(plan) for plan in treads]
    ends_beside = [float(np.median([find(own @ across) for own in corners])) for find in (np.min, np.max)]
    levels = [(corners[0] @ direction).min(), *((own @ direction).max() for own in corners)]
    edges: FloatArray = np.array([[level * direction + s * across for s in ends_beside] for level in levels])
    return edges


def _winding_edges(treads: Sequence[BaseGeometry], riser: float) -> tuple[FloatArray, float]:
    """Return the edges (t + 1, 2, 2) of treads that turn, shortened at their narrow ends, and their least width [m]."""
    # Edges that are too short then, of treads that are long enough, are lengthened at their outer ends for single file.
    between = [_shared(lower, upper) for lower, upper in pairwise(treads)]
    edges = np.array([_far_side(treads[0], between[0])[::-1], *between, _far_side(treads[-1], between[-1])])
    lengths = np.hypot(*(edges[:, 1] - edges[:, 0]).T)
    ways = (edges[:, 1] - edges[:, 0]) / lengths[:, None]
    less = np.zeros((len(edges), 2))
    for k in range(len(treads)):
        gaps = np.hypot(*(edges[k + 1] - edges[k]).T)
        side = int(gaps.argmin())
        sign = 1.0 if side == 0 else -1.0
        for by in np.arange(0.0, lengths[k : k + 2].min() - LEAST_EDGE, TRIM):
            less[k : k + 2, side] = np.maximum(less[k : k + 2, side], by)
            ends = edges[k : k + 2, side] + sign * by * ways[k : k + 2]
            if np.hypot(*(ends[1] - ends[0])) >= max(LEAST_GOING, riser) or gaps[side] > 0.8 * gaps[1 - side]:
                break
    edges[:, 0] += less[:, :1] * ways
    edges[:, 1] -= less[:, 1:] * ways
    widths = np.hypot(*(edges[:, 1] - edges[:, 0]).T)
    if lengths.min() >= SHORTEST:
        lacks = np.maximum(SINGLE_FILE - widths, 0.0)[:, None]
        outer = int(less.sum(axis=0).argmin())
        edges[:, outer] += (lacks if outer else -lacks) * ways
    return edges, float(widths.min())


def _shared(lower: BaseGeometry, upper: BaseGeometry) -> FloatArray:
    """Return the edge (2, 2) between consecutive treads, the right end first on the way up."""
    for reach in MEET:
        line = shapely.intersection(upper.boundary, shapely.buffer(lower, reach, join_style="mitre"))
        if line.length > LEAST_EDGE:
            break
    return _ordered(_farthest(shapely.get_coordinates(line)), _middle(upper) - _middle(lower))


def _far_side(tread: BaseGeometry, edge: FloatArray) -> FloatArray:
    """Return the side (2, 2) of a tread opposite to one of its edges (2, 2), the right end first on the way there."""
    way = normal(edge)
    way = way if way @ (_middle(tread) - edge.mean(axis=0)) > 0.0 else -way
    corners = shapely.get_coordinates(tread.exterior.normalize())[::-1]  # anticlockwise
    sides = np.diff(corners, axis=0)
    length = np.hypot(*sides.T)
    ahead = (sides[:, 1] * way[0] - sides[:, 0] * way[1]) / np.maximum(length, 1e-9)
    rows = np.flatnonzero(ahead > 0.7) if (ahead > 0.7).any() else [int((ahead * length).argmax())]
    return _ordered(_farthest(np.concatenate([corners[k : k + 2] for k in rows])), way)


def _ordered(edge: FloatArray, way: FloatArray) -> FloatArray:
    """Return an edge (2, 2) with its right end first, seen in a direction (2,)."""
    along = edge[1] - edge[0]
    return edge if way[0] * along[1] - way[1] * along[0] >= 0.0 else edge[::-1]


def _farthest(points: FloatArray) -> FloatArray:
    """Return the two points (2, 2) of some that are farthest from each other."""
    away = np.hypot(*(points[:, None] - points[None]).transpose(2, 0, 1))
    pair: FloatArray = points[[*np.unravel_index(away.argmax(), away.shape)]]
    return pair


def _middle(plan: BaseGeometry) -> FloatArray:
    return np.array(plan.centroid.coords[0])


def _inclined_faces(body: Body) -> list[tuple[BaseGeometry, FloatArray, tuple[float, float]]]:
    """Return the plan, the lower and upper edge (2, 2, 2) and their heights [m] of each inclined top of a body."""
    rows = np.flatnonzero((body.normals[:, 2] < LEVEL) & (body.normals[:, 2] > STEEPEST))
    planes: dict[tuple[float, ...], list[int]] = {}
    for row in rows:
        offset = float(body.normals[row] @ body.corners[row, 0])
        planes.setdefault((*np.round(body.normals[row], 2).tolist(), round(offset, 1)), []).append(int(row))
    faces: list[tuple[BaseGeometry, FloatArray, tuple[float, float]]] = []
    for own in sorted(planes.values(), key=lambda rows: -float(body.corners[rows, :, 2].max())):
        upwards = body.normals[own[0]]
        uphill = -upwards[:2] / np.hypot(*upwards[:2])
        left = np.array([-uphill[1], uphill[0]])
        rest = cut(in_plan(body.corners[own, :, :2]), united([plan for plan, _, _ in faces]))
        for plan in shapely.get_parts(rest):
            corners = shapely.get_coordinates(plan)
            along, across = corners @ uphill, corners @ left
            ends = (float(along.min()), float(along.max()))
            sides = [across[np.abs(along - end) < LEAST_EDGE] for end in ends]
            if ends[1] - ends[0] < LEAST_SIDE or min(map(np.ptp, sides)) < LEAST_SIDE:
                continue
            edges = [
                [end * uphill + s * left for s in (own.min(), own.max())] for end, own in zip(ends, sides, strict=True)
            ]
            heights = [(body.corners[own[0], 0] @ upwards - upwards[:2] @ edge[0]) / upwards[2] for edge in edges]
            faces.append((plan, np.array(edges), (float(heights[0]), float(heights[1]))))
    return faces


def _squared(direction: FloatArray, treads: Sequence[BaseGeometry]) -> FloatArray:
    """Return the direction perpendicular to the sides of the largest tread that is nearest to one."""
    box = shapely.get_coordinates(shapely.minimum_rotated_rectangle(max(treads, key=lambda tread: tread.area)))
    sides = np.diff(box[:3], axis=0) / np.hypot(*np.diff(box[:3], axis=0).T)[:, None]
    row = int(np.abs(sides @ direction).argmax())
    found: FloatArray = sides[row] * np.sign(sides[row] @ direction)
    return found
