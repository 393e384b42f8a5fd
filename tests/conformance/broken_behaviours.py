"""Broken behaviours."""

import numpy as np

from evac.people.behaviour import Behaviour
from tests.conformance.broken import Broken, odd


class Slower(Behaviour):
    """Slows everybody a little; declares what it touches."""

    name = "slower"
    reads = ("velocity",)
    writes = ("speed_factor",)

    def act(self, crowd, time):
        crowd.speed_factor[np.hypot(*crowd.velocity.T) > 0.5] *= 0.9


class Seeks(Slower):
    """Needs an area that no shipped case has."""

    def prepare(self, scene):
        scene.people_in("cloakroom")


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


class MovesOthers(Slower):
    """Wants to move people who have left itself."""

    keeps_distance = True

    def prepare(self, scene):
        self.outside = scene.outside

    def act(self, crowd, time):
        self.outside.position[:] += 0.1


def takes_chances(self, crowd, time):
    """Use a generator of its own."""
    crowd.speed_factor *= np.random.default_rng().random()


TICK, TICKS = "scene 'the start of Twenty people", "scene '20 ticks of Twenty people"

BROKEN = [
    Broken(CrushReader, "check_declared_arrays", "scene 'a crush", "contact_force is not declared"),
    Broken(SneaksIn, "check_declared_arrays", TICK, "writes 'velocity'"),
    Broken(Remembers, "check_same_bits", f"{TICKS}.*resumed", r"differs in .*; state\(\) must"),
    Broken(
        odd(Slower, is_needed=lambda self, scene: False),
        "check_same_bits",
        f"{TICKS}.*optional parts",
        r"changes .*; correct is_needed\(\)",
    ),
    Broken(MovesOthers, "check_declared_arrays", TICK, "read-only", ValueError),
    Broken(odd(Slower, act=takes_chances), "check_same_bits", f"{TICKS}.*repeated", "two runs differ"),
]
