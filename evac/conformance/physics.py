"""Checks of contact models, solvers and forces by themselves: in a square room, on a queue, and for single calls.

Failures have one form: ``plugin: check, what is examined: what is wrong; remedy``. A check calls `require` within a
block of `examining` or `scene`, and is called by `run_check`.
"""

import copy
import math
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from evac.base.arrays import FloatArray
from evac.base.errors import EvacError, PluginError, counted, in_one_line, place_of, text_of
from evac.contract.registry import Registry
from evac.physics.contact.model import ContactModel, SolvedContactModel, border_scene
from evac.physics.contact.pair_contact import PairContact
from evac.physics.contact.rows import BEFORE, SPRING, Solver, renew_velocity, row_residual
from evac.physics.engine import CompiledEngine, check_solve, functions_of
from evac.physics.force import Force, is_of_person, packed_row
from evac.physics.scenes import one_direction, room
from evac.physics.state import Crowd, Problem, copy_of, make_crowd
from evac.physics.world import make_world


class CheckError(PluginError):
    """A check has failed: what is wrong, by how much, and after a semicolon what to change; `place` was examined."""

    place = ""


def require(holds: bool | np.bool_, failure: str) -> None:
    """Raise a `CheckError` with a text, what is wrong and the remedy, if something does not hold."""
    if not holds:
        raise CheckError(failure)


def require_close(first: ArrayLike, second: ArrayLike, tolerance: float, failure: str) -> None:
    """Raise a `CheckError` if arrays are not finite, or further apart than a tolerance; the text has a field for it."""
    apart = float(np.abs(np.subtract(first, second)).max())
    require(apart <= tolerance, failure.format(apart))


@contextmanager
def examining(what: str, remedy: str = "correct the plugin") -> Iterator[None]:
    """Name what is examined in failures, the innermost block first, and turn exceptions without a remedy into such."""
    try:
        yield
    except (KeyboardInterrupt, GeneratorExit):
        raise
    except BaseException as error:
        failure, cause = error, error.__cause__
        if not isinstance(failure, CheckError):
            is_own = isinstance(error, EvacError)  # its text without the advice to check the plugin
            text = text_of(Exception.__str__(error)) if is_own else f"raises {in_one_line(error)} ({place_of(error)})"
            failure = CheckError(text if is_own and "; " in text else f"{text}; {remedy}")
            cause = (is_own and cause) or error
        failure.place = failure.place or what
        raise failure from cause


def scene(title: str) -> AbstractContextManager[None]:
    """Name the scene in failures, as `examining`."""
    return examining(f"scene '{title}'")


def run_check(plugin: Any, check: Callable[..., Any], *arguments: Any, advice: str = "") -> Any:
    """Run a check of a plugin class and return its result; the cause of a failure is the exception of the plugin.

    The advice follows the remedy if there was an exception.
    """
    try:
        with examining("the class"):
            return check(*arguments)
    except CheckError as failure:
        names, place = [getattr(plugin, key, None) for key in ("name", "__name__")], place_of(plugin)
        name = next((name for name in names if isinstance(name, str) and name), repr(plugin))
        wrong, _, remedy = failure.args[0].rpartition("; ")
        where = "" if ", line " in wrong or place == "no file" else f" ({place})"
        what = f"{name}: {check.__name__}, {failure.place}"
        advice = advice if failure.__cause__ else ""
        raise PluginError(f"{what}: {wrong}{where}; {remedy}{advice}") from failure.__cause__


#: Step [s], of which a tick has ten; half the side of the square room, and the level around it [m].
STEP, ROOM, LEVEL = 0.01, 2.5, (-20.0, -20.0, 20.0, 20.0)

WALLS = ROOM * np.array([(-1, -1, 1, -1), (1, -1, 1, 1), (1, 1, -1, 1), (-1, 1, -1, -1)])
EAST, NORTH, NOWHERE = np.array([1.0, 0.0]), np.array([0.0, 1.0]), np.zeros((0, 4))

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


#: The registered plugins, and a contact model among them that solves contact problems.
REGISTRY = Registry()
SOLVED = next(model for model in REGISTRY.contact_models.values() if issubclass(model, SolvedContactModel))


def walk(
    model: ContactModel,
    crowd: Crowd,
    steps: int,
    walls: FloatArray = NOWHERE,
    ahead: FloatArray = EAST,
    saved: dict[str, NDArray[Any]] | None = None,
) -> tuple[list[Crowd], CompiledEngine]:
    """Return copies of a crowd that walks ahead after each tick of plain steps, or of two steps, and the engine."""
    world = make_world(room(LEVEL, walls), one_direction(LEVEL, ahead))
    engine = CompiledEngine(world, len(crowd.level), [], solvers=REGISTRY.solvers)
    crowd = copy_of(crowd)
    model.check_scene(border_scene(crowd, STEP, True))
    if saved is not None:
        engine.load(model)
        engine.restore(saved)
    total, tick, crowds = *((steps, 10) if steps else (2, 1)), []
    for first in range(0, total, tick):
        engine.advance(model, crowd, first, tick, STEP, True, True)
        crowds.append(copy_of(crowd))
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


def check_room(model: ContactModel) -> None:
    """Check that people at one place, pressed or thrown against a wall stay in the room."""
    for title, people, steps in (
        # For two steps; later, stiff contacts throw them far.
        ("two people at one place", make_crowd([[0.0, 0.0], [0.0, 0.0], [ROOM, 0.0]], speed=1.0), 0),
        (PRESSED, NINE_PEOPLE, 200),
        ("a person pushed towards a wall", make_crowd([[2.0, 0.0]], [[10.0, 0.0]], speed=2.0, tau=0.1), 50),
    ):
        with scene(f"{title}"):
            for crowd in walk(model, people, steps, WALLS)[0]:
                beyond = np.abs(crowd.position).max(axis=1) - ROOM
                (x, y), far = crowd.position[beyond.argmax()], beyond.max()
                wrong = f"a person passed through the wall, at ({x:.2f}, {y:.2f}), {far:.2g} m beyond it"
                require(far <= 0.0, f"{wrong}; apply percussions at walls too, where contacts.other is -1")


def check_free_walk(model: ContactModel) -> None:
    """Check that a person without contacts moves by eq. 33, bitwise equal alone and with distant people."""
    steps, speed, tau = 60, 1.5, 0.5
    exact = speed if model.overdamped else speed * (1.0 - (1.0 - STEP / tau) ** steps)
    both, places = [[0.0, 0.0], [0.0, 5.0]], []
    for title, people in (("a person without contacts", both[:1]), ("two people 5 m apart", both)):
        with scene(f"{title}"):
            crowd = walk(model, make_crowd(people, speed=speed, tau=tau), 60)[0][-1]
            wrong = f"walks at {crowd.velocity[0, 0]:.9f} m/s after {steps} steps, not at {exact:.9f} m/s"
            require_close(crowd.velocity[0], [exact, 0.0], 1e-9, f"{wrong}; return the free velocity")
            places.append(crowd.position[0])
            require_close(places[0], places[-1], 0.0, "they differ by {:.3g} m; use only the given contacts")


def check_collision(model: ContactModel) -> None:
    """Check that two people who collide do not pass through each other, and conserve momentum and energy."""
    if model.overdamped:
        return
    with scene("two people who collide"):
        velocity, mass = np.array([[1.5, 0.0], [-1.0, 0.0]]), np.array([60.0, 100.0])
        crowds, engine = walk(model, make_crowd([[-0.3, 0.0], [0.3, 0.0]], velocity, mass=mass, tau=1e12), 40)
        after, report = crowds[-1].velocity, engine.report()
        failure = "their total momentum changes by {:.3g} kg m/s; percussions on both must be opposite and equal"
        require_close(mass @ after, mass @ velocity, 1e-6, failure)
        is_changed = not np.allclose(after, velocity, atol=1e-3)
        require(is_changed, "they walk through each other; change the velocities of bodies with a negative gap")
        gained = 0.5 * float(mass @ (after**2 - velocity**2).sum(axis=1))
        stated = report["driving_work"] - report["contact_dissipation"] + report["contact_creation"]
        wrong = f"they gain {gained:.4g} J, but their percussions account for {stated:.4g} J"
        failure = f"{wrong}; contacts.percussion must contain the percussions that changed the velocities"
        require_close(stated, gained, 1e-6 * (abs(gained) + 1.0), failure)


def check_crowd(model: ContactModel) -> None:
    """Check that people pressed against a wall overlap as promised, in any coordinates and order, whoever remembers."""
    with scene(f"{PRESSED}"):
        crowds, engine = walk(model, NINE_PEOPLE, 120, WALLS)
        stated, seen = engine.report()["greatest_overlap"], max(crowd.overlap.max() for crowd in crowds)
        wrong = f"reports a largest overlap of {stated:.2g} m, but one of {seen:.2g} m occurred"
        require(stated >= seen, f"{wrong}; let the step loop of evac.physics.stepping make the steps")
    half, whole = crowds[5], crowds[11]
    mixed = Crowd(**{name: array[ANOTHER_ORDER] for name, array in NINE_PEOPLE.values().items()})
    turned = NINE_PEOPLE.replace(position=_turned(NINE_PEOPLE.position))
    memory = "keep it in contacts.memory, and components along normal and tangent instead of x and y"
    scenes: list[tuple[str, Crowd, Any, FloatArray, str]] = [
        ("rotated by 90 degrees", turned, (WALLS, NORTH), _turned(half.position), "use gaps and normals"),
        ("in another order", mixed, (WALLS, EAST), half.position[ANOTHER_ORDER], memory),
    ]
    if model.memory:
        # From the snapshot on, bodies are in another order.
        later = NINE_PEOPLE.replace(position=_turned(half.position), velocity=_turned(half.velocity))
        given = _turned(WALLS), NORTH, walk(model, NINE_PEOPLE, 60, WALLS)[1].state()
        scenes.append(("rotated in the middle", later, given, _turned(whole.position), memory))
    for what, people, given, expected, remedy in scenes:
        with scene(f"{PRESSED}, {what}"):
            # Solvers may make other numbers of iterations.
            place = walk(model, people, 60, *given)[0][-1].position
            require_close(place, expected, 1e-4, f"the motion differs by {{:.3g}} m; {remedy}")


def _turned(places: FloatArray) -> FloatArray:
    """Return positions (n, 2) or segments (n, 4) rotated by 90 degrees about the origin."""
    return np.stack([-places[:, 1::2], places[:, ::2]], axis=2).reshape(places.shape)


def check_solver(solver: Solver) -> None:
    """Check that the problem of a queue is solved, rigid and elastic, whatever work arrays contain, within limits."""
    with examining("its solve"):
        check_solve(type(solver), "solve")
    solutions = []
    for what, spring, work in (("rigid", 0.0, 0.0), ("elastic", 0.5, 0.0), ("rigid", 0.0, math.nan)):
        with scene(f"a queue at a wall, {what} contacts, {work:g} in work arrays"):
            problem = _problem(spring, work)
            _solve(solver, problem, TOLERANCE, LIMIT)
            wrong = f"does not solve it: the residual is {problem.residual:.3g} m/s after {LIMIT} iterations"
            require(problem.residual <= TOLERANCE, f"{wrong}; iterate until problem.residual is below the tolerance")
            solutions.append(np.append(problem.percussion, problem.velocity))
            same = len(solutions) < 3 or np.array_equal(solutions[0], solutions[2])
            require(same, "the result depends on previous values of work arrays; initialise them")
    for limit in (1, 2, 7):
        with scene(f"a queue at a wall, at most {counted(limit, 'iteration')}"):
            made = _solve(solver, _problem(), 1e-14, limit)
            require(0 < made <= limit, f"makes {made} iterations, but its limit is {limit}; stop at the limit")


def _problem(spring: float = 0.0, work: float = 0.0) -> Problem:
    """Return the problem of a step, without percussions, with an elastic term and a number in all work arrays."""
    places = [(2.3, -0.41), *((2.3 - 0.4 * k, 0.02 * (k % 2)) for k in range(12))]  # the first one stands beside
    _, engine = walk(SOLVED(), make_crowd(places, speed=1.5, mass=np.linspace(60, 100, 13)), 10, WALLS)
    problem: Problem = copy.deepcopy(engine.data.problem)
    problem.percussion[:], problem.velocity[:], problem.rigid = 0.0, problem.free, int(spring == 0.0)
    for array in (getattr(problem, name) for name in WORK):
        array[...] = work if array.dtype == np.float64 else 0
    if spring > 0.0:
        rows = slice(0, problem.size)
        bodies = np.hstack([problem.free[problem.body[rows]], problem.free[problem.other[rows]]])
        problem.elastic[rows, BEFORE] = (problem.data[rows, :4] * bodies).sum(axis=1)
        problem.elastic[rows, SPRING] = spring
    return problem


def _solve(solver: Solver, problem: Problem, tolerance: float, limit: int) -> int:
    """Solve a problem, check percussions, velocities and residual, and return the number of iterations."""
    exact, rows = copy.deepcopy(problem), "of evac.physics.contact.rows"
    made = int(solver.solve(problem, tolerance, limit))
    changed = [name for name in GIVEN if not np.array_equal(getattr(exact, name), getattr(problem, name))]
    require(not changed, f"changes problem.{', '.join(changed)}, which solvers must not change; use a work array")
    percussion = problem.percussion[: exact.size] / exact.scale[: exact.size]
    is_push = bool((percussion >= 0.0).all() and np.isfinite(percussion).all())
    require(is_push, f"a percussion is {percussion.min():.3g} N s; people can only push, so none may be negative")
    exact.percussion[:] = problem.percussion
    renew_velocity(exact)
    unit = np.append(exact.inverse_root[: exact.bodies], 1.0)[:, None]  # from scaled velocities to those of people
    stated, velocity = problem.velocity[: len(unit)] * unit, exact.velocity[: len(unit)] * unit
    failure = f"velocities are inconsistent with percussions by {{:.3g}} m/s; change both with push_row {rows}"
    require_close(stated, velocity, LEAST + ROUNDING * float(np.abs(velocity).max()), failure)
    residual = row_residual(exact)
    wrong = f"reports a residual of {problem.residual:.3g} m/s, which is {residual:.3g}"
    failure = f"{wrong}; set problem.residual = row_residual(problem) {rows}"
    require_close(problem.residual, residual, LEAST + ROUNDING * residual, failure)
    return made


def check_force(force: Force) -> None:
    """Check that forces are finite; those of two people are zero beyond the cut-off, and rotate with the scene."""
    functions_of(force)
    with examining("its is_needed()"):
        needed = force.is_needed()
    cutoff, random = force.cutoff(), np.random.default_rng(1)
    gaps = (-0.3, 0.0, *random.uniform(-0.3, max(cutoff, 0.1), 100), cutoff, cutoff + 1e-9, 2.0 * cutoff + 1.0)
    for gap in (*gaps, math.inf):
        n, e = (np.array([math.cos(angle), math.sin(angle)]) for angle in random.uniform(0.0, 2.0 * math.pi, 2))
        v, place = random.uniform(-3.0, 3.0, 2), random.uniform(-50.0, 50.0, 2)
        with scene(f"two people at a gap of {gap:.3f} m"):
            if force.pair is not None and math.isfinite(gap):
                own = (random.uniform(-2.0, 2.0, 2), (80.0, 1.3, 0.0)) if is_of_person(force.pair) else ()
                x, y = push = _call(force, force.pair, gap, n, v, e, *own)
                size = f"the force is {math.hypot(x, y):.3g} N"
                require(needed or not push.any(), f"is_needed() is False, but {size}; return True from it")
                require(gap < cutoff or not push.any(), f"{size}, beyond its cutoff() of {cutoff:.3f} m; return zero")
                failure = "the force does not rotate with the scene, but differs by {:.3g} N; use the given normal"
                vectors = [np.array([-one[1], one[0]]) for one in (n, v, e, *own[:1])]
                turned = _call(force, force.pair, gap, *vectors, *own[1:])
                require_close(turned, [-y, x], 1e-9 * max(math.hypot(x, y), 1.0), failure)
        if gap == 0.0:  # a person who stands, without a way out
            e = v = np.zeros(2)
        with scene(f"a person at a gap of {gap:.3f} m to the nearest wall, at {math.hypot(*v):.2f} m/s"):
            if force.body is not None:
                _call(force, force.body, *place, v, e, gap, n if math.isfinite(gap) else np.zeros(2))


def _call(force: Force, function: Callable[..., tuple[float, float]], *given: float | FloatArray) -> FloatArray:
    """Return the force, after checking that it is finite and leaves its parameters unchanged."""
    packed = force.packed()
    before = packed.copy()
    with np.errstate(all="ignore"):
        returned = function(*np.hstack(given).tolist(), packed)
    require(np.shape(returned) == (2,), f"the function returns {returned!r}; return the two components [N]")
    require(np.isfinite(returned).all(), "the force is ({}, {}) N; it must be finite there".format(*returned))
    require(np.array_equal(packed, before), "the function changes its parameters; only return the force")
    return np.array(returned, dtype=np.float64)
