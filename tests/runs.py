"""Runs of the shipped cases, some with a plugin, and when two of them are the same."""

import textwrap

import numpy as np

from evac.case.loading import load_case

MODELS = ["dem", "nsm1", "nsm2"]


ARRAYS = ("position", "velocity", "level", "distance", "exit_time", "exit_used", "contact_force")


def run_ticks(simulation, ticks):
    for _ in range(ticks):
        if not simulation.ended:
            simulation.advance_tick()
    return simulation


def assert_same_bits(one, other):
    for name in ARRAYS:
        np.testing.assert_array_equal(
            getattr(one.population.crowd, name), getattr(other.population.crowd, name), err_msg=name
        )
    for a, b in zip(one.population.crossings, other.population.crossings, strict=True):
        np.testing.assert_array_equal(a, b)


def model_of(model):
    return {"contact.model": model}


def in_the_room(tmp_path, text, positions=None, **changes):
    """The square room with one plugin, and people where they are told."""
    plugin = tmp_path / "odd.py"
    plugin.write_text(textwrap.dedent(text), encoding="utf-8")
    if positions is not None:
        changes["people"] = [{"name": "people", "positions": positions, "level": "room", "radius": 0.2, "speed": 1.3}]
    return load_case("square_room", changes, plugin_files=[plugin])


SQUEEZED = """
    from evac import Behaviour, hookimpl
    evac_interface = 3

    class Squeezed(Behaviour):
        '''Who feels more than 300 N takes half the speed.'''
        name = "squeezed"
        reads = ("contact_force", "speed_factor")
        writes = ("speed_factor",)

        def act(self, crowd, time):
            crowd.speed_factor[crowd.contact_force > 300.0] *= 0.5

    @hookimpl
    def evac_behaviours():
        return [Squeezed]
"""
