"""Convert the faces of stairs and ramps to runs of treads and landings."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from evac.base.arrays import FloatArray
from evac.building.geometry.overlays import cut, united
from evac.building.recover.bodies.body import Body, closed
from evac.building.recover.bodies.edges import inclined_faces, straight_edges, winding_edges

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
#: A run winds if the directions between its consecutive treads differ from their mean by more than this [degrees].
MOST_TURN = 25.0


@dataclass(frozen=True)
class Run:
    """Consecutive treads, or an inclined face."""

    names: tuple[str, ...]  # names of the bodies that the treads belong to
    # list of (polygon, float [m]): plan and height of each tread, from bottom to top; both ends of an inclined face
    treads: list[tuple[BaseGeometry, float]]
    edges: FloatArray  # (e, 2, 2) float64 [m]: front edge of each tread and back edge of the last one, right end first
    riser: float  # [m]; 0 for an inclined face
    winds: bool = False  # whether its treads turn

    @property
    def place(self) -> tuple[float, float]:
        """Where it is, for findings [m]."""
        x, y = self.treads[len(self.treads) // 2][0].centroid.coords[0]
        return x, y


@dataclass(frozen=True)
class Landing:
    """A level part of a stair."""

    plan: BaseGeometry
    z: float


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
            treads.landings += [Landing(plan, z) for plan, z in faces[-1:]]
            continue
        usual = float(np.median([plan.area for plan, _ in faces])) if faces else 0.0
        landings = [face for face in faces if len(faces) > 2 and face[0].area > LANDING * usual]
        short = [face for face in landings if _depth(face[0]) < SHORT]
        chains = _chains([face for face in faces if face not in landings or face in short])
        if any(len(chain) > 1 and _run(body.name, chain).winds for chain in chains):
            short = []
            chains = _chains([face for face in faces if face not in landings])
        treads.short += [Landing(*face) for face in short]
        treads.landings += [Landing(*face) for face in landings if face not in short]
        made = [_run(body.name, chain) for chain in chains if len(chain) > 1]
        if not made:
            made = [
                Run((body.name,), [(plan, z) for z in heights], edges, 0.0)
                for plan, edges, heights in inclined_faces(body)
            ]
            treads.landings += [Landing(*face) for face in faces if made and face not in landings]
        treads.runs += made
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
            if part.area >= LEAST_TREAD and _depth(part) >= LEAST_DEPTH:
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


def _run(name: str, chain: list[tuple[BaseGeometry, float]]) -> Run:
    """Return a chain of treads as a run, which winds if its treads turn."""
    treads = [plan for plan, _ in chain]
    middle = np.array([plan.centroid.coords[0] for plan in treads])
    riser = float(np.median(np.diff([height for _, height in chain])))
    steps = np.diff(middle, axis=0)
    steps /= np.maximum(np.hypot(*steps.T), 1e-9)[:, None]
    direction = steps.sum(axis=0)
    turn = np.degrees(np.arccos(np.clip(steps @ direction / max(np.hypot(*direction), 1e-9), -1.0, 1.0))).max()
    if turn > MOST_TURN:
        return Run((name,), chain, winding_edges(treads, riser), riser, winds=True)
    return Run((name,), chain, straight_edges(treads, direction / np.hypot(*direction)), riser)
