"""Convert the level faces of stairs to runs of treads and landings."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from evac.base.arrays import FloatArray
from evac.building.geometry.overlays import cut, united
from evac.building.recover.bodies.body import Body, closed

#: Range of the riser, the difference in height of consecutive treads [m].
LEAST_RISER, MOST_RISER = 0.05, 0.25
#: Largest gap in plan between consecutive treads [m].
APART = 0.1
#: Minimum area [m2] and depth [m] of a tread.
LEAST_TREAD, LEAST_DEPTH = 0.05, 0.1
#: Nobody can step on a face with less clear height than this above it [m].
CLEAR = 1.8
#: A face larger than the median tread by this factor is a landing.
LANDING = 2.2
#: Minimum depth of a landing between flights in one direction; a shorter one is treated as a deep tread [m].
SHORT = 1.0
#: A run turns if the directions between its consecutive treads differ by more than this [degrees].
MOST_TURN = 25.0


@dataclass(frozen=True)
class Run:
    """Consecutive treads in one direction."""

    names: tuple[str, ...]  # names of the bodies that the treads belong to
    # list of (polygon, float [m]): plan and height of each tread, from bottom to top
    treads: list[tuple[BaseGeometry, float]]
    direction: FloatArray  # (2,) float64: unit vector uphill
    riser: float  # [m]

    def edge(self, upper: bool, *, before_last: bool = False) -> FloatArray:
        """Return the front edge (2, 2) of the first tread, or the back edge of the last or second-to-last tread [m]."""
        across = np.array([-self.direction[1], self.direction[0]])
        sides = [shapely.get_coordinates(plan) @ across for plan, _ in self.treads]
        ends_beside = [float(np.median([find(side) for side in sides])) for find in (np.min, np.max)]
        treads = self.treads[:-1] if before_last else self.treads
        along = shapely.get_coordinates(treads[-1][0] if upper else treads[0][0]) @ self.direction
        level = along.max() if upper else along.min()
        ends: FloatArray = np.array([level * self.direction + s * across for s in ends_beside])
        return ends

    @property
    def place(self) -> tuple[float, float]:
        """Where it is, for findings [m]."""
        x, y = self.treads[len(self.treads) // 2][0].centroid.coords[0]
        return x, y


@dataclass(frozen=True)
class Turning:
    """Treads of a spiral or winding stair, which do not lie on one plane."""

    names: tuple[str, ...]
    treads: list[tuple[BaseGeometry, float]]
    degrees: float

    @property
    def place(self) -> tuple[float, float]:
        """Where it is, for findings [m]."""
        x, y = united([plan for plan, _ in self.treads]).centroid.coords[0]
        return x, y


@dataclass(frozen=True)
class Landing:
    """A level part of a stair."""

    plan: BaseGeometry
    z: float


@dataclass
class Treads:
    """Parts of stairs: straight runs, turning runs, landings, short landings within runs, bodies without treads."""

    runs: list[Run] = field(default_factory=list)
    turning: list[Turning] = field(default_factory=list)
    landings: list[Landing] = field(default_factory=list)
    short: list[Landing] = field(default_factory=list)
    bare: list[Body] = field(default_factory=list)


def treads_of(bodies: Sequence[Body]) -> Treads:
    """Find runs and landings in bodies that are whole stairs, flights or landings."""
    treads = Treads()
    for body in bodies:
        faces = _faces(body)
        if body.kind == "landing":
            treads.landings += [Landing(plan, z) for plan, z in faces[-1:]]
            continue
        usual = float(np.median([plan.area for plan, _ in faces])) if faces else 0.0
        landings = [face for face in faces if len(faces) > 2 and face[0].area > LANDING * usual]
        short = [face for face in landings if _depth(face[0]) < SHORT]
        chains = _chains([face for face in faces if face not in landings or face in short])
        if any(len(chain) > 1 and isinstance(_run(body.name, chain), Turning) for chain in chains):
            short = []
            chains = _chains([face for face in faces if face not in landings])
        treads.short += [Landing(*face) for face in short]
        treads.landings += [Landing(*face) for face in landings if face not in short]
        made = [_run(body.name, chain) for chain in chains if len(chain) > 1]
        treads.runs += [item for item in made if isinstance(item, Run)]
        treads.turning += [item for item in made if isinstance(item, Turning)]
        treads.bare += [] if made else [body]
    return treads


def _faces(body: Body) -> list[tuple[BaseGeometry, float]]:
    """Return the level faces of a stair that people can step on, from bottom to top; nosings belong to their treads.

    What is below another face, such as the steps of a stringer on which treads lie, is no part of them.
    """
    faces: list[tuple[BaseGeometry, float]] = []
    tops = [(closed(plan, 0.02), z) for plan, z in body.tops()]
    for row, (plan, z) in enumerate(tops):
        over = [higher for higher, top in tops[row + 1 :] if top - z < CLEAR]
        for part in shapely.get_parts(cut(plan, united(over)) if over else plan):
            box = shapely.get_coordinates(shapely.minimum_rotated_rectangle(part))
            if (
                len(box) == 5
                and part.area >= LEAST_TREAD
                and np.hypot(*np.diff(box[:3], axis=0).T).min() >= LEAST_DEPTH
            ):
                faces.append((part, z))
    return sorted(faces, key=lambda face: face[1])


def _depth(plan: BaseGeometry) -> float:
    """Return the shorter side of the minimum rotated rectangle of a face [m]."""
    box = shapely.get_coordinates(shapely.minimum_rotated_rectangle(plan))
    return float(np.hypot(*np.diff(box[:3], axis=0).T).min()) if len(box) == 5 else 0.0


def _chains(faces: Sequence[tuple[BaseGeometry, float]]) -> list[list[tuple[BaseGeometry, float]]]:
    """Chain the faces: each is one riser above the previous one and adjacent to it."""
    chains: list[list[tuple[BaseGeometry, float]]] = []
    for plan, z in faces:
        below = [
            chain
            for chain in chains
            if LEAST_RISER <= z - chain[-1][1] <= MOST_RISER and chain[-1][0].distance(plan) <= APART
        ]
        if below:
            min(below, key=lambda chain: (z - chain[-1][1], chain[-1][0].distance(plan))).append((plan, z))
        else:
            chains.append([(plan, z)])
    return chains


def _run(name: str, chain: list[tuple[BaseGeometry, float]]) -> Run | Turning:
    """Return a chain of treads as a run if it has one direction, otherwise as a turning run."""
    middle = np.array([plan.centroid.coords[0] for plan, _ in chain])
    z = np.array([height for _, height in chain])
    steps = np.diff(middle, axis=0)
    steps /= np.maximum(np.hypot(*steps.T), 1e-9)[:, None]
    direction = steps.sum(axis=0)
    turn = np.degrees(np.arccos(np.clip(steps @ direction / max(np.hypot(*direction), 1e-9), -1.0, 1.0))).max()
    if turn > MOST_TURN:
        return Turning((name,), chain, float(2.0 * turn))
    direction = _squared(direction / np.hypot(*direction), chain)
    return Run((name,), chain, direction, float(np.median(np.diff(z))))


def _squared(direction: FloatArray, chain: Sequence[tuple[BaseGeometry, float]]) -> FloatArray:
    """Return the direction perpendicular to the longest tread side that is roughly perpendicular to it."""
    best, found = 0.0, direction
    for plan, _ in chain:
        corners = shapely.get_coordinates(plan.exterior)
        sides = np.diff(corners, axis=0)
        length = np.hypot(*sides.T)
        across = np.stack([-sides[:, 1], sides[:, 0]], axis=1) / np.maximum(length, 1e-9)[:, None]
        is_across = np.abs(across @ direction) > 0.9
        if is_across.any() and length[is_across].max() > best + 1e-6:
            row = int(np.flatnonzero(is_across)[length[is_across].argmax()])
            best, found = float(length[row]), across[row] * np.sign(across[row] @ direction)
    return found
