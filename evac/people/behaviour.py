"""Behaviours, by which people decide at each tick: the base class of behaviour plugins."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, TypeVar

import numpy as np
from numpy.typing import NDArray

from evac.base.arrays import FloatArray, IntArray
from evac.base.change import Change
from evac.base.errors import ScenarioError, fault, plugin_code, usable_path
from evac.base.parameters import Configurable, did_you_mean
from evac.base.saved import FINITE, Saved
from evac.building.model.building import Building
from evac.building.model.cells import LevelField
from evac.building.model.elevation import elevation
from evac.directions.fields import Fields
from evac.directions.routes import Route
from evac.jit import kernel
from evac.people.outside import Outside
from evac.physics.state import Crowd, World

if TYPE_CHECKING:
    from evac.simulation.scene import Scene


#: Least and greatest values of what behaviours write, in words.
_LEGAL = {
    "extra_direction": (-FINITE, FINITE, "finite"),
    "speed_factor": (0.0, FINITE, "finite and not negative"),
    "start_time": (-np.inf, np.inf, "a number, inf for never"),
}

#: Remedy for a behaviour that has written to an array that it does not declare in `writes`.
DECLARE = "add the array to `writes`"

WRITABLE = ("start_time", "route", "speed_factor", "extra_direction")  #: What behaviours may write.
NOBODY = np.zeros((0, 2))  #: Velocities of nobody.

Arrays = TypeVar("Arrays", Crowd, Outside)


class Behaviour(Configurable, Saved):
    """Acts on whole arrays at every tick; owns its private state.

    Attributes
    ----------
    reads, writes : tuple of str
        Names of `Crowd` arrays. The crowd passed to the behaviour is read-only except for the arrays in ``writes``,
        which may contain start_time, route, speed_factor and extra_direction.
    saved : tuple of str
        Names of the attributes that a checkpoint saves: numbers and arrays, in the order in which they are restored.
    """

    reads: ClassVar[tuple[str, ...]] = ()
    writes: ClassVar[tuple[str, ...]] = ()

    #: Whether it acts after all other behaviours, because it uses what they write, whatever the order in the case.
    acts_last: ClassVar[bool] = False

    #: Whether people slow down behind others before bodies touch. Only then `BehaviourScene.outside` exists: the
    #: people who have left, whom the behaviour sees as those ahead, and whose speed factors it multiplies, too.
    keeps_distance: ClassVar[bool] = False

    #: Whether people stand firm before their response time: forces between people do not act on them, but contacts do.
    stands_firm: ClassVar[bool] = False

    #: Whether it acts on the changes "alarm" of the scene; a case with an alarm needs such a behaviour.
    hears_alarms: ClassVar[bool] = False

    #: Whether it leads people by the places of kind "sign"; a case with a sign needs such a behaviour.
    follows_signs: ClassVar[bool] = False

    #: Keys that `people` groups may set for this behaviour, e.g. ``("teacher",)``.
    group_keys: ClassVar[tuple[str, ...]] = ()

    def contact_radius(self, radius: FloatArray, settings: Mapping[str, Any]) -> FloatArray:
        """Return the radii of the bodies that touch others and fit through gaps, for people of one group.

        It is called before the people are placed, and must not decrease with the radius. If several behaviours
        state radii, the smallest applies. `Crowd.radius` remains the radius for placing people and for pictures.

        Parameters
        ----------
        radius : (n,) float64 [m]
            Radii of people.
        settings : mapping
            The keys of the group for this behaviour, see `group_keys`.

        Returns
        -------
        (n,) float64 [m]
            At least 0.01, and at most `radius`.
        """
        return radius

    def routes(self) -> tuple[Route, ...]:
        """Return the routes that it may assign in addition to those of the groups; each needs a field.

        Returns
        -------
        tuple of Route
            They become rows of ``scene.fields.routes``.
        """
        return ()

    def prepare(self, scene: "BehaviourScene") -> None:
        """Set up once, before the first step; may write the declared arrays.

        Parameters
        ----------
        scene : BehaviourScene
        """

    def act(self, crowd: Crowd, time: float) -> None:
        """Act at one tick: write the declared arrays in place, given the current state of everybody.

        Parameters
        ----------
        crowd : Crowd
            Arrays of all people, including those who are out (level -1); read-only except for ``writes``.
        time : float
            Time of the tick [s].
        """

    def is_needed(self, scene: "BehaviourScene") -> bool:
        """Return False if the behaviour changes nothing in this scene and can be left out.

        Parameters
        ----------
        scene : BehaviourScene
            As `prepare` gets it.
        """
        return True

    def notes(self) -> tuple[str, ...]:
        """Return lines on people for the results, such as who was missing when a class was counted.

        They are printed after the run, and part of ``summary.json``, the report and the replay.
        """
        return ()

    def acts_at_ticks(self) -> bool:
        """Return False if `prepare` does all the work; called once, after `prepare`.

        `act` is then called only at the tick after a change of the scene.
        """
        return True

    def state(self) -> dict[str, NDArray[Any]]:
        """Return the private arrays that are needed to continue the run, by names of its own; they are copied.

        By default those that `saved` names.
        """
        return super().state()

    def restore(self, state: dict[str, NDArray[Any]]) -> None:
        """Restore the arrays that `state` returned."""
        super().restore(state)


class BehaviourScene:
    """The part of a simulation that a behaviour can access."""

    def __init__(
        self,
        crowd: Crowd,
        scene: "Scene",
        groups: tuple[Any, ...],
        generator: np.random.Generator,
        tick: float,
        outside: Outside | None = None,
        folder: Path = Path(),
        displacement_velocity: FloatArray = NOBODY,
        alarmed: tuple[str, ...] = (),
    ) -> None:
        self.alarmed = alarmed  #: places of the phases of the case, in which people wait for the alarm of their phase
        self.crowd = crowd  #: read-only except for the behaviour's ``writes``
        #: the current building, fields and world, and the changes so far; ``version`` is their number
        self.scene = scene
        #: each an `evac.people.population.Group`, whose settings are the keys of the group for this behaviour
        self.groups = groups
        self.generator = generator  #: generator of this behaviour alone, spawned from (seed, name)
        self.tick = tick  #: [s]
        self.folder = folder  #: the folder of the case
        self.files: list[Path] = []  #: the files requested with `file`
        self.level_fields: list[LevelField] = []  #: the fields created with `level_field`
        self._outside = outside
        self.displacement_velocity = displacement_velocity.view()
        self.displacement_velocity.flags.writeable = False

    @property
    def outside(self) -> Outside:
        """The people who have left, until 2 m behind their exit; read-only except for ``speed_factor``.

        Raises
        ------
        AttributeError
            The behaviour does not set ``keeps_distance``.
        """
        if self._outside is None:
            raise AttributeError(
                "scene.outside exists only for behaviours that keep distances; set keeps_distance = True"
            )
        return self._outside

    def file(self, name: str) -> Path:
        """Return the path of a data file of the behaviour, in the folder of the case or below it.

        A run is not resumed if the file has changed since the checkpoint.

        Parameters
        ----------
        name : str
            Name relative to the folder.

        Raises
        ------
        ScenarioError
            There is no such file, or it lies outside of the folder, with links resolved.
        """
        path = usable_path(self.folder / name, ScenarioError).resolve()
        if not path.is_relative_to(self.folder.resolve()):
            raise ScenarioError(f"{name!r} is outside of the case's folder, {self.folder}; put a copy into the folder")
        if not path.is_file():
            raise ScenarioError(f"{self.folder / name}: no such file; check the path")
        self.files.append(path)
        return path

    def level_field(self, name: str, unit: str, spacing: float = 1.0) -> LevelField:
        """Return a scalar field on all levels, for example the density of smoke, which only this behaviour writes.

        It is created by the first call, zero at first, recorded in the trajectory at each output time, and part of
        checkpoints. Others read it from ``scene.scene.fields_of_behaviours``. Call this method in `Behaviour.prepare`.

        Parameters
        ----------
        name : str
            No other behaviour has a field of this name.
        unit : str
        spacing : float
            Side of its square cells [m].

        Raises
        ------
        ValueError
            The name is in use, the run has begun, or the cells are too small.
        """
        own = {field.name: field for field in self.level_fields}
        if name not in own:
            own[name] = self.scene.add_field(name, unit, spacing)
            self.level_fields.append(own[name])
        return own[name]

    def people_in(self, where: Any, level: str = "") -> IntArray:
        """Return the rows of the people inside who are at a place or of a group; see `Scene.people_in`."""
        return self.scene.people_in(where, level)

    def begin_ways(self, rows: IntArray) -> None:
        """Count the progress of people anew, because they begin another way, such as back to where they were.

        A run ends when nobody has come nearer to the end of a route than ever before for ``no_progress``.
        """
        self.scene.begin_ways(rows)

    def apply(self, change: Change) -> None:
        """Change the scene: open or close exits, portals or stairs, now or later; see `Scene.apply`."""
        self.scene.apply(change)

    def elevation(self) -> FloatArray:
        """Return the height z of the ground under each person [m], (n,); NaN for people who have left.

        The behaviour must read ``level`` and ``position``.
        """
        return elevation(self.building, self.crowd.level, self.crowd.position)

    @property
    def building(self) -> Building:
        """The building with its current open and closed links."""
        return self.scene.building

    @property
    def fields(self) -> Fields:
        """The current directions."""
        return self.scene.fields

    @property
    def world(self) -> World:
        """Building and directions as kernels read them; it changes with the scene."""
        return self.scene.world

    @property
    def version(self) -> int:
        """A number that grows with each change of the scene that concerns people; those of lifts rarely do."""
        return self.scene.version

    @property
    def ways_version(self) -> int:
        """Number of those of them that changed the fields."""
        return self.scene.ways_version


def check_declared(behaviour: Behaviour) -> None:
    """Check that the arrays that a behaviour declares to read and write exist, and that behaviours may write them."""
    what = f"behaviour {behaviour.name!r}"
    for word, allowed in (("reads", tuple(Crowd.kinds)), ("writes", WRITABLE)):
        with plugin_code(f"{what}: {word}", behaviour):
            declared = getattr(behaviour, word)
        if not (isinstance(declared, tuple | list) and all(isinstance(array, str) for array in declared)):
            remedy = f"write {word} = ('{allowed[0]}',), for example"
            raise fault(what, f"{word} is {declared!r}, not a tuple of names", remedy, behaviour, word)
        for array in declared:
            if array not in allowed:
                hint = did_you_mean(array, allowed)
                raise fault(
                    what, f"{word} contains {array!r}, which behaviours cannot {word[:-1]}", hint, behaviour, word
                )


class DeclaredCrowd(Crowd):
    """A crowd of which only the arrays that a behaviour declares can be accessed, and only those written be changed."""

    def __getattribute__(self, name: str) -> Any:
        own = object.__getattribute__(self, "__dict__")
        if name in Crowd.kinds and name not in own.get("_declared", (name,)):
            raise AttributeError(f"crowd.{name} is not declared; add {name!r} to reads, or to writes if it is changed")
        return super().__getattribute__(name)


def crowd_for(behaviour: Behaviour, crowd: Crowd) -> Crowd:
    """Return views of a crowd's arrays, restricted to those that a behaviour declares, read-only but for its writes."""
    check_declared(behaviour)
    declared = DeclaredCrowd(**_views(crowd, behaviour.writes).values())
    declared.__dict__["_declared"] = frozenset((*behaviour.reads, *behaviour.writes))
    return declared


def outside_for(behaviour: Behaviour, outside: Outside) -> Outside | None:
    """Return views of the arrays of people outside, read-only except for the speed factors; None if it sees nobody."""
    return _views(outside, ("speed_factor",)) if behaviour.keeps_distance else None


def _views(arrays: Arrays, writable: Sequence[str]) -> Arrays:
    """Return views of the arrays of a struct, read-only except for those named."""
    views = {name: array.view() for name, array in arrays.values().items()}
    for name, view in views.items():
        view.flags.writeable = name in writable
    return type(arrays)(**views)


def check_written(
    behaviour: Behaviour,
    fields: Sequence[LevelField],
    crowd: Crowd,
    outside: Outside | None,
    routes: int,
    time: float,
) -> None:
    """Check the values that a behaviour wrote, which would otherwise appear as failures of the physics."""
    is_sound = is_legal(crowd, routes)
    is_sound_outside = outside is None or not behaviour.keeps_distance or has_legal_factors(outside)
    if is_sound and is_sound_outside and not fields:
        return
    what, cls = f"t = {time:.3f} s: behaviour {behaviour.name!r}", type(behaviour)
    method = cls.prepare if cls.act is Behaviour.act else cls.act
    checked: dict[str, FloatArray] = {}
    if not is_sound:
        checked = {name: getattr(crowd, name) for name in _LEGAL if name in behaviour.writes}
    if outside is not None and not is_sound_outside:
        checked["outside.speed_factor"] = outside.speed_factor
    for place, written in checked.items():
        least, most, legal = _LEGAL[place.removeprefix("outside.")]
        if not least <= written.min(initial=0.0) <= written.max(initial=0.0) <= most:  # also of NaN
            person = int(np.argwhere(~((written >= least) & (written <= most)))[0, 0])
            wrong = f"wrote {written[person]} to {place} of person {person}"
            raise fault(what, wrong, f"it must be {legal}", method)
    for field in fields:
        if not isinstance(field.values, np.ndarray) or field.values.shape != (field.size,):
            raise fault(what, f"replaces the values of its field {field.name!r}", "write them in place", method)
        if not np.isfinite(field.values).all():
            wrong = f"wrote {field.values[~np.isfinite(field.values)][0]} to its field {field.name!r}"
            raise fault(what, wrong, "values must be finite", method)
    if not is_sound and "route" in behaviour.writes:
        lost = np.flatnonzero((crowd.route < 0) | (crowd.route >= routes))
        if len(lost):
            wrong = f"wrote route {crowd.route[lost[0]]} for person {lost[0]}"
            raise fault(what, wrong, f"it must be from 0 to {routes - 1}, see Behaviour.routes", method)


@kernel
def has_legal_factors(outside: Outside) -> bool:
    """Return whether the speed factors of people outside are legal."""
    found = True
    for p in range(len(outside.level)):
        found = found and 0.0 <= outside.speed_factor[p] <= FINITE
    return found


@kernel
def is_legal(crowd: Crowd, routes: int) -> bool:
    """Return whether all that behaviours and programs may write of people is legal; NaN is not."""
    for p in range(len(crowd.route)):
        found = 0 <= crowd.route[p] < routes and crowd.start_time[p] == crowd.start_time[p]
        found = found and 0.0 <= crowd.speed_factor[p] <= FINITE
        for k in range(3):
            found = found and 0.0 <= crowd.speed[p, k] <= FINITE
        for k in range(2):
            found = found and -FINITE <= crowd.extra_direction[p, k] <= FINITE
        if not found:
            return False
    return True
