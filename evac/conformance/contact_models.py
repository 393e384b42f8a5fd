"""Checks of contact models and solvers on a flat level, with or without walls, at a pace that suits their stiffness."""

import copy
import math
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from shapely import box

from evac.base.arrays import FloatArray
from evac.base.errors import EvacError, counted
from evac.building.model.building import Building, Level
from evac.conformance.failures import CheckError, examining, require, require_close, scene
from evac.contract.registry import Registry
from evac.directions.fields import NO_CELL_WALLS, Fields, PackedFields
from evac.directions.routes import Route
from evac.physics.contact.model import ContactModel, SolvedContactModel, border_scene
from evac.physics.contact.packing import packed_row
from evac.physics.contact.pair_contact import PairContact
from evac.physics.contact.rows import BEFORE, SPRING, call_solver, renew_velocity, row_residual
from evac.physics.contact.solver import Solver
from evac.physics.engine import CompiledEngine
from evac.physics.state import Crowd, Problem, copy_of, make_crowd
from evac.physics.world import make_world

#: Step [s], of which a tick has ten; half the sides of the square room and of the level around it [m].
STEP, ROOM, LEVEL = 0.01, 2.5, 20.0

#: Walls of the closed square room.
WALLS = ROOM * np.array([(-1, -1, 1, -1), (1, -1, 1, 1), (1, 1, -1, 1), (-1, 1, -1, -1)])
EAST, NORTH, NOWHERE = np.array([1.0, 0.0]), np.array([0.0, 1.0]), np.zeros((0, 4))

#: Tolerance of positions after rotating or shifting a scene [m]; the iteration counts of solvers may differ.
TURN_TOLERANCE = 1e-4

#: Sums of the report that may be negative.
SIGNED = ("driving_work", "contact_dissipation", "contact_creation")

#: A scene, its people in steps of a grid near the eastern wall, and another order of them.
PRESSED, NINE, ANOTHER_ORDER = "nine people pressed against a wall", np.arange(9), [4, 7, 0, 2, 8, 5, 1, 6, 3]
NINE_PEOPLE = make_crowd(
    np.column_stack([0.2 + NINE % 3 * 0.6 + 0.07 * NINE, NINE // 3 * 0.55 - 0.6 + 0.05 * (NINE % 3)]),
    radius=np.linspace(0.25, 0.18, 9),
    mass=np.linspace(60.0, 100.0, 9),
    speed=np.linspace(1.2, 2.0, 9),
    tau=0.3,
)

#: Tolerance of the residual [m/s] and limit of iterations of solvers; tolerances of rounding, relative and in [m/s].
TOLERANCE, LIMIT, ROUNDING, LEAST = 1e-8, 200_000, 1e-6, 1e-12

#: Arrays with intermediate results, and attributes of the problem that a solver must not change.
WORK = [name for name in Problem.kinds if name.startswith(("work", "image", "face", "branch"))]
GIVEN = ("size", "bodies", "rigid", "body", "other", "data", "elastic", "scale", "inverse_root", "free")


class Pace(NamedTuple):
    """Motion slowed down `slow` times, in steps that are divided into `parts`, for contacts of any stiffness.

    Contacts that are softer by the square of `slow` have the same overlaps.
    """

    slow: int = 1
    parts: int = 1

    @property
    def step(self) -> float:
        """Length of a step [s]."""
        return STEP * self.slow / self.parts

    def __str__(self) -> str:
        slower = f", motion slowed down {self.slow} times" if self.slow > 1 else ""
        return f"steps of {self.step:g} s{slower}"


PLAIN = Pace()


@cache
def registered() -> Registry:
    """Return the registered plugins."""
    return Registry()


def solved_model() -> type[ContactModel]:
    """Return a registered contact model that solves contact problems."""
    return next(model for model in registered().contact_models.values() if issubclass(model, SolvedContactModel))


def _engine(walls: FloatArray, ahead: FloatArray, people: int) -> CompiledEngine:
    """Return the engine of a level with walls (w, 4) on which everybody wants to walk in one direction."""
    corners = LEVEL * np.array([(-1.0, -1.0), (-1.0, 1.0), (1.0, -1.0), (1.0, 1.0)])
    shape = box(-LEVEL, -LEVEL, LEVEL, LEVEL)
    level = Level(0, "floor", "floor", None, np.zeros((0, 3), np.int32), shape, np.zeros(2), 0.0, 0.0, 0.0)
    walls = np.concatenate([LEVEL / ROOM * WALLS, walls])
    places = np.column_stack([corners, np.zeros(4)])
    of_walls = np.zeros(len(walls), np.int32)
    building = Building(Path("by hand"), places, (level,), (), (), (), walls, of_walls, {})
    packed = PackedFields(
        origin=corners[:1],
        shape=np.array([[2, 2]], np.int32),
        spacing=2.0 * LEVEL,
        width=np.zeros(0),
        field_of=np.zeros((1, 1), np.int32),
        offset=np.zeros(1, np.int64),
        direction=np.repeat([ahead], 4, axis=0),
        travel_time=4.0 * LEVEL - (corners - corners[0]) @ ahead,
        walls=NO_CELL_WALLS,
    )
    return CompiledEngine(make_world(building, Fields((Route(),), packed)), people, [], solvers=registered().solvers)


def walk(
    model: ContactModel,
    pace: Pace,
    crowd: Crowd,
    steps: int,
    walls: FloatArray = NOWHERE,
    ahead: FloatArray = EAST,
    saved: Mapping[str, NDArray[Any]] | None = None,
) -> tuple[list[Crowd], CompiledEngine]:
    """Make a number of plain steps in which all people want to walk in one direction; with none, two at the pace.

    Returns copies of the crowd after each tick, with the velocities of the plain pace, and the engine with its report.
    The engine goes on from the snapshot of another one, if it is given.
    """
    slowed = {"velocity": crowd.velocity / pace.slow, "speed": crowd.speed / pace.slow, "tau": crowd.tau * pace.slow}
    engine, crowd = _engine(walls, ahead, len(crowd.level)), copy_of(crowd.replace(**slowed))
    model.check_scene(border_scene(crowd, pace.step, True))
    if saved is not None:
        engine.load(model)
        engine.restore(saved)
    total, tick, crowds = *((steps * pace.parts, 10 * pace.parts) if steps else (2, 1)), []
    for first in range(0, total, tick):
        engine.advance(model, crowd, first, tick, pace.step, True, True)
        crowds.append(copy_of(crowd).replace(velocity=crowd.velocity * pace.slow))
    return crowds, engine


def check_pair_law(model: PairContact) -> None:
    """Check that the law of a single contact is finite and brakes sliding where bodies touch, without side effects."""
    with examining("its function pair"):
        model.check_pair()
        packed = packed_row(model, f"contact model {model.name!r}")
    with scene("two people of 80 kg who touch or overlap"):
        before = packed.copy()
        for gap, closing in ((0.0, 2.0), (-1e-9, -2.0), (-0.2, 0.0)):
            for slide in (-1.0, 1.0):
                friction = model.forces(gap, closing, 40.0, packed, slide, 0.01)[1]
                wrong = f"the friction is {friction:.3g} N for the sliding speed {slide} m/s"
                require(friction * slide <= 0.0, f"{wrong}; return a force that brakes, with the opposite sign")
        require(np.array_equal(packed, before), "the law changes its parameters; only return the force")


def check_pace(model: ContactModel) -> Pace:
    """Return the pace at which `check_room` passes: the plain one, slower motion, or shorter steps.

    If all fail, the cause is not the stiffness, and the plain pace is returned, at which other checks fail. An
    exception of the plugin, other than an arithmetic one, fails at once.
    """
    for pace in [PLAIN, *(pace for k in (8, 64, 512) for pace in (Pace(k, k), Pace(1, k)))]:
        try:
            check_room(model, pace)
            return pace
        except CheckError as error:
            if not isinstance(error.__cause__, EvacError | ArithmeticError | None):
                raise
    return PLAIN


def check_room(model: ContactModel, pace: Pace) -> None:
    """Check that people at one place, pressed or thrown against a wall stay in the room."""
    at_one_place = make_crowd([[0.0, 0.0], [0.0, 0.0], [ROOM, 0.0]], speed=1.0)
    thrown = make_crowd([[2.0, 0.0]], velocity=[[10.0, 0.0]], speed=2.0, tau=0.1)
    for title, people, steps in (
        ("two people at one place", at_one_place, 0),  # for two steps; later, stiff contacts throw them far
        (PRESSED, NINE_PEOPLE, 200),
        ("a person pushed towards a wall", thrown, 50),
    ):
        with scene(f"{title}, {pace}"):
            for crowd in walk(model, pace, people, steps, WALLS)[0]:
                beyond = np.abs(crowd.position).max(axis=1) - ROOM
                (x, y), far = crowd.position[beyond.argmax()], beyond.max()
                wrong = f"a person passed through the wall, at ({x:.2f}, {y:.2f}), {far:.2g} m beyond it"
                require(far <= 0.0, f"{wrong}; apply percussions at walls too, where contacts.other is -1")


def check_free_walk(model: ContactModel, pace: Pace) -> None:
    """Check that a person without contacts moves by eq. 33, bitwise equal alone and with distant people."""
    steps, speed, tau = 60 * pace.parts, 1.5, 0.5
    with scene(f"a person without contacts, {pace}"):
        alone = walk(model, pace, make_crowd([[0.0, 0.0]], speed=speed, tau=tau), 60)[0][-1]
        exact = speed if model.overdamped else speed * (1.0 - (1.0 - pace.step / (pace.slow * tau)) ** steps)
        wrong = f"walks at {alone.velocity[0, 0]:.9f} m/s after {steps} steps, not at {exact:.9f} m/s"
        remedy = "without contacts, the velocity after a step must be the free velocity"
        require_close(alone.velocity[0], [exact, 0.0], 1e-9, f"{wrong}; {remedy}")
    with scene(f"two people 5 m apart, {pace}"):
        two = walk(model, pace, make_crowd([[0.0, 0.0], [0.0, 5.0]], speed=speed, tau=tau), 60)[0][-1]
        told = "a person 5 m away changes a free walk by {:.3g} m; use only the given contacts"
        require_close(alone.position[0], two.position[0], 0.0, told)


def check_collision(model: ContactModel, pace: Pace) -> None:
    """Check that two people who collide do not pass through each other, and conserve momentum and energy."""
    if model.overdamped:
        return
    with scene(f"two people who collide, {pace}"):
        velocity, mass = np.array([[1.5, 0.0], [-1.0, 0.0]]), np.array([60.0, 100.0])
        crowd = make_crowd([[-0.3, 0.0], [0.3, 0.0]], velocity=velocity, mass=mass, tau=1e12)
        crowds, engine = walk(model, pace, crowd, 40)
        after, report = crowds[-1].velocity, engine.report()
        told = "their total momentum changes by {:.3g} kg m/s; percussions on both must be opposite and equal"
        require_close(mass @ after, mass @ velocity, 1e-6 * pace.slow, told)
        told = "they walk through each other; change the velocities of bodies with a negative gap"
        require(not np.allclose(after, velocity, atol=1e-3), told)
        gained = 0.5 * float(mass @ (after**2 - velocity**2).sum(axis=1)) / pace.slow**2
        stated = report["driving_work"] - report["contact_dissipation"] + report["contact_creation"]
        wrong = f"they gain {gained:.4g} J, but their percussions account for {stated:.4g} J"
        told = f"{wrong}; contacts.percussion must contain the percussions that changed the velocities"
        require_close(stated, gained, 1e-6 * (abs(gained) + 1.0), told)


def check_crowd(model: ContactModel, pace: Pace) -> None:
    """Check the report on people pressed against a wall; coordinates and order do not matter, nor who remembers.

    What contacts remember must be in the snapshot, and belong neither to one of two people, nor to x and y: in a scene
    that is rotated in the middle, bodies are in another order from then on.
    """
    with scene(f"{PRESSED}, {pace}"):
        crowds, engine = walk(model, pace, NINE_PEOPLE, 200, WALLS)
        report = engine.report()
        for key, value in report.items():
            is_valid = math.isfinite(value) and (value >= 0.0 or key in SIGNED)
            require(is_valid, f"reports {key} = {value}; percussions must be finite and not negative")
        counts, steps = [report[key] for key in ("steps", "sub_steps", "contacts")], 200 * pace.parts
        remedy = "let the step loop of evac.physics.driver make the steps"
        wrong = "reports {:.0f} steps, {:.0f} sub-steps and {:.0f} contacts".format(*counts)
        require(counts[0] == steps <= counts[1] and counts[2] > 0, f"{wrong} after {steps} steps; {remedy}")
        told, seen = report["greatest_overlap"], max(map(_greatest_overlap, crowds[:-1]))
        wrong = f"reports a largest overlap of {told:.2g} m, but one of {seen:.2g} m occurred"
        require(told >= seen - 1e-9, f"{wrong}; {remedy}")
    half, whole, shift = crowds[5], crowds[11].position, 3.25  # after 60 and 120 steps
    shifted = NINE_PEOPLE.replace(position=NINE_PEOPLE.position + shift)
    mixed = Crowd(**{name: array[ANOTHER_ORDER] for name, array in NINE_PEOPLE.values().items()})
    gaps = "use gaps and normals, not coordinates"
    memory = "keep it in contacts.memory, and components along normal and tangent instead of x and y"
    parts: list[tuple[str, Crowd, Any, FloatArray, str]] = [
        ("rotated by 90 degrees", _turned_people(NINE_PEOPLE), (WALLS, NORTH), _turned(half.position), gaps),
        ("shifted", shifted, (WALLS + shift, EAST), half.position + shift, gaps),
        ("in another order", mixed, (WALLS, EAST), half.position[ANOTHER_ORDER], memory),
    ]
    if model.memory:
        saved = walk(model, pace, NINE_PEOPLE, 60, WALLS)[1].snapshot()
        later = NINE_PEOPLE.replace(position=half.position, velocity=half.velocity)
        parts += [
            ("resumed in the middle", later, (WALLS, EAST, saved), whole, memory),
            ("rotated in the middle", _turned_people(later), (_turned(WALLS), NORTH, saved), _turned(whole), memory),
        ]
    for what, people, given, expected, remedy in parts:
        with scene(f"{PRESSED}, {what}, {pace}"):
            place = walk(model, pace, people, 60, *given)[0][-1].position
            tolerance = 0.0 if what.startswith("resumed") else TURN_TOLERANCE
            require_close(place, expected, tolerance, f"the motion differs by {{:.3g}} m; {remedy}")


def _greatest_overlap(crowd: Crowd) -> float:
    """Return the greatest overlap [m] of people in the square room with each other and with its walls."""
    first, second = np.triu_indices(len(crowd.position), 1)
    apart = np.hypot(*(crowd.position[first] - crowd.position[second]).T)
    at_walls = np.abs(crowd.position).max(axis=1) + crowd.radius - ROOM
    return float(max(0.0, (crowd.radius[first] + crowd.radius[second] - apart).max(), at_walls.max()))


def _turned(places: FloatArray) -> FloatArray:
    """Return positions (n, 2) or segments (n, 4) rotated by 90 degrees about the origin."""
    return np.stack([-places[:, 1::2], places[:, ::2]], axis=2).reshape(places.shape)


def _turned_people(crowd: Crowd) -> Crowd:
    return crowd.replace(position=_turned(crowd.position), velocity=_turned(crowd.velocity))


def check_solver(solver: Solver) -> None:
    """Check that the problem of a queue is solved, rigid and elastic, whatever work arrays contain, within limits.

    A solve that starts from the solution keeps it. A solve stops at its limit and reports the remaining residual.
    """
    with examining("its kernel solve"):
        call_solver.check(getattr(solver, "solve", None), "solve", type(solver))
    for what in ("rigid", "elastic"):
        with scene(f"a queue at a wall, {what} contacts"):
            problem = _problem(what == "elastic")
            for tolerance in (TOLERANCE, 10.0 * TOLERANCE):
                _solve(solver, problem, tolerance, LIMIT)
                wrong = f"does not solve it: the residual is {problem.residual:.3g} m/s after {LIMIT} iterations"
                remedy = "iterate until problem.residual is below the tolerance"
                require(problem.residual <= tolerance, f"{wrong}; {remedy}")
    for limit in (1, 2, 7):
        with scene(f"a queue at a wall, at most {counted(limit, 'iteration')}"):
            made = _solve(solver, _problem(), 1e-14, limit)
            told = f"makes {made} iterations, but its limit is {limit}; stop at the limit, and return their number"
            require(0 < made <= limit, told)
    with scene("a queue at a wall, work arrays with numbers and with NaN"):
        filled, cleared = _problem(), _problem()
        filled.residual = math.nan
        for array in (getattr(filled, name) for name in WORK):
            array[...] = math.nan if array.dtype == np.float64 else 1
        for problem in (filled, cleared):
            _solve(solver, problem, TOLERANCE, LIMIT)
        same = (filled.percussion == cleared.percussion).all() and (filled.velocity == cleared.velocity).all()
        require(same, "the result depends on previous values of work arrays; initialise them")


def _problem(elastic: bool = False) -> Problem:
    """Return the problem of a step, without percussions, also with an elastic term; work arrays are zero."""
    places = [(2.3, -0.41), *((2.3 - 0.4 * k, 0.02 * (k % 2)) for k in range(12))]  # the first one stands beside
    _, engine = walk(solved_model()(), PLAIN, make_crowd(places, speed=1.5, mass=np.linspace(60, 100, 13)), 10, WALLS)
    problem: Problem = copy.deepcopy(engine.state.problem)
    rows = slice(0, problem.size)
    problem.percussion[:], problem.velocity[:], problem.rigid = 0.0, problem.free, int(not elastic)
    for name in WORK:
        getattr(problem, name)[...] = 0
    if elastic:
        bodies = np.hstack([problem.free[problem.body[rows]], problem.free[problem.other[rows]]])
        problem.elastic[rows, BEFORE] = (problem.data[rows, :4] * bodies).sum(axis=1)
        problem.elastic[rows, SPRING] = 0.5
    return problem


def _solve(solver: Solver, problem: Problem, tolerance: float, limit: int) -> int:
    """Solve a problem, check percussions, velocities and residual, and return the number of iterations."""
    exact, n, rows = copy.deepcopy(problem), problem.bodies, "of evac.physics.contact.rows"
    made = int(solver.solve(problem, tolerance, limit))
    changed = [name for name in GIVEN if not np.array_equal(getattr(exact, name), getattr(problem, name))]
    told = f"changes problem.{', '.join(changed)}, which solvers must not change; use a work array"
    require(not changed, told)
    percussion = problem.percussion[: exact.size] / exact.scale[: exact.size]
    told = f"a percussion is {percussion.min():.3g} N s; people can only push, so all must be finite and not negative"
    require(np.isfinite(percussion).all() and percussion.min() >= 0.0, told)
    exact.percussion[:] = problem.percussion
    renew_velocity(exact)
    unit = np.append(exact.inverse_root[:n], 1.0)[:, None]  # from scaled velocities to those of people
    found, velocity = problem.velocity[: n + 1] * unit, exact.velocity[: n + 1] * unit
    told = f"velocities are inconsistent with percussions by {{:.3g}} m/s; change both with push_row {rows}"
    require_close(found, velocity, LEAST + ROUNDING * float(np.abs(velocity).max()), told)
    residual = row_residual(exact)
    wrong = f"reports a residual of {problem.residual:.3g} m/s, which is {residual:.3g}"
    told = f"{wrong}; set problem.residual = row_residual(problem) {rows}"
    require_close(problem.residual, residual, LEAST + ROUNDING * residual, told)
    return made


CHECKS = (check_free_walk, check_collision, check_room, check_crowd)
