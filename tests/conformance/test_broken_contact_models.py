"""Each check of a contact model finds the promise it is there for, broken."""

import itertools

import numpy as np
import pytest

from evac.conformance import check_plugin
from evac.errors import PluginError
from evac.jit import pair_contact
from evac.parameters import Parameter
from evac.physics.contact_model import ContactModel
from evac.physics.pair_contact import PairContact


class Bounce(ContactModel):
    """A spring as the documented one, to be broken by what derives from it."""

    name = "bounce"
    stiffness = Parameter(1.2e5, "contact stiffness", unit="kg/s2", above=0.0)

    def step(self, contacts, h):
        contacts.percussion[:] = -h * self.stiffness * np.minimum(contacts.gap, 0.0)
        return self.pushed(contacts, contacts.percussion[:, None] * contacts.normal)

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
        contacts.percussion[:] = 0.0
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


class CountsTwice(Bounce):
    """Reports twice the percussion that it applies."""

    def step(self, contacts, h):
        velocity = super().step(contacts, h)
        contacts.percussion[:] *= 2.0
        return velocity


class InPlace(Bounce):
    """Writes to the free velocities."""

    def step(self, contacts, h):
        contacts.free[:] = super().step(contacts, h)
        return contacts.free


class WrongShape(Bounce):
    """Returns one velocity for all."""

    def step(self, contacts, h):
        return contacts.free[:1]


class Hides(Bounce):
    """Has a parameter with the name of a method."""

    step = Parameter(1.0, "step")


class Nameless(Bounce):
    """Has two words for a name."""

    name = "two words"


@pytest.mark.parametrize(
    ("cls", "words"),
    [
        (Drags, "free velocity"),
        (CountsTwice, "percussions"),
        (InPlace, "ValueError: .* read-only"),
        (WrongShape, r"\(1, 2\), not \(2, 2\)"),
        (Hides, "name of a method"),
        (LooksAround, "5 m away"),
        (OneSided, "momentum"),
        (Ghosts, "walk through each other"),
        (Slanted, "90 degrees"),
        (Divides, "step returned the velocity"),
        (Silent, r"contacts\.percussion"),
        (Restless, "two runs differ"),
        (Forgetful, r"resumed .*state\(\)"),
        (Unsaid, "softness: .*doc"),
        (OutOfRange, "softness: must be greater than 2"),
        (Loses, "__init__"),
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

    with pytest.raises(PluginError, match="wall"):
        check_plugin(Open)


@pytest.mark.parametrize("stiffness", [3e3, 6e4, 1e6, 5e7])
def test_a_good_model_conforms_whatever_its_stiffness(stiffness):
    check_plugin(Bounce, stiffness=stiffness)


class Tunes(Bounce):
    """Has the same frequency for every pair: twice the mass, twice the stiffness."""

    name = "tunes"
    frequency = Parameter(8.0, "frequency", unit="1/s", above=0.0)

    def step(self, contacts, h):
        mass = 1.0 / contacts.mass[contacts.body]
        mass = 1.0 / (mass + np.where(contacts.other >= 0, 1.0 / contacts.mass[contacts.other], 0.0))
        contacts.percussion[:] = -h * mass * self.frequency**2 * np.minimum(contacts.gap, 0.0)
        return self.pushed(contacts, contacts.percussion[:, None] * contacts.normal)


def test_a_model_may_scale_with_mass():
    check_plugin(Tunes)


def test_a_failure_names_check_scene_and_remedy():
    with pytest.raises(PluginError, match=r"^bounce: check_momentum: two people who .*; percussions on both"):
        check_plugin(OneSided)
    with pytest.raises(PluginError, match=r"^bounce: check_same_bits: 20 ticks of 'Twenty people .*; state\(\) must"):
        check_plugin(Forgetful)


@pair_contact
def pulls(gap, closing_speed, reduced_mass, parameters):
    return parameters[0] * gap


@pair_contact
def divides(gap, closing_speed, reduced_mass, parameters):
    return parameters[0] * gap / gap


@pair_contact
def scribbles(gap, closing_speed, reduced_mass, parameters):
    parameters[0] += 1.0
    return -parameters[0] * gap


class Pulls(PairContact):
    """Pulls people who overlap together."""

    name = "pulls"
    pair = pulls
    stiffness = Parameter(1e5, "stiffness", unit="kg/s2")


class DividesGaps(Pulls):
    """Divides by the gap."""

    name = "divides"
    pair = divides


class Scribbles(Pulls):
    """Changes its parameters."""

    name = "scribbles"
    pair = scribbles


@pytest.mark.parametrize(
    ("cls", "words"),
    [(Pulls, "never positive"), (DividesGaps, "finite there"), (Scribbles, "changes its parameters")],
)
def test_a_broken_law_of_a_contact_is_found(cls, words):
    with pytest.raises(PluginError, match=rf"^{cls.name}: check_pair_law: .*{words}"):
        check_plugin(cls)
