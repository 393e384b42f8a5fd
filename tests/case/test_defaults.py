"""Writing the default of a key is the same as leaving the key out."""

import contextlib
import copy
from pathlib import Path

import numpy as np
import pytest

from evac.base.change import LiftOptions
from evac.base.distributions import Distribution
from evac.base.keys import table_at
from evac.case import Case, load_case
from evac.contract.registry import Registry
from evac.people.groups import default_clearance, reference_speeds
from evac.simulation.assembly import make_behaviours, make_contact_model, make_forces, make_recorders
from evac.simulation.simulation import Simulation

REGISTRY = Registry()

TABLE = {
    "building": {
        "mesh": "room.obj",
        "exits": [{"name": "door", "segment": [[0.0, 2.0], [0.0, 3.0]], "z": 0.0}],
        "areas": [{"name": "room", "polygon": [[1, 1], [4, 1], [4, 4], [1, 4]], "z": 0.0}],
        "controls": {"door": {"every": 2.0}},
        "moving": {"stair 1": {"speed": 0.5}},
        "obstacles": [{"name": "post", "polygon": [[4.5, 4.5], [4.7, 4.5], [4.7, 4.7]], "z": 0.0}],
    },
    "directions": {"quickest": {}},
    "people": [
        {"name": "anywhere", "number": 3, "area": "room"},
        {"name": "later", "area": "room", "arrive": {"times": [1.0, 2.0]}},
        {"name": "here", "positions": [[4.0, 0.5], [4.5, 1.5]], "z": 0.0, "preset": "slow"},
    ],
    "place": [{"name": "landing", "kind": "refuge", "area": "room"}],
    "line": [{"name": "across", "level": "floor z=0.00", "segment": [[1.0, 2.0], [4.0, 2.0]]}],
    "event": [{"kind": "close", "target": "door", "when": {"out": 3}}],
    "phase": [{"name": "all", "of": ["room"]}],
    "safety": {"available": 60.0},
    "compartment": [{"name": "room"}],
    "conditions": [{"source": "prescribed", "values": {"extinction": 0.5, "co": 9.0, "co2": 0.1, "o2": 20.5}}],
    "smoke": {},
    "dose": {"heat": "none"},
    "presets": {"slow": {"speed": 0.8}},
    "contact": {"model": "nsm2"},
    "forces": {"social": {}},
    "behaviours": {"response_time": {}},
    "simulation": {},
    "output": {},
    "report": {},
    "plugins": {},
}

#: A room, a stair and a floor above.
MESH = "".join(f"v {x} {y} {z}\n" for x, z in ((0, 0), (5, 0), (9, 2.5), (12, 2.5)) for y in (0, 5))
MESH += "f 1 3 4 2\nf 3 5 6 4\nf 5 7 8 6\n"

#: The path of each table of a case.
TABLES = (
    (),
    ("building",),
    ("building", "exits", 0),
    ("building", "controls", "door"),
    ("building", "moving", "stair 1"),
    ("building", "areas", 0),
    ("building", "obstacles", 0),
    ("directions",),
    ("directions", "quickest"),
    ("people", 0),
    ("people", 1, "arrive"),
    ("place", 0),
    ("line", 0),
    ("event", 0),
    ("event", 0, "when"),
    ("phase", 0),
    ("safety",),
    ("compartment", 0),
    ("conditions", 0),
    ("smoke",),
    ("dose",),
    ("presets", "slow"),
    ("contact",),
    ("simulation",),
    ("output",),
    ("report",),
    ("plugins",),
)


def plain(default):
    """Return a default as a case.toml or a dictionary says it."""
    if isinstance(default, Distribution):
        return default.to_value()
    if hasattr(default, "model_dump"):
        return default.model_dump(mode="json")
    return list(default) if isinstance(default, tuple) else copy.deepcopy(default)


def content_at(table, path):
    for step in path:
        table = table[step]
    return table


def defaults_of(path):
    """Return the keys of a table that have a default and that `TABLE` leaves out, with their defaults."""
    fields = {field.alias or name: field for name, field in table_at(path, Case).model_fields.items()}
    left_out = {name: field for name, field in fields.items() if name not in content_at(TABLE, path)}
    return {name: plain(field.default) for name, field in left_out.items() if not field.is_required()}


@pytest.fixture(scope="module")
def load(tmp_path_factory):
    with contextlib.chdir(tmp_path_factory.mktemp("room")):
        Path("room.obj").write_text(MESH)
        yield lambda table: load_case(table, registry=REGISTRY)


def everything(case):
    """Return all that a run starts from, and where it is after three ticks."""
    simulation = Simulation(case)
    for _ in range(3):
        simulation.advance_tick()
    plugins = [make_contact_model(case), *make_forces(case), *make_behaviours(case), *make_recorders(case)]
    settings = {
        "case": case.to_dict(),
        "plan": list(map(tuple, simulation.plan)),
        "plugins": [(one.name, repr(one.values())) for one in plugins],
        "speeds": reference_speeds(case),
        "clearance": default_clearance(case),
        "last": case.simulation.last_step,
        "warnings": simulation.warnings(),
    }
    packed = simulation.fields.packed
    grids = {"direction": packed.direction, "travel_time": packed.travel_time, "shape": packed.shape}
    return settings, {**simulation.state(), **grids}


def test_written_defaults_equal_omitted_ones(load):
    table, whole = load(TABLE).to_dict(), copy.deepcopy(TABLE)
    for path in TABLES:
        for name, default in defaults_of(path).items():
            one = copy.deepcopy(TABLE)
            content_at(one, path)[name] = content_at(whole, path)[name] = default
            assert load(one).to_dict() == table, (path, name)
    omitted, written = everything(load(TABLE)), everything(load(whole))
    assert written[0] == omitted[0]
    for key, value in omitted[1].items():
        np.testing.assert_array_equal(written[1][key], value, err_msg=key)


def test_every_table_is_tried():
    def tables(table, path=()):
        yield table
        for name in table.model_fields:
            inner = table_at((*path, name), Case)
            if inner is not None:
                yield from tables(inner, (*path, name))

    # Lifts are those of a plan, see tests/building/test_lifts.py.
    assert {table_at(path, Case) for path in TABLES} == set(tables(Case)) - {LiftOptions}
