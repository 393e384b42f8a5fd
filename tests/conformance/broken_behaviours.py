"""Broken behaviours."""

import numpy as np

from evac.people.behaviour import Behaviour
from tests.conformance.broken import Broken, odd, raising


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


class SneaksIn(Slower):
    """Writes through the base of a read-only array."""

    def act(self, crowd, time):
        crowd.velocity.base[:] += 1e-9


class Remembers(Slower):
    """Has private arrays that it does not hand over."""

    def prepare(self, scene):
        self.calls = 0

    def act(self, crowd, time):
        self.calls += 1
        crowd.speed_factor[:] = 1.0 / self.calls


class CrushReader(Slower):
    """Looks at contact forces in crowds that are denser than any of the shipped case."""

    reads = ("position", "level")

    def act(self, crowd, time):
        place = crowd.position[crowd.level >= 0]
        if len(place) > 1 and np.ptp(place, axis=0).max() < 0.1:
            crowd.speed_factor[crowd.contact_force > 10.0] *= 0.5


class WaitsInside(Slower):
    """Slows down people inside for those who have left, and leaves these as they are."""

    reads = ("level",)
    keeps_distance = True

    def prepare(self, scene):
        self.outside = scene.outside

    def act(self, crowd, time):
        if (self.outside.level >= 0).any():
            crowd.speed_factor[:] *= 0.5

    def state(self):
        return {}


class MovesOthers(WaitsInside):
    """Wants to move people who have left itself."""

    def act(self, crowd, time):
        self.outside.position[:] += 0.1


class PreparesForOthers(Slower):
    """Changes relaxation times beforehand."""

    def prepare(self, scene):
        scene.crowd.tau[:] = 0.5


def writes_nan(self, crowd, time):
    """Write what is no number."""
    crowd.speed_factor[0] = np.nan


def takes_chances(self, crowd, time):
    """Use a generator of its own."""
    crowd.speed_factor *= np.random.default_rng().random()


ROOM, TICK, TICKS = "scene 'Twenty people", "scene 'the start of Twenty people", "scene '20 ticks of Twenty people"
EXIT = "scene 'three people at an exit of Twenty people"

BROKEN = [
    Broken(Misspelt, "check_contract", "the class", r"no effect; define act\(self, crowd, time\) or prepare"),
    Broken(odd(Slower, writes=()), "check_declared_arrays", TICK, "speed_factor is not declared; add"),
    Broken(CrushReader, "check_declared_arrays", "scene 'a crush", "contact_force is not declared"),
    Broken(odd(Slower, reads=()), "check_declared_arrays", TICK, "velocity is not declared"),
    Broken(SneaksIn, "check_declared_arrays", TICK, "writes 'velocity'"),
    Broken(PreparesForOthers, "check_declared_arrays", ROOM, "tau is not declared; add", AttributeError),
    Broken(
        odd(Slower, writes=("position",)),
        "check_declared_arrays",
        ROOM,
        "'position', .* cannot write; known: .*start_time",
    ),
    Broken(Remembers, "check_same_bits", f"{TICKS}.*resumed", r"differs in .*; state\(\) must"),
    Broken(
        odd(Slower, is_needed=lambda self, scene: False),
        "check_same_bits",
        f"{TICKS}.*optional parts",
        r"changes .*; correct is_needed\(\)",
    ),
    Broken(odd(Slower, keeps_distance=True), "check_distance", EXIT, "a person inside .*; use scene.outside"),
    Broken(WaitsInside, "check_distance", EXIT, "who has left behind another one.*; use scene.outside"),
    Broken(MovesOthers, "check_declared_arrays", TICK, "read-only", ValueError),
    Broken(odd(Slower, act=raising), "check_declared_arrays", TICK, "partner", KeyError),
    Broken(odd(Slower, act=lambda self: 0), "check_contract", "the class", r"defines act\(self\); define act"),
    Broken(odd(Slower, act=writes_nan), "check_declared_arrays", TICK, "nan to speed_factor of person 0; it must be"),
    Broken(odd(Slower, act=takes_chances), "check_same_bits", f"{TICKS}.*repeated", "two runs differ"),
]
