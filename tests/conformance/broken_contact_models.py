"""Broken contact models: by `step`, by a law, and by the force of a single contact."""

import itertools

import numpy as np

from evac.base.parameters import Parameter
from evac.jit import Struct, kernel, pair_contact, pair_friction
from evac.physics import tallies as at
from evac.physics.contact.contacts import push, use_free_velocity
from evac.physics.contact.model import ContactModel
from evac.physics.contact.pair_contact import PairContact
from evac.physics.state import State
from tests.conformance.broken import Broken, odd


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


class CountsTwice(Bounce):
    """Reports twice the percussion that it applies."""

    def step(self, contacts, h):
        velocity = super().step(contacts, h)
        contacts.percussion[:] *= 2.0
        return velocity


class Open(Bounce):
    """Feels people, but no walls."""

    def step(self, contacts, h):
        velocity = super().step(contacts, h)
        is_wall = contacts.other < 0
        alone = np.isin(np.arange(len(velocity)), contacts.body[is_wall])
        velocity[alone] = contacts.free[alone]
        return velocity


class Tunes(Bounce):
    """Has the same frequency for every pair: twice the mass, twice the stiffness."""

    name = "tunes"
    frequency = Parameter(8.0, "frequency", unit="1/s", above=0.0)

    def step(self, contacts, h):
        mass = 1.0 / contacts.mass[contacts.body]
        mass = 1.0 / (mass + np.where(contacts.other >= 0, 1.0 / contacts.mass[contacts.other], 0.0))
        contacts.percussion[:] = -h * mass * self.frequency**2 * np.minimum(contacts.gap, 0.0)
        return self.pushed(contacts, contacts.percussion[:, None] * contacts.normal)


class HidesOverlaps(Bounce):
    """Clears what the step loop has counted."""

    def advance(self, engine):
        status = super().advance(engine)
        engine.data.tally[at.GREATEST_OVERLAP] = 0.0
        return status


# Laws


class Softness(Struct):
    softness: float


@kernel
def without_parameters(state: State, h: float) -> int:
    return 0


@kernel
def idle(state: State, own: Softness, h: float) -> int:
    return 0


class Lawful(ContactModel):
    """Has a law that does nothing."""

    name = "lawful"
    law = idle
    softness = Parameter(1.0, "softness")


# Forces of a single contact


@pair_contact
def pulls(gap, closing_speed, reduced_mass, parameters):
    return parameters[0] * gap


@pair_contact
def scribbles(gap, closing_speed, reduced_mass, parameters):
    parameters[0] += 1.0
    return -parameters[0] * gap


class Pulls(PairContact):
    """Pulls people who overlap together."""

    name = "pulls"
    pair = pulls
    stiffness = Parameter(1e5, "stiffness", unit="kg/s2")


class Scribbles(Pulls):
    """Changes its parameters."""

    name = "scribbles"
    pair = scribbles


@pair_contact
def linear(gap, closing_speed, reduced_mass, parameters):
    return -parameters[0] * gap


class Linear(Pulls):
    """Pushes people apart, with a spring."""

    name = "linear"
    pair = linear


@pair_friction
def drives(gap, closing_speed, sliding_speed, reduced_mass, elapsed, memory, parameters):
    memory[0] = sliding_speed
    return -parameters[0] * gap, 10.0 * sliding_speed


class Sliding(Linear):
    """Drives people who slide."""

    name = "sliding"
    pair = drives
    memory = ("speed",)


class AlongAxes(Bounce):
    """Remembers a vector by its components along x and y."""

    name = "along_axes"
    memory = ("x", "y")

    def step(self, contacts, h):
        contacts.percussion[:] = -h * self.stiffness * np.minimum(contacts.gap, 0.0)
        tangent = np.column_stack([-contacts.normal[:, 1], contacts.normal[:, 0]])
        other = np.where(contacts.other[:, None] >= 0, contacts.velocity[contacts.other], 0.0)
        slide = ((contacts.velocity[contacts.body] - other) * tangent).sum(axis=1)
        contacts.memory[:] += h * slide[:, None] * tangent
        return self.pushed(contacts, contacts.percussion[:, None] * contacts.normal - h * 1e4 * contacts.memory)


@kernel
def by_row(state: State, own: Softness, h: float) -> int:
    bodies, contacts = state.bodies, state.contacts
    use_free_velocity(state)
    for c in range(contacts.number):
        stiffness = 1e5 + 1e4 * bodies.row[contacts.body[c]]
        contacts.percussion[c] = -h * stiffness * min(contacts.gap[c], 0.0)
        push(bodies.solved, bodies.inverse_mass, contacts, c, contacts.percussion[c])
    return 0


FREE, TWO, PRESSED = "scene 'a person without contacts", "scene 'two people who collide", "scene 'nine people pressed"
PAIR, ROOM = "scene 'two people of 80 kg", "scene '20 ticks of Twenty people"

BROKEN = [
    Broken(
        odd(Bounce, step=lambda self, contacts, h: 0.99 * Bounce.step(self, contacts, h)),
        "check_free_walk",
        FREE,
        r"not at 1\.05.*free velocity",
    ),
    Broken(LooksAround, "check_free_walk", "scene 'two people 5 m apart", "use only the given contacts"),
    Broken(OneSided, "check_collision", TWO, "momentum changes by .* kg m/s; percussions on both"),
    Broken(
        odd(Bounce, pushed=lambda self, contacts, push: contacts.free.copy()),
        "check_collision",
        TWO,
        "would pass through each other",
    ),
    Broken(
        odd(Bounce, pushed=lambda self, contacts, push: Bounce.pushed(self, contacts, push * [1.0, 0.9])),
        "check_crowd",
        f"{PRESSED}.* rotated by 90 degrees",
        "differs by .* m; use gaps",
    ),
    Broken(CountsTwice, "check_collision", TWO, "account for .* J; contacts.percussion"),
    Broken(Open, "check_room", "scene 'two people at one place", "through the wall.*; apply percussions at walls"),
    Broken(HidesOverlaps, "check_crowd", PRESSED, "reports a largest overlap of 0 m, but .* m occurred; let the"),
    Broken(Restless, "check_same_bits", f"{ROOM}.*repeated", "two runs differ in .*; use only the generator"),
    Broken(Forgetful, "check_same_bits", f"{ROOM}.*resumed", r"differs in .*; state\(\) must"),
    Broken(
        odd(Bounce, step=lambda self, contacts, h: 1e6 * Bounce.step(self, contacts, h)),
        "check_free_walk",
        FREE,
        "moves too fast .*; check speeds",
    ),
    Broken(odd(ContactModel), "check_free_walk", FREE, r"neither a law nor step\(contacts, h\); define"),
    Broken(AlongAxes, "check_crowd", f"{PRESSED}.* rotated in the middle", "differs by .* m; .* normal and tangent"),
    Broken(odd(Lawful, law=by_row), "check_crowd", f"{PRESSED}.* in another order", "differs by .* m; keep it"),
    Broken(Lawful, "check_free_walk", FREE, "not at 1.05"),
    Broken(
        odd(Lawful, law=without_parameters),
        "check_free_walk",
        FREE,
        r"law: must .*, not .*\(State, float64\)",
    ),
    Broken(Scribbles, "check_pair_law", PAIR, "changes its parameters; only return"),
    Broken(Sliding, "check_pair_law", PAIR, "friction is -10 N for the sliding speed -1.0 m/s; .* opposite sign"),
]
