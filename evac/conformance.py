"""What every plugin has to hold to: checks that plugin authors call in their own tests.

::

    from evac.conformance import check_plugin

    def test_my_model():
        check_plugin(MyModel)                       # contact model, force, recorder
        check_plugin(MyBehaviour, case)             # a behaviour in a case in which it has something to do

Each check raises `PluginError` that says what was broken, by how much, and what to change. The same checks
run over everything that evac itself registers.
"""

import math
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from shapely.geometry import box

from evac.behaviour import Behaviour
from evac.building.model import Building, Level
from evac.directions.fields import Fields
from evac.directions.routes import Route
from evac.errors import PluginError, SimulationError
from evac.output.recorder import Recorder
from evac.parameters import Configurable, Parameter
from evac.physics.bundles import Crowd
from evac.physics.contact_model import ContactModel
from evac.physics.engine import Engine
from evac.physics.force import Force
from evac.physics.world import make_world
from evac.registry import Registry
from evac.scenario.loading import load_case
from evac.scenario.schema import Case
from evac.simulation import Simulation

FloatArray = NDArray[np.float64]
State = dict[str, NDArray[Any]]

#: What behaviours may write.
WRITABLE = ("start_time", "route", "speed_factor", "extra_direction")

#: Step of the scenes made here [s], ticks of ten steps.
STEP = 0.01

#: How far positions may differ after a turn or a shift of the whole scene [m]; iterative solvers stop earlier or later.
TURN_TOLERANCE = 1e-4

#: Half the side of the square room that people are pressed into [m].
ROOM = 2.5

#: Case that a plugin is tried in where its author gives none.
SHIPPED_CASE = "square_room"


def check_plugin(cls: type[Configurable], case: Case | None = None, ticks: int = 20, **values: Any) -> None:
    """Run every check that concerns a plugin class.

    Parameters
    ----------
    cls : type
        A `ContactModel`, `Force`, `Behaviour` or `Recorder`.
    case : Case, optional
        Case that uses the plugin as it stands; by default the shipped square room, with the plugin in use.
    ticks : int
        Ticks of the case that are run.
    **values
        Parameters to set, instead of the defaults, where no case is given.

    Raises
    ------
    PluginError
        The first promise found broken.
    """
    check_metadata(cls)
    if issubclass(cls, ContactModel):
        for check_model in CONTACT_MODEL_CHECKS:
            check_model(cls(**values))
    elif issubclass(cls, Force):
        for check_force in FORCE_CHECKS:
            check_force(cls(**values))
    case = _case_with(cls, values) if case is None else case
    if issubclass(cls, Behaviour):
        check_declared_arrays(case, cls.name, ticks)
    elif issubclass(cls, Recorder):
        check_looks_only(cls(**values), case, ticks)
    check_same_bits(case, ticks)


def check_metadata(cls: type[Configurable]) -> None:
    """Name, docstring, and every parameter with a type, a unit, a sentence and a legal default."""
    name = getattr(cls, "name", "")
    if not isinstance(name, str) or not name.isidentifier() or name != name.lower():
        raise PluginError(f"{cls.__name__}.name is {name!r}; it must be one word in lower case, as a case names it")
    if not (cls.__doc__ or "").strip():
        raise PluginError(f"{name}: {cls.__name__} has no docstring; its first line is what `evac plugins` shows")
    for key, parameter in cls.declared().items():
        if not parameter.doc.strip():
            raise PluginError(f"{name}.{key}: no doc; say in one sentence what it is")
        if _is_bounded(parameter) and not isinstance(parameter.default, (int, float)) and not parameter.distribution:
            raise PluginError(f"{name}.{key}: bounds on {parameter.default!r}, which is no number")
        parameter.check(f"{name}.{key}", parameter.default)
    made = cls()
    if set(made.values()) != set(cls.declared()):
        raise PluginError(f"{name}: its parameters are lost in __init__; call super().__init__(**values) first")
    if isinstance(made, Behaviour):
        _check_declarations(made)


def _is_bounded(parameter: Parameter) -> bool:
    return (parameter.minimum, parameter.above, parameter.maximum) != (None, None, None)


def _check_declarations(behaviour: Behaviour) -> None:
    for array in (*behaviour.reads, *behaviour.writes):
        if array not in Crowd._fields:
            raise PluginError(f"{behaviour.name}: declares {array!r}, which is no array of evac.physics.bundles.Crowd")
    for array in behaviour.writes:
        if array not in WRITABLE:
            raise PluginError(f"{behaviour.name}: declares to write {array!r}; behaviours write {', '.join(WRITABLE)}")


# Contact models


def check_free_walk(model: ContactModel) -> None:
    """Who touches nobody walks as eq. 33 says, to the last bits the same alone and with others far away."""
    n, speed, tau = 60, 1.5, 0.5
    alone, _ = _walked(model, _crowd([[0.0, 0.0]], speed=speed, tau=tau), n)
    two, _ = _walked(model, _crowd([[0.0, 0.0], [0.0, 5.0]], speed=speed, tau=tau), n)
    exact = speed if model.overdamped else speed * (1.0 - (1.0 - STEP / tau) ** n)
    if not np.allclose(alone.velocity[0], [exact, 0.0], rtol=0.0, atol=1e-9):
        raise PluginError(
            f"{model.name}: somebody who touches nobody walks at {alone.velocity[0, 0]:.9f} m/s after {n} steps, not at "
            f"{exact:.9f} m/s; without contacts the velocity after a step must be the free one"
        )
    if not np.array_equal(alone.position[0], two.position[0]):
        raise PluginError(f"{model.name}: somebody 5 m away changes a free walk; use only the contacts given")


def check_momentum(model: ContactModel) -> None:
    """Two people who run into each other keep their common momentum, and do feel each other."""
    if model.overdamped:
        return
    crowd = _crowd([[-0.3, 0.0], [0.3, 0.1]], velocity=[[1.5, 0.0], [-1.0, 0.2]], mass=[60.0, 100.0], tau=1e12)
    before = crowd.mass @ crowd.velocity
    start = crowd.velocity.copy()
    crowd, _ = _walked(model, crowd, 40)
    lost = float(np.abs(crowd.mass @ crowd.velocity - before).max())
    if not lost <= 1e-6:
        raise PluginError(
            f"{model.name}: two people who run into each other change their common momentum by {lost:.3g} kg m/s; "
            "what pushes one must push the other back"
        )
    if np.allclose(crowd.velocity, start, atol=1e-3):
        raise PluginError(f"{model.name}: two people walk through each other; solve the contacts given")


def check_turn_and_shift(model: ContactModel) -> None:
    """A scene turned by 90 degrees, or shifted, gives the same motion, turned or shifted."""
    plain = _pressed(model, 60)[0].position
    for what, turn, shift in (("turned by 90 degrees", True, 0.0), ("shifted", False, 3.25)):
        moved = _pressed(model, 60, turn, shift)[0].position - shift
        if turn:
            moved = np.column_stack([moved[:, 1], -moved[:, 0]])
        apart = float(np.abs(moved - plain).max())
        if not apart <= TURN_TOLERANCE:
            raise PluginError(
                f"{model.name}: a scene {what} moves differently, by {apart:.3g} m; use gaps and normals, not coordinates"
            )


def check_coincident_centres(model: ContactModel) -> None:
    """Two people at one place, and one on a wall, give no NaN."""
    crowd = _crowd([[0.0, 0.0], [0.0, 0.0], [ROOM, 0.0]], speed=1.0)
    crowd, _ = _walked(model, crowd, 20, walls=_room())
    if not (np.isfinite(crowd.position).all() and np.isfinite(crowd.velocity).all()):
        raise PluginError(f"{model.name}: two people at one place end in NaN; never divide by a distance or a gap")


def check_walls(model: ContactModel) -> None:
    """A crowd pressed against a wall, and somebody thrown at it, stay inside."""
    felt: list[float] = []
    crowd, engine = _pressed(model, 200, watch=lambda crowd: felt.append(float(crowd.contact_force.max())))
    thrown, _ = _walked(
        model, _crowd([[2.0, 0.0]], velocity=[[10.0, 0.0]], speed=2.0, tau=0.1), 50, walls=_room()
    )
    for people in (crowd, thrown):
        outside = np.flatnonzero(np.abs(people.position).max(axis=1) > ROOM)
        if len(outside):
            x, y = people.position[outside[0]]
            raise PluginError(f"{model.name}: somebody is through the wall, at ({x:.2f}, {y:.2f}); push against walls too")
    if not model.overdamped and not max(felt) > 0.0:
        raise PluginError(f"{model.name}: nobody pressed against a wall reports a contact force; fill contacts.impulse")
    for key, value in engine.report().items():
        if not (math.isfinite(value) and (value >= 0.0 or key in _SIGNED)):
            raise PluginError(f"{model.name}: reports {key} = {value}; counts and sizes are finite and not negative")


def check_report(model: ContactModel) -> None:
    """The report counts the steps and contacts, and knows the greatest overlap that can be seen."""
    seen: list[float] = []
    _, engine = _pressed(model, 200, watch=lambda crowd: seen.append(_greatest_overlap(crowd)))
    report = engine.report()
    if report["steps"] != 200 or report["sub_steps"] < 200 or report["contacts"] <= 0:
        raise PluginError(
            f"{model.name}: reports {report['steps']:.0f} steps, {report['sub_steps']:.0f} sub-steps and "
            f"{report['contacts']:.0f} contacts after 200 steps of a pressed crowd; call the kernels of evac.physics.stepping"
        )
    if report["greatest_overlap"] < max(seen[:-1]) - 1e-9:
        raise PluginError(
            f"{model.name}: reports a greatest overlap of {report['greatest_overlap']:.2g} m where one of "
            f"{max(seen[:-1]):.2g} m is seen"
        )


_SIGNED = ("driving_work", "contact_dissipation", "contact_creation")

CONTACT_MODEL_CHECKS: tuple[Callable[[ContactModel], None], ...] = (
    check_free_walk,
    check_momentum,
    check_turn_and_shift,
    check_coincident_centres,
    check_walls,
    check_report,
)


# Forces


def check_pair_force(force: Force) -> None:
    """Finite everywhere, zero from the cut-off on, turning with the scene, and leaving its parameters alone."""
    packed = force.packed()
    if packed.dtype != np.float64 or packed.ndim != 1 or not np.isfinite(packed).all():
        raise PluginError(f"{force.name}: packed() must return finite numbers in one float64 row, not {packed!r}")
    if not hasattr(force.pair, "address"):
        raise PluginError(f"{force.name}: pair must be compiled by evac.jit.pair_force")
    cutoff = force.cutoff()
    if not (math.isfinite(cutoff) and cutoff >= 0.0):
        raise PluginError(f"{force.name}: cutoff() is {cutoff} m; it must be finite and not negative")
    before = packed.copy()
    random = np.random.default_rng(1)
    greatest = 0.0
    for gap in (-0.3, 0.0, *random.uniform(-0.3, max(cutoff, 0.1), 100), cutoff, cutoff + 1e-9, 2.0 * cutoff + 1.0):
        normal, ahead = random.uniform(0.0, 2.0 * math.pi, 2)
        n, e = (math.cos(normal), math.sin(normal)), (math.cos(ahead), math.sin(ahead))
        try:
            x, y = force.pair(gap, *n, *e, packed)
        except ArithmeticError as error:
            raise PluginError(f"{force.name}: {error} at a gap of {gap:.3f} m; it must be finite there") from error
        if not (math.isfinite(x) and math.isfinite(y)):
            raise PluginError(f"{force.name}: is ({x}, {y}) N at a gap of {gap:.3f} m; it must be finite there")
        if gap >= cutoff and (x, y) != (0.0, 0.0):
            raise PluginError(f"{force.name}: is ({x:.3g}, {y:.3g}) N at {gap:.3f} m, beyond its cutoff() of {cutoff:.3f} m")
        turned_x, turned_y = force.pair(gap, -n[1], n[0], -e[1], e[0], packed)
        size = math.hypot(x, y)
        greatest = max(greatest, size)
        if math.hypot(turned_x + y, turned_y - x) > 1e-9 * max(size, 1.0):
            raise PluginError(f"{force.name}: does not turn with the scene; use the normal and the direction given")
    if not np.array_equal(packed, before):
        raise PluginError(f"{force.name}: writes to its parameters; return the force only")
    if greatest > 0.0 and not force.is_needed():
        raise PluginError(f"{force.name}: is_needed() is False, yet it pushes with {greatest:.3g} N")


FORCE_CHECKS: tuple[Callable[[Force], None], ...] = (check_pair_force,)


# In a case


def check_same_bits(case: Case, ticks: int = 20) -> None:
    """The same case gives the same bits: again, stopped and resumed, and with nothing left out."""
    whole, middle = _run(case, ticks)
    if different := _difference(whole, _run(case, ticks)[0]):
        raise PluginError(f"{case.title}: two runs differ in {different}; draw from scene.generator only")
    resumed = Simulation(case)
    resumed.restore(middle)
    while resumed.step < whole["simulation.step"][0]:
        resumed.advance_tick()
    if different := _difference(whole, resumed.state()):
        raise PluginError(f"{case.title}: a run resumed differs in {different}; state() must hold every private array")
    full, _ = _run(case, ticks, full=True)
    moving = {key: value for key, value in whole.items() if key.startswith("population.") and key != "population.route"}
    if different := _difference(moving, full):
        raise PluginError(f"{case.title}: leaving out what is not needed changes {different}; see is_needed()")


def check_declared_arrays(case: Case, name: str, ticks: int = 20) -> None:
    """A behaviour touches only the arrays that it declares."""
    try:
        simulation = Simulation(case, full=True)
        behaviour, scene = next(pair for pair in simulation.behaviours if pair[0].name == name)
        scene.crowd = watched = _WatchedCrowd(*scene.crowd)
        crowd = simulation.population.crowd
        behaviour.prepare(scene)
        for _ in range(ticks):
            before = {key: array.copy() for key, array in crowd._asdict().items() if key not in behaviour.writes}
            behaviour.act(scene.crowd, simulation.time)
            for key, array in before.items():
                if not np.array_equal(array, getattr(crowd, key), equal_nan=True):
                    raise PluginError(f"{name}: writes {key!r}, which it does not declare")
            if simulation.ended:
                break
            simulation.advance_tick()
    except StopIteration:
        raise PluginError(f"{case.title}: does not use behaviour {name!r}; give a case that does") from None
    except ValueError as error:
        if "read-only" not in str(error):
            raise
        raise PluginError(f"{name}: writes an array that it does not declare in `writes`: {error}") from error
    if undeclared := sorted(watched.seen - {*behaviour.reads, *behaviour.writes}):
        raise PluginError(f"{name}: reads {', '.join(undeclared)} without declaring it in `reads`")


def check_looks_only(recorder: Recorder, case: Case, ticks: int = 5) -> None:
    """A recorder changes nothing, works with and without a result folder, and can finish a run that never started."""
    with tempfile.TemporaryDirectory() as place:
        for folder in (None, Path(place)):
            simulation = Simulation(case, folder)
            simulation.recorders = []
            type(recorder)(**recorder.values()).finish(simulation, None)
            recorder.start(simulation)
            for _ in range(ticks):
                before = simulation.state()
                recorder.record(simulation)
                if different := _difference(before, simulation.state()):
                    raise PluginError(f"{recorder.name}: changes {different}; a recorder looks only")
                simulation.advance_tick()
            recorder.finish(simulation, simulation.results())


class _WatchedCrowd(Crowd):
    """A crowd that notes which arrays are asked for."""

    def __getattribute__(self, name: str) -> Any:
        if name in Crowd._fields:
            self.seen.add(name)
        return super().__getattribute__(name)

    @property
    def seen(self) -> set[str]:
        noted: set[str] = self.__dict__.setdefault("noted", set())
        return noted


def _case_with(cls: type[Configurable], values: dict[str, Any]) -> Case:
    """Return the shipped case with the plugin in use, registered if it is not."""
    registry = Registry()
    if issubclass(cls, ContactModel):
        registry.contact_models.setdefault(cls.name, cls)
        changes = {"contact.model": cls.name, f"contact.{cls.name}": values}
    elif issubclass(cls, Force):
        registry.forces.setdefault(cls.name, cls)
        changes = {f"forces.{cls.name}": values}
    elif issubclass(cls, Behaviour):
        registry.behaviours.setdefault(cls.name, cls)
        changes = {f"behaviours.{cls.name}": values}
    elif issubclass(cls, Recorder):
        registry.recorders.setdefault(cls.name, cls)
        changes = {}
    else:
        raise PluginError(f"{cls.__name__} is no ContactModel, Force, Behaviour or Recorder; derive it from one")
    return load_case(SHIPPED_CASE, changes, registry=registry)


def _run(case: Case, ticks: int, full: bool = False) -> tuple[State, State]:
    """Return the state after so many ticks, and after half of them."""
    simulation = Simulation(case, full=full)
    middle = simulation.state()
    for tick in range(ticks):
        if simulation.ended:
            break
        if tick == ticks // 2:
            middle = simulation.state()
        simulation.advance_tick()
    return simulation.state(), middle


def _difference(first: State, second: State) -> str:
    """Return the name of the first array that differs, or nothing."""
    for key, value in first.items():
        if key not in second or not np.array_equal(value, second[key], equal_nan=value.dtype.kind == "f"):
            return key
    return ""


# Scenes


def _room() -> list[tuple[float, float, float, float]]:
    corners = [(-ROOM, -ROOM), (ROOM, -ROOM), (ROOM, ROOM), (-ROOM, ROOM)]
    return [(*corner, *corners[(k + 1) % 4]) for k, corner in enumerate(corners)]


def _pressed(
    model: ContactModel,
    steps: int,
    turn: bool = False,
    shift: float = 0.0,
    watch: Callable[[Crowd], None] = lambda crowd: None,
) -> tuple[Crowd, Engine]:
    """Press nine people of different sizes against a wall of a closed room, in a scene turned and shifted."""
    spread = np.array([[(k % 3) * 0.6 + 0.07 * k, (k // 3) * 0.55 - 0.6 + 0.05 * (k % 3)] for k in range(9)])
    position, walls = spread + [0.2, 0.0], np.array(_room())
    if turn:
        position = np.column_stack([-position[:, 1], position[:, 0]])
        walls = np.column_stack([-walls[:, 1], walls[:, 0], -walls[:, 3], walls[:, 2]])
    crowd = _crowd(
        position + shift,
        speed=np.linspace(1.2, 2.0, 9),
        radius=np.linspace(0.25, 0.18, 9),
        mass=np.linspace(60.0, 100.0, 9),
        tau=0.3,
    )
    return _walked(model, crowd, steps, walls + shift, (0.0, 1.0) if turn else (1.0, 0.0), watch)


def _greatest_overlap(crowd: Crowd) -> float:
    """Return the greatest overlap of two people or of one with the room's walls [m], not below zero."""
    first, second = np.triu_indices(len(crowd.radius), 1)
    apart = np.hypot(*(crowd.position[first] - crowd.position[second]).T)
    between = crowd.radius[first] + crowd.radius[second] - apart
    outside = np.abs(crowd.position).max(axis=1) + crowd.radius - ROOM
    return max(0.0, float(between.max()), float(outside.max()))


def _crowd(position: Any, velocity: Any = None, speed: Any = 0.0, radius: Any = 0.2, mass: Any = 80.0, tau: Any = 0.5) -> Crowd:
    """Return people on level 0; numbers hold for all of them."""
    place = np.array(position, dtype=np.float64)
    n = len(place)
    zeros = {field: np.zeros(n) for field in ("start_time", "distance", "contact_force")}
    whole = {field: np.zeros(n, np.int32) for field in ("level", "group", "route")}
    return Crowd(
        position=place,
        velocity=np.zeros((n, 2)) if velocity is None else np.array(velocity, dtype=np.float64),
        radius=np.full(n, radius, dtype=np.float64),
        mass=np.full(n, mass, dtype=np.float64),
        tau=np.full(n, tau, dtype=np.float64),
        speed=np.repeat(np.full(n, speed, dtype=np.float64)[:, None], 3, axis=1),
        speed_factor=np.ones(n),
        extra_direction=np.zeros((n, 2)),
        exit_time=np.full(n, np.nan),
        exit_used=np.full(n, -1, np.int32),
        **zeros,
        **whole,
    )


def _walked(
    model: ContactModel,
    crowd: Crowd,
    steps: int,
    walls: Any = (),
    direction: tuple[float, float] = (1.0, 0.0),
    watch: Callable[[Crowd], None] = lambda crowd: None,
) -> tuple[Crowd, Engine]:
    """Make so many steps on one flat level where everybody wants to go the same way; watch after each tick."""
    extent = 20.0
    walls = np.array(walls, dtype=np.float64).reshape(-1, 4)
    level = Level(0, "floor", "floor", None, np.zeros((0, 3), np.int32), box(-extent, -extent, extent, extent), np.zeros(2), 0.0, 0.0, 0.0)
    building = Building(
        Path("conformance"), np.zeros((0, 3)), (level,), (), (), (), walls, np.zeros(len(walls), np.int32), {}
    )
    nodes = np.array([[-extent, -extent], [-extent, extent], [extent, -extent], [extent, extent]])
    fields = Fields(
        routes=(Route(),),
        grid_origin=np.full((1, 2), -extent),
        grid_shape=np.full((1, 2), 2, np.int32),
        spacing=2.0 * extent,
        field_of=np.zeros((1, 1), np.int32),
        field_offset=np.zeros(1, np.int64),
        direction=np.tile(np.array(direction, dtype=np.float64), (4, 1)),
        travel_time=100.0 - nodes @ np.array(direction),
        graph=None,
    )
    engine = Engine(make_world(building, fields), len(crowd.level), [])
    for first in range(0, steps, 10):
        try:
            engine.advance(model, crowd, first, 10, STEP, True, True)
        except SimulationError as error:
            raise PluginError(f"{model.name}: cannot step through a plain scene: {error}") from error
        watch(crowd)
    return crowd, engine
