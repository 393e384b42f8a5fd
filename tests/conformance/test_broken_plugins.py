"""Each check of a force, a behaviour and a recorder finds the promise it is there for, broken."""

import numpy as np
import pytest

from evac.behaviour import Behaviour
from evac.conformance import check_plugin
from evac.errors import ConformanceWarning, PluginError
from evac.jit import body_force, pair_force
from evac.output.recorder import Recorder
from evac.parameters import Parameter
from evac.physics.contact_model import ContactModel
from evac.physics.force import Force
from evac.registry import Registry
from evac.scenario.loading import load_case

# Broken forces


@pair_force
def constant(gap, nx, ny, ex, ey, parameters):
    return parameters[0] * nx, parameters[0] * ny


@pair_force
def eastward(gap, nx, ny, ex, ey, parameters):
    if gap >= 1.0:
        return 0.0, 0.0
    return parameters[0], 0.0


@pair_force
def singular(gap, nx, ny, ex, ey, parameters):
    if gap >= 1.0:
        return 0.0, 0.0
    return nx / abs(gap), ny / abs(gap)


class Constant(Force):
    """Never ends."""

    name = "constant"
    pair = constant
    strength = Parameter(1.0, "strength", unit="N")

    def cutoff(self):
        return 1.0


class Eastward(Constant):
    """Does not turn."""

    name = "eastward"
    pair = eastward


class Singular(Constant):
    """Is infinite where people touch."""

    name = "singular"
    pair = singular


@body_force
def towards_walls(x, y, vx, vy, ex, ey, gap, nx, ny, parameters):
    return -parameters[0] * nx / gap, -gap * ny


@body_force
def endless(x, y, vx, vy, ex, ey, gap, nx, ny, parameters):
    return gap * nx, parameters[0]


class TowardsWalls(Constant):
    """Is infinite at a wall."""

    name = "towards_walls"
    pair = None
    body = towards_walls


class WithoutWalls(TowardsWalls):
    """Multiplies with the gap to a wall that may not be there."""

    name = "without_walls"
    body = endless


class Whole(Constant):
    """Packs whole numbers."""

    name = "whole"

    def packed(self):
        return np.array([1])


class Endless(Constant):
    """Has no cut-off."""

    name = "endless"

    def cutoff(self):
        return float("inf")


class Denied(Eastward):
    """Says that it is not needed, and pushes."""

    name = "denied"
    pair = Registry().forces["social"].pair

    def packed(self):
        return np.array([1.0, 0.1, 0.0, 1.0, 1.0])

    def is_needed(self):
        return False


@pytest.mark.parametrize(
    ("cls", "words"),
    [
        (Constant, "beyond its cutoff"),
        (Eastward, "rotate"),
        (Singular, "must be finite there"),
        (TowardsWalls, "gap of 0.000 m .*must be finite there"),
        (WithoutWalls, "gap of inf m .*must be finite there"),
        (Whole, "float64"),
        (Endless, "finite and not negative"),
        (Denied, "is_needed"),
    ],
)
def test_a_broken_force_is_found(cls, words):
    with pytest.raises(PluginError, match=words):
        check_plugin(cls)


# Broken behaviours and recorders


class Slower(Behaviour):
    """Slows everybody a little; declares what it touches."""

    name = "slower"
    reads = ("velocity",)
    writes = ("speed_factor",)

    def act(self, crowd, time):
        crowd.speed_factor[np.hypot(*crowd.velocity.T) > 0.5] *= 0.9


class Misspelt(Behaviour):
    """Means to act."""

    name = "misspelt"

    def acts(self, crowd, time):
        raise AssertionError("never called")


class WritesUndeclared(Slower):
    """Sets routes it does not declare."""

    writes = ()


class ReadsUndeclared(Slower):
    """Looks at velocities without saying so."""

    reads = ()


class ReadsForces(Slower):
    """Looks at contact forces, which are worked out at every tick only for who declares it."""

    def act(self, crowd, time):
        crowd.speed_factor[crowd.contact_force > 300.0] *= 0.5


class SneaksIn(Slower):
    """Writes through the base of a read-only array."""

    def act(self, crowd, time):
        crowd.velocity.base[:] += 1e-9


class WritesPositions(Slower):
    """Wants to move people itself."""

    writes = ("position",)


class Invents(Slower):
    """Declares an array that nobody has."""

    reads = ("mood",)


class Remembers(Slower):
    """Has private arrays that it does not hand over."""

    def prepare(self, scene):
        self.calls = 0

    def act(self, crowd, time):
        self.calls += 1
        crowd.speed_factor[:] = 1.0 / self.calls


class Left(Slower):
    """Says that it is not needed, and is."""

    def is_needed(self, scene):
        return False


class LateReader(Slower):
    """Looks at velocities after a while."""

    reads = ()

    def act(self, crowd, time):
        if time > 6.0:
            crowd.speed_factor[np.hypot(*crowd.velocity.T) > 0.5] *= 0.9


class CrushReader(Slower):
    """Looks at contact forces in crowds that are denser than any of the shipped case."""

    reads = ("position", "level")

    def act(self, crowd, time):
        place = crowd.position[crowd.level >= 0]
        if len(place) > 1 and np.ptp(place, axis=0).max() < 0.1:
            crowd.speed_factor[crowd.contact_force > 10.0] *= 0.5


class LastReader(Slower):
    """Treats the last one specially."""

    reads = ("level",)

    def act(self, crowd, time):
        if (crowd.level >= 0).sum() == 1:
            crowd.speed_factor[crowd.tau > 0.2] *= 0.5


class Idles(Slower):
    """Has lines that are not reached."""

    name = "idles"

    def act(self, crowd, time):
        if len(crowd.velocity) > 1000:
            crowd.speed_factor[:] *= 0.9


@pytest.mark.parametrize(
    ("cls", "words"),
    [
        (Misspelt, r"act\(\) or prepare\(\)"),
        (WritesUndeclared, "writes an array"),
        (LateReader, "reads velocity"),
        (CrushReader, "reads contact_force"),
        (LastReader, "reads tau"),
        (ReadsUndeclared, "reads velocity"),
        (ReadsForces, "reads contact_force"),
        (SneaksIn, "writes 'velocity'"),
        (WritesPositions, "behaviours write start_time"),
        (Invents, "Crowd does not have"),
        (Remembers, r"resumed .*state\(\)"),
        (Left, r"is_needed\(\)"),
    ],
)
def test_a_broken_behaviour_is_found(cls, words):
    with pytest.raises(PluginError, match=words):
        check_plugin(cls)


def test_a_good_behaviour_passes():
    check_plugin(Slower)


def test_lines_that_no_scene_reaches_are_named():
    with pytest.warns(ConformanceWarning, match=r"^idles: check_declared_arrays: lines \d+ of .*give a case"):
        check_plugin(Idles)


def test_a_behaviour_is_checked_in_a_case_that_uses_it():
    with pytest.raises(PluginError, match="behaviour 'slower'"):
        check_plugin(Slower, load_case("square_room"))


class Meddles(Recorder):
    """Stops everybody."""

    name = "meddles"

    def record(self, simulation):
        simulation.population.crowd.velocity[:] *= 0.5


def test_a_recorder_that_changes_something_is_found():
    with pytest.raises(PluginError, match=r"population\.velocity"):
        check_plugin(Meddles)


class Keeps(Slower):
    """Keeps something, and does not say whether it matters."""

    def prepare(self, scene):
        self.scratch = np.zeros(3)


class Counts(Recorder):
    """Writes at the end how often it was called."""

    name = "counts"

    def start(self, simulation):
        self.calls = 0

    def record(self, simulation):
        self.calls += 1

    def finish(self, simulation, results):
        if simulation.folder is not None and hasattr(self, "calls"):
            (simulation.folder / "calls.txt").write_text(str(self.calls))


class CountsAnew(Counts):
    """Says that it has nothing to keep."""

    def state(self):
        return {}

    def restore(self, simulation, state):
        self.calls = 0


class Appends(Recorder):
    """Appends to a file, and does not say how far it has got."""

    name = "appends"

    def record(self, simulation):
        if simulation.folder is not None:
            with (simulation.folder / "appends.txt").open("a") as file:
                file.write(f"{simulation.time}\n")


@pytest.mark.parametrize(
    ("cls", "words"),
    [
        (Keeps, r"'slower' has the attributes scratch .* state\(\)"),
        (Counts, r"recorder 'counts' has the attributes calls .* state\(\)"),
        (CountsAnew, r"calls\.txt differs"),
        (Appends, r"appends\.txt differs"),
    ],
)
def test_what_keeps_something_without_state_is_found(cls, words):
    with pytest.raises(PluginError, match=words):
        check_plugin(cls)


def test_what_is_no_plugin_is_refused():
    with pytest.raises(PluginError, match="Stray"):
        check_plugin(type("Stray", (Slower.__mro__[2],), {"name": "stray", "__doc__": "A stray."}))


def test_a_name_that_hides_a_key_of_a_case_is_refused():
    with pytest.raises(PluginError, match=r"\.name 'model'"):
        check_plugin(type("Odd", (ContactModel,), {"name": "model", "__doc__": "Odd."}))


def test_a_name_that_is_taken_is_refused():
    with pytest.raises(PluginError, match="behaviour 'route_choice'"):
        check_plugin(type("Odd", (Slower,), {"name": "route_choice", "__doc__": "Odd."}))


class Exhausted(Slower):
    """Takes from what is empty."""

    def act(self, crowd, time):
        next(iter(()))


def test_a_behaviour_that_fails_is_not_taken_for_one_that_is_not_used():
    with pytest.raises(PluginError, match="StopIteration"):
        check_plugin(Exhausted)
