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


def two_doors(folder):
    """The table of a case of 16 people in a room of 5 m by 4 m with the exits front and back."""
    path = folder / "room.obj"
    path.write_text("v 0 0 0\nv 5 0 0\nv 5 4 0\nv 0 4 0\nf 1 2 3 4\n", encoding="utf-8")
    exits = [{"name": name, "segment": [[x, 1.0], [x, 2.5]], "z": 0.0} for name, x in (("front", 5.0), ("back", 0.0))]
    area = {"name": "all", "polygon": [[0.5, 0.5], [4.5, 0.5], [4.5, 3.5], [0.5, 3.5]], "z": 0.0}
    return {
        "building": {"mesh": str(path), "exits": exits, "areas": [area]},
        "contact": {"model": "nsm2"},
        "people": [{"name": "people", "number": 16, "area": "all"}],
    }


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
