"""Single keys of cases, of plugins and of plans with values that nobody expects: they run, or the key is named."""

import copy
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Any, get_args, get_origin

import pytest
from hypothesis import strategies

from evac.base.errors import BuildingError, EvacError
from evac.base.keys import Table, table_of
from evac.building.plan.plantable import SECTIONS, plan_of
from evac.case.case import Case
from evac.case.loading import load_case
from evac.contract.registry import Registry
from evac.simulation.simulation import Simulation
from tests.properties.seeded import MODELS, drawn, write_case

# ruff: noqa: SIM905
NUMBERS = """0 1 -1 2 3 7 100 1000 65536 2147483647 2147483648 9223372036854775807 -9223372036854775808
    9223372036854775808 -0.0 0.1 0.5 0.001 1e-6 1e-9 1e-12 1e-100 1e-300 5e-324 2.5 9.9 10.0 1e3 1e6 1e9 1e12 1e15 1e16
    1e100 1e154 1e300 1.7976931348623157e308 -1e300 inf -inf nan 0.30000000000000004 0x7fffffff""".split()
WORDS = ['""', '"x"', '" "', '"door"', '"room"', '"put"', '"../x"', '"/"', f'"{"x" * 5000}"', '"é"', '"\\u0000"']
LISTS = """[] [[]] [{}] [0] [0,0] [[0,0]] [[0,0],[0,0]] [nan,inf] ["x"] [[1e300,1e300],[-1e300,1e300],[0,0]]
    [[nan,0],[1,1]] [[1,2],[3]] [[0,0],[1,0],[0,1],[1,1]] [[5e-324,0],[0,5e-324],[0,0]] [[1,1],[2,1],[2,2]] {x=1} {""=1}
    {a.b.c=1} true false 1979-05-27T07:32:00Z 1979-05-27 07:32:00""".split()
DEEP = ["[" * 100 + "]" * 100, "{ a = " * 60 + "1" + " }" * 60, "[" + "0.5, " * 100_000 + "]", "1" + "0" * 400]
DISTRIBUTIONS = """{uniform=[0,1]} {uniform=[1,0]} {uniform=[-1e300,1e300]} {uniform=[5e-324,1e-323]} {normal=[0,1e300]}
    {normal=[1e300,5e-324]} {normal=[1,1],minimum=0.1} {normal=[1]} {lognormal=[1000,1]} {lognormal=[0,40]}
    {weibull=[1e-9,1]} {weibull=[0.01,1e-300]} {gamma=[1e300,1e300]} {gamma=[2,3],maximum=1e-9} {constant=nan}
    {constant=1e300} {constant=[1]} {list=[]} {list=[1,2]} {list=[1,2,3,4,5],minimum=2} {factor={constant=1e300}}
    {factor={}} {minimum=1,maximum=0} {uniform=[0,1],minimum=0.999999999} {factor={factor=1}}""".split()
VALUES = [*NUMBERS, *WORDS, *LISTS, *DEEP, *DISTRIBUTIONS]

#: What once went wrong: key, value and contact model.
KEPT = (
    ("people.put.name", "[]", "nsm2"),
    ("people.drawn.number", "1000000", "nsm2"),
    ("people.drawn.mass", "1" + "0" * 400, "nsm2"),
    ("contact.dem.stiffness", "1" + "0" * 400, "dem"),
    ("behaviours.route_choice.exits", "[" + "0.5, " * 100_000 + "]", "nsm2"),
    ("behaviours.walking.chest_depth", "1e-6", "dem"),
)


@cache
def known_keys() -> tuple[str, ...]:
    """Return every key that a case can have, those of plugins included, and some that it cannot."""
    registry, found = Registry(), list(keys_of(Case, ""))
    kinds = ("contact_model", "force", "behaviour", "recorder", "importer")
    for kind, table in zip(kinds, ("contact", "forces", "behaviours", "recorders", "importers"), strict=True):
        for name, cls in registry._tables[kind].items():
            found += [f"{table}.{name}", *(f"{table}.{name}.{key}" for key in cls.declared())]
            found += [f"people.drawn.behaviours.{name}.{key}" for key in getattr(cls, "group_keys", ())]
    return (*found, "contact.nowhere", "people.nobody.name", "people.7", "building.exits.door.nothing", "nothing")


def keys_of(table: type[Table], before: str) -> Iterator[str]:
    """Yield the keys of a table, those of its first item where it is a list."""
    items = {"people": ("drawn", "put"), "presets": ("slow",)}
    for name, field in table.model_fields.items():
        yield before + name
        inner = table_of(field.annotation)
        if inner is None:
            continue
        parts = (field.annotation, *get_args(field.annotation))
        is_many = get_origin(field.annotation) is dict or any(get_origin(part) is tuple for part in parts)
        for item in items.get(name, ("0",)) if is_many else ("",):
            yield from keys_of(inner, f"{before}{name}.{item}." if item else f"{before}{name}.")


@pytest.mark.filterwarnings("ignore")  # numpy's, of numbers that are then refused
@drawn(15, case=strategies.tuples(*map(strategies.sampled_from, (known_keys(), VALUES, MODELS))))
def test_a_case_runs_or_the_message_names_the_key(case, tmp_path_factory):
    check(*case, tmp_path_factory.mktemp("key"))


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("case", KEPT, ids=range(len(KEPT)))
def test_what_once_went_wrong_runs_or_is_named(case, tmp_path):
    check(*case, tmp_path)


def check(key: str, value: str, model: str, tmp_path: Path) -> None:
    """Run a case with a value of a key, or find the key in the message."""
    try:
        Simulation(load_case(write_case(tmp_path, model), [f"{key}={value}"])).run()
    except EvacError as error:
        told = str(error)
        assert len(told) < 100_000
        # A step that fails names all forces; what a preset or another name spoils is wrong with a group.
        words = [word for word in key.split(".") if not word.isdigit()][-2:] + ["forces"] * key.startswith("forces.")
        words += ["people"] * (key.startswith(("presets", "people.")) or key.endswith(".name"))
        words += [value.strip('"')] * key.startswith("building.mesh")
        assert any(word in told for word in words), told[-2000:]


#: A sound plan with something of every kind, and keys that it leaves out.
PLAN: dict[str, list[dict[str, Any]]] = {
    "storeys": [
        {
            "name": "ground",
            "polygons": ["POLYGON ((0 0, 8 0, 8 8, 0 8, 0 0))", "POLYGON ((8.2 0, 14 0, 14 8, 8.2 8, 8.2 0))"],
        },
        {"name": "first", "z": 3.2, "polygons": [[0, 0], [14, 0], [14, 8], [0, 8]], "wall": 0.0},
    ],
    "doors": [{"name": "door", "storey": "ground", "segment": [[8.1, 2], [8.1, 3]], "reach": 0.5}],
    "stairs": [
        {
            **{"name": "stair", "lower": "ground", "lower_edge": [[1, 0.8], [1, 2]], "upper": "first"},
            **{"length": 5.5, "direction": [1, 0]},
        }
    ],
    "exits": [{"name": "main", "storey": "ground", "segment": [[0, 3.5], [0, 4.7]]}],
    "openings": [{"storey": "ground", "segment": [[3, 0], [4, 0]], "name": "opening"}],
    "areas": [{"name": "office", "storey": "first", "polygon": [[8, 3], [13, 3], [13, 7], [8, 7]]}],
    "obstacles": [{"name": "table", "storey": "first", "polygon": [[10, 5], [12, 5], [12, 6], [10, 6]]}],
}
FURTHER = {
    "storeys": ("file", "options"),
    "stairs": ("upper_edge", "landing", "landings", "turn", "gap"),
    "doors": ("outside",),
    "exits": ("polygon",),
}
PLAN_VALUES = (
    *(1e308, -1e308, 1e100, 1e17, 1e9, 1e-300, float("nan"), float("inf"), -1, 0, 10**400, True, None, 3 + 4j, b"x"),
    *("", "x", "a\nb", "..", "nan", "POLYGON EMPTY", "POLYGON ((1e308 0, 1 1, 2 2, 1e308 0))", "POINT (1 1)"),
    *([], [1, "x"], [None], [float("nan"), 1], [1e-300, 0], [1e308, 1e308], [True, False], [[0, 0], [1]]),
    *([[1, "x"], [2, 3]], [[1e308, 0], [0, 1e308]], [[0, 0]] * 3, [[[0, 0]]], ["POLYGON ((0 0, 1 0, 1 1, 0 0))", 5]),
    *({}, {"type": "Polygon"}, {"type": "Polygon", "coordinates": [[["a", 1]]]}, {"type": "Feature", "geometry": None}),
)


PLACES = [
    (section, index, key)
    for section, items in PLAN.items()
    for index, one in enumerate(items)
    for key in (*one, *FURTHER.get(section, ()))
]


@pytest.mark.filterwarnings("ignore")
@drawn(30, place=strategies.sampled_from(PLACES), value=strategies.sampled_from(PLAN_VALUES))
def test_a_plan_makes_a_building_or_each_line_of_its_refusal_names_the_file(place, value, tmp_path_factory):
    assert set(PLAN) <= set(SECTIONS)
    table, tmp_path = copy.deepcopy(PLAN), tmp_path_factory.mktemp("plan")
    section, index, key = place
    table[section][index][key] = value
    try:
        plan_of(table, tmp_path / "plan.toml", tmp_path).building()
    except BuildingError as error:
        told = str(error)
    else:
        told = "plan.toml"
    assert all("plan.toml" in line for line in told.split("\n"))
