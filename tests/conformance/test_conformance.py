"""Everything registered holds to the contract; and each check finds what it is there for."""

import itertools

import numpy as np
import pytest

from evac.behaviour import Behaviour
from evac.conformance import check_plugin
from evac.errors import PluginError
from evac.jit import pair_force
from evac.output.recorder import Recorder
from evac.parameters import Parameter
from evac.physics.contact_model import ContactModel
from evac.physics.force import Force
from evac.registry import BUILTIN_PLUGINS, Registry
from evac.scenario.loading import load_case

REGISTRY = Registry()

#: Other values of built-in contact models that change what they compute.
VARIANTS = {
    "nsm1": [{"variant": "overdamped"}, {"solver": "uzawa"}],
    "nsm2": [{"normal_dissipation": 0.0}, {"tangential_dissipation": 100.0}, {"position_correction": True}],
}

#: Cases in which the built-in behaviours have something to do.
CASES = {
    "response_time": ("square_room", {"behaviours.response_time": {"time": {"uniform": [0.0, 2.0]}}}),
    "teacher_following": ("primary_school", {}),
    "route_choice": (
        "square_room",
        {"behaviours.route_choice": {"strategies": ["fastest", "shortest"], "every": 0.3}},
    ),
}


def models():
    for name in REGISTRY.contact_models:
        for values in [{}, *VARIANTS.get(name, [])]:
            yield pytest.param(name, values, id="-".join([name, *map(str, values.values())]))


@pytest.mark.parametrize(("name", "values"), list(models()))
def test_a_contact_model_conforms(name, values):
    check_plugin(REGISTRY.contact_models[name], **values)


@pytest.mark.parametrize("reading", ["isotropic", "anisotropic"])
def test_the_social_force_conforms(reading):
    check_plugin(REGISTRY.forces["social"], reading=reading)


@pytest.mark.parametrize("name", list(REGISTRY.forces))
def test_a_force_conforms(name):
    check_plugin(REGISTRY.forces[name])


@pytest.mark.parametrize("name", list(REGISTRY.recorders))
def test_a_recorder_conforms(name):
    check_plugin(REGISTRY.recorders[name])


@pytest.mark.parametrize("name", list(REGISTRY.behaviours))
def test_a_behaviour_conforms(name):
    source, changes = CASES.get(name, ("square_room", {f"behaviours.{name}": {}}))
    check_plugin(REGISTRY.behaviours[name], load_case(source, changes))


def test_built_ins_are_named_after_what_they_are():
    """Module kind_what, class What, name "what"; a force's and a recorder's class add their kind."""
    kinds = {
        "contact": REGISTRY.contact_models,
        "force": REGISTRY.forces,
        "behaviour": REGISTRY.behaviours,
        "recorder": REGISTRY.recorders,
    }
    for kind, table in kinds.items():
        for name, cls in table.items():
            if cls.__module__ in BUILTIN_PLUGINS:
                assert cls.__module__ == f"evac_plugins.{kind}_{name}"
                camel = "".join(word.capitalize() for word in name.split("_"))
                assert cls.__name__ in (camel, camel + kind.capitalize())


# Broken plugins: numpy contact models that break one promise each.


class Bounce(ContactModel):
    """A spring as the documented one, to be broken by what derives from it."""

    name = "bounce"
    stiffness = Parameter(1.2e5, "contact stiffness", unit="kg/s2", above=0.0)

    def step(self, contacts, h):
        contacts.impulse[:] = -h * self.stiffness * np.minimum(contacts.gap, 0.0)
        return self.pushed(contacts, contacts.impulse[:, None] * contacts.normal)

    def pushed(self, contacts, push):
        velocity = contacts.free.copy()
        pair = contacts.other >= 0
        np.add.at(velocity, contacts.body, push / contacts.mass[contacts.body, None])
        np.subtract.at(velocity, contacts.other[pair], push[pair] / contacts.mass[contacts.other[pair], None])
        return velocity


class Drags(Bounce):
    """Slows everybody down."""

    def step(self, contacts, h):
        return 0.99 * super().step(contacts, h)


class LooksAround(Bounce):
    """Depends on who is there at all."""

    def step(self, contacts, h):
        return super().step(contacts, h) + 1e-13 * (len(contacts.mass) - 1)


class OneSided(Bounce):
    """Pushes only one of two."""

    def pushed(self, contacts, push):
        velocity = contacts.free.copy()
        np.add.at(velocity, contacts.body, push / contacts.mass[contacts.body, None])
        return velocity


class Ghosts(Bounce):
    """Pushes nobody."""

    def pushed(self, contacts, push):
        return contacts.free.copy()


class Slanted(Bounce):
    """Knows x from y."""

    def pushed(self, contacts, push):
        return super().pushed(contacts, push * [1.0, 0.9])


class Divides(Bounce):
    """Divides by how far centres are apart."""

    def pushed(self, contacts, push):
        reach = contacts.radius[contacts.body] + np.where(contacts.other >= 0, contacts.radius[contacts.other], 0.0)
        with np.errstate(divide="ignore", invalid="ignore"):
            return super().pushed(contacts, push * (0.0 * reach / (contacts.gap + reach) + 1.0)[:, None])


class Silent(Bounce):
    """Does not say how hard it pushes."""

    def step(self, contacts, h):
        velocity = super().step(contacts, h)
        contacts.impulse[:] = 0.0
        return velocity


class Restless(Bounce):
    """Goes on from where the last run stopped."""

    def step(self, contacts, h):
        return super().step(contacts, h) + 1e-12 * next(COUNTER) * min(1, len(contacts.gap))


COUNTER = itertools.count()


class Forgetful(Bounce):
    """Keeps a count of steps that no state holds."""

    steps = 0

    def step(self, contacts, h):
        self.steps += min(1, len(contacts.gap))
        return super().step(contacts, h) + 1e-12 * self.steps * min(1, len(contacts.gap))


class Unsaid(Bounce):
    """Has a parameter without a sentence."""

    softness = Parameter(1.0, " ")


class OutOfRange(Bounce):
    """Has a default outside its own range."""

    softness = Parameter(1.0, "softness", above=2.0)


class Loses(Bounce):
    """Forgets its parameters."""

    def __init__(self, **values):
        pass

    @classmethod
    def declared(cls):
        return {"other": Parameter(1.0, "other")}

    def values(self):
        return {}


class Nameless(Bounce):
    """Has two words for a name."""

    name = "two words"


@pytest.mark.parametrize(
    ("cls", "words"),
    [
        (Drags, "touches nobody walks at"),
        (LooksAround, "5 m away changes a free walk"),
        (OneSided, "common momentum"),
        (Ghosts, "walk through each other"),
        (Slanted, "turned by 90 degrees moves differently"),
        (Divides, "velocity that is no number"),
        (Silent, "reports a contact force"),
        (Restless, "two runs differ"),
        (Forgetful, "a run resumed differs"),
        (Unsaid, "softness: no doc"),
        (OutOfRange, "softness: must be greater than 2"),
        (Loses, "parameters are lost"),
        (Nameless, "one word in lower case"),
    ],
)
def test_a_broken_contact_model_is_found(cls, words):
    with pytest.raises(PluginError, match=words):
        check_plugin(cls)


def test_a_model_that_steps_but_leaves_the_walls_open_is_found():
    class Open(Bounce):
        """Feels people, but no walls."""

        def step(self, contacts, h):
            velocity = super().step(contacts, h)
            is_wall = contacts.other < 0
            alone = np.isin(np.arange(len(velocity)), contacts.body[is_wall])
            velocity[alone] = contacts.free[alone]
            return velocity

    with pytest.raises(PluginError, match="would pass through a wall"):
        check_plugin(Open)


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
    pair = REGISTRY.forces["social"].pair

    def packed(self):
        return np.array([1.0, 0.1, 0.0, 1.0, 1.0])

    def is_needed(self):
        return False


@pytest.mark.parametrize(
    ("cls", "words"),
    [
        (Constant, "beyond its cutoff"),
        (Eastward, "does not turn"),
        (Singular, "must be finite there"),
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


class WritesUndeclared(Slower):
    """Sets routes it does not declare."""

    writes = ()


class ReadsUndeclared(Slower):
    """Looks at velocities without saying so."""

    reads = ()


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


@pytest.mark.parametrize(
    ("cls", "words"),
    [
        (WritesUndeclared, "writes an array that it does not declare"),
        (ReadsUndeclared, "reads velocity without declaring"),
        (SneaksIn, "writes 'velocity', which it does not declare"),
        (WritesPositions, "behaviours write start_time"),
        (Invents, "no array of"),
        (Remembers, "a run resumed differs"),
        (Left, "leaving out what is not needed changes"),
    ],
)
def test_a_broken_behaviour_is_found(cls, words):
    with pytest.raises(PluginError, match=words):
        check_plugin(cls)


def test_a_good_behaviour_passes():
    check_plugin(Slower)


def test_a_behaviour_is_checked_in_a_case_that_uses_it():
    with pytest.raises(PluginError, match="does not use behaviour 'slower'"):
        check_plugin(Slower, load_case("square_room"))


class Meddles(Recorder):
    """Stops everybody."""

    name = "meddles"

    def record(self, simulation):
        simulation.population.crowd.velocity[:] *= 0.5


def test_a_recorder_that_changes_something_is_found():
    with pytest.raises(PluginError, match=r"changes population\.velocity"):
        check_plugin(Meddles)


def test_what_is_no_plugin_is_refused():
    with pytest.raises(PluginError, match="derive it from one"):
        check_plugin(type("Stray", (Slower.__mro__[2],), {"name": "stray", "__doc__": "A stray."}))
