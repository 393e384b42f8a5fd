"""Independent references: contact problems by an interior-point solver of a library, geodesics by a visibility graph,
directions with clearance from walls by fast sweeping on a fine grid.

Sweeping solves |grad T| = s for the slowness that `build_fields` states, with the method of Zhao, "A fast sweeping
method for eikonal equations" (2005), and differentiates T centrally. Only this slowness is shared with the tested code,
but not the marching, the grid, the distances or the treatment of walls; all else shares nothing.
"""

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy import ndimage, sparse
from scipy.ndimage import map_coordinates
from scipy.sparse.csgraph import dijkstra
from scipy.sparse.linalg import splu
from shapely.geometry.base import BaseGeometry
from shapely.geometry.polygon import orient

from evac.base.arrays import FloatArray
from evac.base.errors import EvacError
from evac.building.model.building import Building
from evac.directions.build import BEND
from evac.jit import FloatGrid, kernel

IntArray = NDArray[np.int32]

#: Paths may intersect walls by this much, so that paths along walls and around corners count as free [m].
TOUCH = 1e-7

#: Required precision of a contact reference [m/s]; successive settings of Clarabel: refinements, tolerance.
PRECISION = 1e-10
ATTEMPTS = ((50, 1e-15), (10, 1e-13), (10, 1e-12), (10, 1e-11))

#: Number of evaluations of a solution; between two of them the equations of the active contacts are solved again, with
#: the contacts that have become active or inactive.
POLISHES = 8

#: Regularisation of linearly dependent equations [1/kg], whose effect is removed by this number of refinements.
REGULAR = 1e-12
REFINEMENTS = 10

#: Maximum number of points evaluated in a visibility graph at once, to limit memory.
BLOCK = 20_000


def gradient_matrix(body: IntArray, other: IntArray, normal: FloatArray, bodies: int) -> Any:
    """Return the sparse G (c, 2n) of normal velocities, w = G v; a wall is at rest."""
    c = len(body)
    row = np.repeat(np.arange(c), 2)
    columns = (2 * body[:, None] + np.arange(2)).ravel()
    pair = other >= 0
    other_columns = (2 * other[pair, None] + np.arange(2)).ravel()
    return sparse.csc_matrix(
        (
            np.concatenate([normal.ravel(), -normal[pair].ravel()]),
            (np.concatenate([row, np.repeat(np.flatnonzero(pair), 2)]), np.concatenate([columns, other_columns])),
        ),
        shape=(c, 2 * bodies),
    )


class ContactLaw(NamedTuple):
    """A contact problem: G (c, k) sparse, masses and free velocities (k,), bias and velocities before (c,), K_N."""

    gradient: Any
    mass: FloatArray
    free: FloatArray
    bias: FloatArray
    before: FloatArray
    dissipation: float

    def state(self, velocity: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return omega [1/kg], velocity w+ [m/s] and elastic percussion K_N max(0, -(w+ + w-)/2) [N s] of each."""
        omega = np.asarray(self.gradient.multiply(self.gradient) @ (1.0 / self.mass)).ravel()
        after = self.gradient @ velocity
        return omega, after, self.dissipation * np.maximum(0.0, -0.5 * (after + self.before))

    def residual(self, velocity: FloatArray, percussion: FloatArray) -> float:
        """Return the residual of the law and of the balance of momentum [m/s].

        The greatest of |v - V - M^-1 G^T P| and of |min(., .)| of the two complementary quantities of each
        contact, percussions turned into velocities by omega.
        """
        balance = velocity - self.free - (self.gradient.T @ percussion) / self.mass
        omega, after, spring = self.state(velocity)
        law = np.minimum(omega * (percussion - spring), after + self.bias)
        return float(max(np.abs(balance).max(), np.abs(law).max(initial=0.0)))

    def polished(self, velocity: FloatArray, percussion: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return velocities and percussions that solve the equations of the active contacts by a sparse LU.

        Rigid ones obey w + b = 0, elastic ones w + w- + (2/K_N) P = 0.
        """
        mass = self.mass
        omega, after, spring = self.state(velocity)
        rigid = omega * (percussion - spring) > after + self.bias
        pushes = rigid | (spring > 0.0)
        held = self.gradient[pushes]
        elastic = ~rigid[pushes]
        compliance = np.where(elastic, 2.0 / self.dissipation if self.dissipation > 0.0 else 0.0, 0.0)
        right = np.concatenate([mass * self.free, -np.where(elastic, self.before[pushes], self.bias[pushes])])
        system = sparse.bmat([[sparse.diags(mass), -held.T], [held, sparse.diags(compliance)]], format="csc")
        regular = sparse.diags(np.concatenate([np.zeros(len(mass)), np.full(held.shape[0], REGULAR)]))
        factors = splu((system + regular).tocsc())
        solution = np.zeros(len(right))
        for _ in range(REFINEMENTS):
            solution += factors.solve(right - system @ solution)
        polished = np.zeros(len(percussion))
        polished[pushes] = solution[len(mass) :]
        return solution[: len(mass)], polished


def solve_contact_qp(law: ContactLaw, precision: float = PRECISION) -> FloatArray:
    """Return the velocities that minimise the law's energy, by the interior-point solver Clarabel.

    min 1/2 |v - V|_M^2 + K_N |s|^2   subject to   G v + b >= 0,   s >= -(G v + w-)/2,   s >= 0

    whose multipliers are the percussions of NSM1 (K_N = 0, b = max(D, 0)/h) and of NSM2 (b = 0). Solved for M^(1/2) (v
    - V), which is well scaled; if this is not precise enough, the equations of the active contacts are solved directly
    and the whole law is evaluated again, repeatedly. G is sparse (c, k), M (k,) [kg], V (k,) [m/s], b and w- (c,)
    [m/s], and K_N finite [kg]; the residual of an accepted solution is at most `precision` [m/s].
    """
    gradient, mass, free, bias, before, dissipation = law
    c, k = gradient.shape
    unit = float(np.mean(mass))
    root = np.sqrt(unit / mass)
    start = gradient @ free
    scaled = gradient @ sparse.diags(root)
    quadratic, matrix, bound = sparse.identity(k), -scaled, start + bias
    if dissipation > 0.0:
        # The slack is scaled so that its quadratic term has the size of the others.
        slack = np.sqrt(unit / (2.0 * dissipation))
        quadratic = sparse.identity(k + c)
        matrix = sparse.bmat([[-scaled, None], [-0.5 * scaled, -slack * sparse.identity(c)]])
        bound = np.concatenate([start + bias, 0.5 * (start + before)])
    best, gap = free, np.inf
    for refinements, tolerance in ATTEMPTS:
        solution = _solved_by_clarabel(quadratic, matrix, bound, refinements, tolerance)
        velocity = free + root * np.array(solution.x)[:k]
        percussion = unit * np.array(solution.z)[:c]
        if dissipation > 0.0:
            percussion += 0.5 * unit * np.array(solution.z)[c:]
        for _ in range(POLISHES):
            left = law.residual(velocity, percussion)
            if left < gap:
                best, gap = velocity, left
            if gap <= precision:
                return np.asarray(best)
            velocity, percussion = law.polished(velocity, percussion)
    raise EvacError(f"the reference of a contact problem was found to {gap:.1e} m/s only, not to {precision:.0e} m/s")


def _solved_by_clarabel(quadratic: Any, matrix: Any, bound: FloatArray, refinements: int, tolerance: float) -> Any:
    """Return Clarabel's solution of min 1/2 x.Q x subject to A x <= bound, with its multipliers z."""
    try:
        import clarabel
    except ImportError as error:
        raise EvacError(
            "the reference of contact problems needs clarabel; install it with: pip install clarabel"
        ) from error
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    settings.max_iter = 400
    settings.max_threads = 1
    settings.tol_gap_abs = settings.tol_gap_rel = settings.tol_feas = tolerance
    settings.iterative_refinement_max_iter = refinements
    settings.iterative_refinement_reltol = settings.iterative_refinement_abstol = 0.1 * tolerance
    size = quadratic.shape[0]
    cones = [clarabel.NonnegativeConeT(len(bound))]
    return clarabel.DefaultSolver(
        sparse.csc_matrix(quadratic), np.zeros(size), sparse.csc_matrix(matrix), bound, cones, settings
    ).solve()


def geodesics(plan: BaseGeometry, target: FloatArray, points: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return exact lengths of the shortest paths in a plan to a straight line, by its visibility graph.

    A shortest path is straight between reflex corners of the outline; its last segment ends at the nearest point of the
    line (x1, y1, x2, y2) on the outline, or at one of the line's ends. Returns for points (p, 2) the lengths (p,) [m],
    the unit vectors (p, 2) of the first segments, and the leads (p,): the additional length of the best path with
    another first corner [m]; if it is small, the direction jumps nearby.
    """
    nodes = np.concatenate([_reflex_corners(plan), target.reshape(2, 2)])
    room = plan.buffer(TOUCH, join_style="mitre")
    between = _visible(room, np.repeat(nodes, len(nodes), axis=0), np.tile(nodes, (len(nodes), 1))).reshape(
        len(nodes), len(nodes)
    )
    lengths = np.hypot(*(nodes[:, None] - nodes[None]).transpose(2, 0, 1))
    ends = _nearest_on(target, nodes)
    direct = np.where(_visible(room, nodes, ends), np.hypot(*(nodes - ends).T), np.inf)
    graph = np.zeros((len(nodes) + 1, len(nodes) + 1))
    graph[:-1, :-1] = np.where(between, lengths, 0.0)
    # The target is the last node; nodes on it get a tiny distance, because zero means no edge.
    graph[-1, :-1] = np.where(np.isfinite(direct), np.maximum(direct, 1e-12), 0.0)
    remaining = dijkstra(sparse.csr_matrix(graph), directed=False, indices=len(nodes))[:-1]
    hops = np.concatenate([nodes, np.full((1, 2), np.nan)])
    total = np.full((len(points), len(nodes) + 1), np.inf)
    for first in range(0, len(points), max(1, BLOCK // len(nodes))):
        some = slice(first, first + max(1, BLOCK // len(nodes)))
        here = points[some]
        seen = _visible(room, np.repeat(here, len(nodes), axis=0), np.tile(nodes, (len(here), 1)))
        away = np.hypot(*(here[:, None] - nodes[None]).transpose(2, 0, 1))
        total[some, :-1] = np.where(seen.reshape(len(here), -1), away + remaining[None], np.inf)
        ends = _nearest_on(target, here)
        total[some, -1] = np.where(_visible(room, here, ends), np.hypot(*(here - ends).T), np.inf)
    best = total.argmin(axis=1)
    length = total[np.arange(len(points)), best]
    aim = np.where((best == len(nodes))[:, None], _nearest_on(target, points), hops[best])
    away = aim - points
    norm = np.maximum(np.hypot(*away.T), 1e-300)
    direction = away / norm[:, None]
    # Another first corner is one whose direction differs by more than 5 degrees.
    aims = np.repeat(hops[None], len(points), axis=0)
    aims[:, -1] = _nearest_on(target, points)
    away = aims - points[:, None]
    away /= np.maximum(np.hypot(away[..., 0], away[..., 1]), 1e-300)[..., None]
    other = np.einsum("pnk,pk->pn", away, direction) < np.cos(np.radians(5.0))
    return length, direction, np.where(other, total, np.inf).min(axis=1) - length


def _reflex_corners(plan: BaseGeometry) -> FloatArray:
    """Return the corners (k, 2) around which a shortest path can bend: the inside angle is more than 180 degrees."""
    corners: list[FloatArray] = []
    solid = orient(plan)
    for ring in (solid.exterior, *solid.interiors):
        corner = np.asarray(ring.coords)[:-1, :2]
        back, ahead = corner - np.roll(corner, 1, axis=0), np.roll(corner, -1, axis=0) - corner
        turn = back[:, 0] * ahead[:, 1] - back[:, 1] * ahead[:, 0]
        corners.append(corner[turn < -1e-9])
    return np.concatenate(corners)


def _visible(room: BaseGeometry, start: FloatArray, end: FloatArray) -> NDArray[np.bool_]:
    """Return for each pair of points (k, 2) whether the straight line between them stays in the room."""
    shapely.prepare(room)
    # Some shapely versions treat a line of zero length as invalid, so a tiny length is added.
    lines = shapely.linestrings(np.stack([start, end + 1e-12], axis=1))
    return np.asarray(shapely.covers(room, lines))


def _nearest_on(target: FloatArray, points: FloatArray) -> FloatArray:
    """Return the points (p, 2) of a line (4,) nearest to points (p, 2)."""
    start, along = target[:2], target[2:] - target[:2]
    share = np.clip((points - start) @ along / (along @ along), 0.0, 1.0)
    return np.asarray(start + share[:, None] * along)


def refracted(
    points: FloatArray, seams: Sequence[FloatArray], slowness: Sequence[float]
) -> tuple[FloatArray, FloatArray]:
    """Return least travel times (p,) through convex plans one after another, each with its slowness [s/m].

    Each seam (4,) is the line between two plans, the last one the target; the path is straight between
    them, and the crossing points minimise the time, which is a convex function of them.
    Also returns the unit directions (p, 2) of the first segments.
    """
    from scipy.optimize import minimize

    starts = np.array([seam[:2] for seam in seams])
    along = np.array([seam[2:] - seam[:2] for seam in seams])
    rates = np.array(slowness)

    def time_of(share: FloatArray, point: FloatArray) -> tuple[float, FloatArray]:
        places = np.concatenate([point[None], starts + share[:, None] * along])
        pieces = np.diff(places, axis=0)
        lengths = np.maximum(np.hypot(pieces[:, 0], pieces[:, 1]), 1e-300)
        pull = rates[:, None] * pieces / lengths[:, None]
        pull[:-1] -= pull[1:].copy()
        return float(rates @ lengths), np.einsum("sk,sk->s", pull, along)

    times, aims = [], []
    for point in points:
        best = minimize(
            time_of,
            np.full(len(seams), 0.5),
            args=(point,),
            jac=True,
            bounds=[(0.0, 1.0)] * len(seams),
            method="L-BFGS-B",
            options={"ftol": 1e-15, "gtol": 1e-12, "maxiter": 500},
        )
        times.append(best.fun)
        aims.append(starts[0] + best.x[0] * along[0])
    away = np.array(aims) - points
    return np.array(times), away / np.maximum(np.hypot(*away.T), 1e-300)[:, None]


#: Spacing of the grid [m].
FINE = 0.00625

#: Sweeps in both directions along both axes end when no time changes by more than this [s].
STILL = 1e-9

#: Two paths meet where the gradient is smaller than this share of the slowness.
MEETING = 0.9


class CleanWays(NamedTuple):
    """Directions, and the distance to places where they are ambiguous."""

    direction: FloatArray  # (p, 2): unit vectors of the directions
    to_meeting: FloatArray  # (p,) [m]: distance to the nearest place where two equally fast paths meet


def clean_ways(building: Building, places: FloatArray, clearance: float, spacing: float = FINE) -> CleanWays:
    """Return the directions at places (p, 2) of a building whose levels do not overlap in plan, with one exit."""
    low, high = (np.array(f(building.vertices[:, :2], axis=0)) for f in (np.min, np.max))
    origin = low - 2.0 * clearance
    number = np.ceil((high + 2.0 * clearance - origin) / spacing).astype(int) + 1
    x, y = np.meshgrid(*(origin[k] + spacing * np.arange(number[k]) for k in (0, 1)), indexing="ij")
    pace = np.full(x.shape, np.inf)
    for level in building.levels:
        shapely.prepare(level.polygon)
        on_level = shapely.intersects_xy(level.polygon, x, y)
        pace[on_level] = np.minimum(pace[on_level], 1.0 / math.cos(level.slope))
    ahead, along = _beside(building.exits[0].segments[0], x, y)
    door = (ahead < 0.0) & (ahead >= -1.5 * clearance) & (along >= 0.0) & (along <= 1.0)
    pace[door] = np.minimum(pace[door], 1.0)
    distance = wall_distances(building.walls, x, y, clearance)
    slowness = pace * (1.0 + BEND * (1.0 - distance / clearance) ** 2)
    # People are out one clearance behind the exit, independent of what is there.
    cost = np.where(door & (ahead <= -clearance), 0.0, np.inf)
    sweep(cost, slowness, spacing)
    return _directions(cost, slowness, (places - origin) / spacing, spacing)


def _beside(line: FloatArray, x: FloatArray, y: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return how far nodes are on the left of a line [m], and how far along it, as a share of its length."""
    (x1, y1, x2, y2) = line
    length = math.hypot(x2 - x1, y2 - y1)
    ahead = ((x2 - x1) * (y - y1) - (y2 - y1) * (x - x1)) / length
    along = ((x2 - x1) * (x - x1) + (y2 - y1) * (y - y1)) / length**2
    return ahead, along


def wall_distances(walls: FloatArray, x: FloatArray, y: FloatArray, reach: float) -> FloatArray:
    """Return the distances of the nodes of a grid to the nearest of walls (w, 4), at most `reach` [m]."""
    distances = np.full(x.shape, reach)
    for x1, y1, x2, y2 in walls:
        i = slice(*np.searchsorted(x[:, 0], [min(x1, x2) - reach, max(x1, x2) + reach]))
        j = slice(*np.searchsorted(y[0], [min(y1, y2) - reach, max(y1, y2) + reach]))
        px, py = x[i, j] - x1, y[i, j] - y1
        dx, dy = x2 - x1, y2 - y1
        share = np.clip((px * dx + py * dy) / (dx * dx + dy * dy), 0.0, 1.0)
        distances[i, j] = np.minimum(distances[i, j], np.hypot(px - share * dx, py - share * dy))
    return distances


@kernel
def sweep(cost: FloatGrid, slowness: FloatGrid, spacing: float) -> None:
    """Lower the costs of a grid (nx, ny) to the solution; slowness is inf where nobody walks."""
    nx, ny = cost.shape
    change = math.inf
    while change > STILL:
        change = 0.0
        for turn in range(4):
            for k in range(nx):
                i = k if turn % 2 == 0 else nx - 1 - k
                for m in range(ny):
                    j = m if turn < 2 else ny - 1 - m
                    if slowness[i, j] == math.inf:
                        continue
                    a = min(cost[i - 1, j] if i > 0 else math.inf, cost[i + 1, j] if i < nx - 1 else math.inf)
                    b = min(cost[i, j - 1] if j > 0 else math.inf, cost[i, j + 1] if j < ny - 1 else math.inf)
                    low, high = min(a, b), max(a, b)
                    if low == math.inf:
                        continue
                    step = slowness[i, j] * spacing
                    new = low + step
                    if new > high:
                        new = 0.5 * (low + high + math.sqrt(2.0 * step * step - (high - low) ** 2))
                    if new < cost[i, j]:
                        change = max(change, min(cost[i, j] - new, 1.0))
                        cost[i, j] = new


def _directions(cost: FloatArray, slowness: FloatArray, cells: FloatArray, spacing: float) -> CleanWays:
    """Return descent directions at places given in cells; nobody stands within a cell of where nobody walks."""
    gradient = np.zeros((2, *cost.shape))
    reached = np.isfinite(cost)
    inner = reached.copy()
    with np.errstate(invalid="ignore"):
        for axis in (0, 1):
            before, after = np.roll(cost, 1, axis=axis), np.roll(cost, -1, axis=axis)
            gradient[axis] = (after - before) / (2.0 * spacing)
            inner &= np.isfinite(before) & np.isfinite(after)
    gradient[:, ~inner] = 0.0
    meeting = np.zeros_like(inner)
    meeting[inner] = np.hypot(*gradient[:, inner]) < MEETING * slowness[inner]
    away: Any = ndimage.distance_transform_edt(~meeting) if meeting.any() else np.full(cost.shape, np.inf)
    down = -np.stack([map_coordinates(part, cells.T, order=1) for part in gradient], axis=1)
    norm = np.maximum(np.hypot(*down.T), 1e-300)[:, None]
    return CleanWays(down / norm, spacing * map_coordinates(away, cells.T, order=0))
