"""Forces at a distance: their base class and kernels; and checks of the numbers that functions of plugins read."""

import ast
import inspect
import math
import reprlib
import textwrap
from abc import ABC, abstractmethod
from collections.abc import Iterator, Sequence
from contextlib import suppress
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from evac.base.arrays import FloatArray
from evac.base.errors import EvacError, fault, in_one_line
from evac.base.parameters import Configurable
from evac.jit import AddressCall, Entry, call_body_force, call_pair_force, call_person_force, inner, kernel, row
from evac.physics.contact.contacts import wall_normal
from evac.physics.contact.neighbours import segment_distance, unit_normal
from evac.physics.extent import extent, greatest_extent
from evac.physics.motion import desired_speed
from evac.physics.seams import is_absent, touches
from evac.physics.state import Forces, State
from evac.physics.status import OK


class Force(Configurable, ABC):
    """Base class of forces between two people, on one person, or both, which are evaluated in every sub-step.

    A subclass names compiled functions, and packs its parameters into the float64 array that they read.
    """

    #: Force between two people closer than the cut-off, a function compiled by `evac.jit.pair_force`.
    pair: ClassVar[Any] = None

    #: Force on each person, a function compiled by `evac.jit.body_force`.
    body: ClassVar[Any] = None

    def packed(self) -> NDArray[np.float64]:
        """Return the parameters (p,) float64 that the functions read; by default all declared numbers."""
        return np.array(list(self.values().values()), dtype=np.float64)

    @abstractmethod
    def cutoff(self) -> float:
        """Return the gap [m] beyond which people, or walls, have no influence; 0 if the force depends on neither."""

    def is_needed(self) -> bool:
        """Return False if the force is zero everywhere and can be omitted."""
        return True


#: Call `add_forces`, or `add_body_forces`, at its address: each is loaded only if there are such forces.
call_add_forces = AddressCall([State], (int,))


@kernel
def add_forces(state: State) -> int:
    """Add the forces at a distance of all pairs within the cut-off to ``bodies.push``; return the status OK."""
    bodies, lists, forces = state.bodies, state.lists, state.forces
    for i in range(bodies.inside):
        if bodies.level[i] < 0:
            continue
        ax, ay = bodies.position[i, 0], bodies.position[i, 1]
        for slot in range(lists.pair_start[i], lists.pair_start[i + 1]):
            j = lists.pair_body[slot]
            if bodies.level[j] < 0:
                continue
            bx, by = bodies.position[j, 0], bodies.position[j, 1]
            nx, ny = ax - bx, ay - by
            limit = greatest_extent(bodies, i) + greatest_extent(bodies, j) + forces.farthest
            square = nx * nx + ny * ny
            if square >= limit * limit or not touches(state, bodies.level[i], ax, ay, bodies.level[j], bx, by):
                continue
            nx, ny, distance = unit_normal(nx, ny, square)
            gap = distance - extent(bodies, i, -nx, -ny) - extent(bodies, j, nx, ny)
            vx = bodies.velocity[i, 0] - bodies.velocity[j, 0]
            vy = bodies.velocity[i, 1] - bodies.velocity[j, 1]
            for f in range(forces.number):
                if gap < forces.cutoff[f]:
                    _push(state, f, i, gap, nx, ny, vx, vy)
                    _push(state, f, j, gap, -nx, -ny, -vx, -vy)
    return OK


@inner
def _push(state, f, i, gap, nx, ny, vx, vy):
    """Add force f between two people to the push of body i, unless it is spared because it waits."""
    bodies, forces = state.bodies, state.forces
    if forces.spare_waiting and state.clock.time < bodies.start_time[i]:
        return
    call, given = forces.address[f], row(forces.parameters, f)
    ex, ey = bodies.desired[i, 0], bodies.desired[i, 1]
    if forces.of_person[f] == 1:
        ux, uy, mass = bodies.velocity[i, 0], bodies.velocity[i, 1], bodies.mass[i]
        speed, group = desired_speed(state.world, bodies, i, ex, ey), bodies.group[i]
        fx, fy = call_person_force(call, gap, nx, ny, vx, vy, ex, ey, ux, uy, mass, speed, group, given)
    else:
        fx, fy = call_pair_force(call, gap, nx, ny, vx, vy, ex, ey, given)
    bodies.push[i, 0] += fx
    bodies.push[i, 1] += fy


@kernel
def add_body_forces(state: State) -> int:
    """Add the forces on single people to ``bodies.push``; return a status, OK."""
    bodies, forces = state.bodies, state.body_forces
    for i in range(bodies.inside):
        if bodies.level[i] < 0:
            continue
        x, y = bodies.position[i, 0], bodies.position[i, 1]
        vx, vy = bodies.velocity[i, 0], bodies.velocity[i, 1]
        ex, ey = bodies.desired[i, 0], bodies.desired[i, 1]
        nearest, nx, ny = _nearest_wall(state, i, forces.farthest)
        for f in range(forces.number):
            gap, ux, uy = math.inf, 0.0, 0.0
            if nearest < forces.cutoff[f]:
                gap, ux, uy = nearest, nx, ny
            given = row(forces.parameters, f)
            fx, fy = call_body_force(forces.address[f], x, y, vx, vy, ex, ey, gap, ux, uy, given)
            bodies.push[i, 0] += fx
            bodies.push[i, 1] += fy
    return OK


@inner
def _nearest_wall(state, i, reach):
    """Return the gap to the nearest wall of body i and the unit vector towards the body; infinity from `reach` on."""
    # Walls of other levels are reached through portals, as in contacts.
    world, bodies, lists = state.world, state.bodies, state.lists
    x, y = bodies.position[i, 0], bodies.position[i, 1]
    nearest, nx, ny = greatest_extent(bodies, i) + reach, 0.0, 0.0
    is_found = False
    for slot in range(lists.wall_start[i], lists.wall_start[i + 1]):
        w = lists.wall_item[slot]
        distance, px, py = segment_distance(world.wall, w, x, y)
        if distance >= nearest or is_absent(world, bodies, w, i):
            continue
        if touches(state, bodies.level[i], x, y, world.wall_level[w], px, py):
            nx, ny = wall_normal(world, bodies, i, w, x - px, y - py, distance)
            nearest = distance
            is_found = True
    if is_found:
        return nearest - extent(bodies, i, -nx, -ny), nx, ny
    return math.inf, 0.0, 0.0


def packed_row(plugin: Any, what: str) -> FloatArray:
    """Return the packed parameters (p,) of a force or a contact model, as its functions read them."""
    remedy = "define packed(), which returns the numbers that the function reads in a float64 array"
    packed: FloatArray = _called(plugin, "packed", what, remedy)
    is_row = isinstance(packed, np.ndarray) and packed.dtype == np.float64 and packed.ndim == 1
    if not (is_row and np.isfinite(packed).all()):
        kind = f" of {packed.dtype}" if isinstance(packed, np.ndarray) else ""
        got = f"packed() returns {reprlib.repr(packed)}{kind}"
        raise fault(what, got, "return finite numbers in a float64 array with one axis", plugin, "packed")
    return packed


def check_indices(entry: Entry, length: int, what: str, argument: int = -1, source: str = "packed() returns") -> None:
    """Check the indices written as numbers in a function, by default those of its parameters; kernels do not check."""
    code = entry.function.__code__
    name = code.co_varnames[code.co_argcount + argument]
    for index, line in _indices(entry, name):
        if not 0 <= index < length:
            numbers = f"{source} {length} numbers" if length != 1 else f"{source} one number"
            wrong, place = f"{entry.title} reads {name}[{index}], but {numbers}", (code.co_filename, line)
            raise fault(what, wrong, "correct the index", place)


def _indices(entry: Entry, name: str) -> Iterator[tuple[int, int]]:
    """Yield constant indices of an argument of a function, each with its line; none without its source."""
    with suppress(OSError, TypeError, SyntaxError):
        lines, first = inspect.getsourcelines(entry.function)
        for node in ast.walk(ast.parse(textwrap.dedent("".join(lines)))):
            if isinstance(node, ast.Subscript) and isinstance(node.value, ast.Name) and node.value.id == name:
                with suppress(ValueError):
                    if isinstance(index := ast.literal_eval(node.slice), int):
                        yield index, first + node.lineno - 1


def cutoff_of(force: Force) -> float:
    """Return the cut-off [m] of a force."""
    what, remedy = f"force {force.name!r}", "return a distance [m], finite and not negative"
    cutoff = _called(force, "cutoff", what, remedy)
    if not (isinstance(cutoff, (int, float, np.number)) and math.isfinite(cutoff) and cutoff >= 0.0):
        raise fault(what, f"cutoff() returns {reprlib.repr(cutoff)}", remedy, force, "cutoff")
    return float(cutoff)


def _called(plugin: Any, method: str, what: str, remedy: str) -> Any:
    """Return the result of a method; its exceptions are mistakes of the plugin."""
    try:
        return getattr(plugin, method)()
    except (EvacError, KeyboardInterrupt, GeneratorExit):
        raise
    except BaseException as error:
        raise fault(what, f"{method}() raises {in_one_line(error)}", remedy, plugin, method) from error


def is_of_person(pair: Any) -> bool:
    """Return whether a force between two people takes the velocity, the mass and more of the person."""
    return isinstance(pair, Entry) and len(pair.signature[0]) == len(call_person_force.kinds)


def pack_forces(forces: Sequence[Force]) -> Forces:
    """Pack the cut-offs and parameters of forces; shorter parameter rows are padded with zeros."""
    rows = [packed_row(force, f"force {force.name!r}") for force in forces]
    parameters = np.zeros((len(rows), max(map(len, rows), default=1)))
    for k, own in enumerate(rows):
        parameters[k, : len(own)] = own
    cutoff = np.array([cutoff_of(force) for force in forces], dtype=np.float64)
    return Forces(
        number=len(rows),
        address=np.zeros(len(rows), dtype=np.int64),
        cutoff=cutoff,
        parameters=parameters,
        of_person=np.array([is_of_person(force.pair) for force in forces], dtype=np.uint8),
        farthest=float(cutoff.max(initial=0.0)),
        spare_waiting=0,
    )
