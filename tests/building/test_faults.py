"""All errors of a plan are found in one pass, each with its item, its place and a remedy that removes it."""

import copy
import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from shapely import box

from evac import BuildingError, Plan, Simulation, load
from evac.building.plan.plantable import plan_of, table_of


def item_of(table, key):
    section, _, name = key.partition(".")
    if section in ("flights", "landings"):
        return table[section][int(name)]
    return next(item for item in table[section] if item["name"] == name)


def errors_of(table):
    try:
        return plan_of(table, Path("house"), Path()).check()
    except BuildingError as error:
        return error.findings


def mend(table, finding):
    """Apply the remedy of an error."""
    section = finding.item.partition(".")[0]
    if finding.remedy == "remove it":
        table[section].remove(item_of(table, finding.item))
        return
    item, lines = item_of(table, finding.item), finding.remedy.splitlines()
    for line in lines:
        if line.startswith("remove "):
            del item[line.removeprefix("remove ")]
    item |= tomllib.loads("\n".join(line for line in lines if not line.startswith("remove ")))


def test_errors_of_copies_are_one_line():
    plan = Plan("tower")
    plan.storey("0", [(0, 0), (9, 0), (9, 6), (0, 6)])
    for k in range(1, 4):
        plan.storey(f"{k}", z=3.0 * k, like="0")
    plan.door("lost", "0", [(4, 3), (5, 3)])
    plan.exit("far", "0", [(30, 3), (30, 4)])
    with pytest.raises(BuildingError) as caught:
        plan.building()
    lost, far = str(caught.value).splitlines()
    assert lost.startswith("tower: door 'lost'")
    assert "3 more" in lost
    assert far.startswith("tower: exit 'far'")
    found = [(one.kind, one.item, one.storey, one.place) for one in plan.check()]
    assert found == [("error", "doors.lost", f"{k}", (4.5, 3.0)) for k in range(4)] + [
        ("error", "exits.far", "0", (30.0, 3.5))
    ]


def test_findings_of_a_run_have_the_keys_of_rooms_and_shafts():
    plan = Plan()
    plan.storey("low", wall=0.2)
    plan.room("office", "low", box(0, 0, 10, 5), people=7)
    plan.room("hall", "low", box(0, 5, 10, 15))
    plan.door("door", "low", {"rooms": ["office", "hall"], "width": 0.9})
    plan.storey("high", z=3.0, like="low")
    plan.shaft("stair", "low", "high", [(2.0, 8.0), (2.4, 8.0)], length=2.8, turn="right", direction=(0, 1))
    plan.exit("exit", "low", {"rooms": ["hall"], "side": 0, "at": 1.5, "width": 1.2})
    groups = [{"name": area, "area": area, "number": 3} for area in ("office", "high office")]
    simulation = Simulation(load({"building": plan, "people": groups, "contact": {"model": "nsm2"}}))
    told = {one.item for one in simulation.findings if one.kind in ("left out", "warning") and one.item}
    assert {item for item in told if not item.startswith("people.")} == {"rooms.office", "shafts.stair"}


def test_the_other_turn_is_the_remedy_of_a_stair_that_turns_into_a_wall():
    plan = Plan()
    plan.storey("low", [(0, 0), (9, 0), (9, 6), (0, 6)])
    plan.storey("high", z=3.0, like="low")
    plan.stair("stair", "low", [(4, 0.1), (4, 1.3)], "high", length=2.7, direction=(1, 0), turn="right")
    errors = [one for one in plan.check() if one.kind == "error"]
    assert [(one.item, one.remedy) for one in errors] == [("stairs.stair", 'turn = "left"')]


def test_a_steep_shaft_beside_a_misspelt_key_is_told_with_its_key_and_a_length():
    plan = Plan()
    plan.storey("low", [(0, 0), (9, 0), (9, 6), (0, 6)])
    plan.storey("high", z=3.0, like="low")
    plan.shaft("shaft", "low", "high", [(4, 0.1), (4, 1.3)], length=0.8, direction=(1, 0), turn="left")
    table = table_of(plan)
    steep = ("shafts.shaft", "low", "length = 1.6")
    assert [(one.item, one.storey, one.remedy) for one in errors_of(table)] == [steep]
    with pytest.raises(BuildingError) as caught:
        plan.building(need_exit=False)
    assert [level.name for level in caught.value.building.levels] == ["low", "high"]  # all that is right, to draw it
    table["areas"] = [{"name": "start", "storey": "low", "polgon": [[0, 3], [9, 3], [9, 6]]}]
    told = [(one.item, one.storey, one.remedy.partition(" = ")[0]) for one in errors_of(table)]
    assert told == [("areas.start", "low", "polygon"), ("shafts.shaft", "low", "length")]
    table["storeys"][0]["wal"] = 0.1  # no error follows of the storey that is like it
    assert [one.item for one in errors_of(table)] == ["storeys.low", "areas.start", "shafts.shaft"]
    table["storeys"][1]["like"] = "lwo"  # whose remedy lets the other errors be found
    told = [(one.item, one.remedy) for one in errors_of(table)[2:]]
    assert told == [("storeys.high", 'like = "low"'), ("shafts.shaft", "length = 1.6")]
    table["shafts"][0] |= {"turn": "right", "upper": "hgh"}
    told = [one.remedy for one in errors_of(table) if one.item == "shafts.shaft"]
    assert sorted(told) == ["length = 1.6", 'turn = "left"', 'upper = "high"']


@pytest.mark.parametrize(
    ("section", "left_out", "remedy"),
    [
        ("shafts", ("rise", "going"), "rise = 0.17\ngoing = 0.29"),
        ("shafts", ("going",), "going = 0.29"),
        ("shafts", ("width",), "width = 1.2"),
        ("stairs", ("length",), "length = 5.12"),
    ],
)
def test_the_remedy_of_a_stair_without_its_size_gives_the_size(section, left_out, remedy):
    sizes = {"rise": 0.15, "going": 0.3, "foot": [4, 2], "width": 1.4, "direction": [1, 0]}
    if section == "stairs":
        sizes = {"length": 4.2, "lower_edge": [[4, 1.3], [4, 2.7]], "direction": [1, 0]}
    stair = {"name": "one", "lower": "low", "upper": "high"} | sizes
    for key in left_out:
        del stair[key]
    storeys = [
        {"name": "low", "polygons": [[0, 0], [20, 0], [20, 6], [0, 6]]},
        {"name": "high", "like": "low", "z": 3.0},
    ]
    table = {"storeys": storeys, section: [stair]}
    (error,) = [one for one in errors_of(table) if one.kind == "error"]
    assert (error.item, error.remedy, error.place) == (f"{section}.one", remedy, (4.0, 2.0))
    mend(table, error)
    assert not [one for one in errors_of(table) if one.kind == "error"]


#: Changes of a stair of two flights and a landing, and the remedies that a plan of them has.
SPOILED_PIECES = [
    ("flights.0", {"lower_z": None}, "lower_z = 0.0"),
    ("flights.0", {"upper_z": None}, "upper_z = 1.6"),
    ("flights.1", {"lower_z": None}, "lower_z = 1.6"),
    ("flights.1", {"upper_z": None}, "upper_z = 3.2"),
    ("landings.0", {"z": None}, "z = 1.6"),
    ("flights.0", {"lower_z": 0.2}, "lower_z = 0.0"),
    ("flights.1", {"upper_z": 3.0}, "upper_z = 3.2"),
    ("flights.1", {"lower_z": 1.9}, "lower_z = 1.6"),
    ("flights.0", {"upper_edge": [[4, 3], [5.2, 3]]}, "upper_edge = [[4.2, 6.0], [5.4, 6.0]]"),
    (
        "landings.0",
        {"polygon": [[4, 6.3], [6.6, 6.3], [6.6, 7.5], [4, 7.5]]},
        "polygon = [[4.0, 6.0], [6.6, 6.0], [6.6, 7.2], [4.0, 7.2]]",
    ),
]


@pytest.mark.parametrize(("key", "change", "remedy"), SPOILED_PIECES)
def test_the_remedy_of_a_flight_or_a_landing_joins_it_to_others_of_its_stair(key, change, remedy):
    first = {"lower_edge": [[4, 3], [5.2, 3]], "lower_z": 0.0, "upper_edge": [[4, 6], [5.2, 6]], "upper_z": 1.6}
    second = {"lower_edge": [[5.4, 6], [6.6, 6]], "lower_z": 1.6, "upper_edge": [[5.4, 3], [6.6, 3]], "upper_z": 3.2}
    floor = [[0, 0], [12, 0], [12, 10], [0, 10]]
    table = {
        "storeys": [{"name": "low", "polygons": floor}, {"name": "high", "z": 3.2, "polygons": floor}],
        "flights": [{"stair": "west", **first}, {"stair": "west", **second}],
        "landings": [{"stair": "west", "polygon": [[4, 6], [6.6, 6], [6.6, 7.2], [4, 7.2]], "z": 1.6}],
    }
    portals = len(plan_of(table, Path("house"), Path()).building(need_exit=False).portals)
    table["landings"].append({"stair": "loose", "polygon": [[8, 6], [9, 6], [9, 7]], "z": 1.6})  # another fault
    item = item_of(table, key)
    item |= change
    for left_out in [name for name, value in change.items() if value is None]:
        del item[left_out]
    error = next(one for one in errors_of(table) if one.kind == "error" and one.item == key)
    sizes = tomllib.loads(error.remedy)
    ((name, value),) = tomllib.loads(remedy).items()
    assert sizes.keys() == {name}
    assert np.allclose(np.sort(np.atleast_1d(sizes[name]), axis=0), np.sort(np.atleast_1d(value), axis=0))
    mend(table, error)
    del table["landings"][1]
    assert len(plan_of(table, Path("house"), Path()).building(need_exit=False).portals) == portals


def test_the_remedy_of_doors_without_a_wall_is_the_wall_of_their_storey():
    plan = Plan()
    rooms = [box(6 * k, 0, 6 * k + 6, 6) for k in range(4)]
    plan.storey("0", rooms)
    plan.storey("1", z=3.0, like="0")
    for k in range(1, 4):
        plan.door(f"door {k}", "0", [(6 * k, 2), (6 * k, 3)])
    plan.exit("out", "0", [(0, 2), (0, 3)])
    table = table_of(plan)
    errors = [one for one in errors_of(table) if one.kind == "error"]
    places = [(6.0, 2.5), (12.0, 2.5), (18.0, 2.5)]
    assert [(one.item, one.storey, one.place) for one in errors] == [
        ("storeys.0", storey, place) for storey in "01" for place in places
    ]
    with pytest.raises(BuildingError) as caught:
        plan.building()
    assert len(str(caught.value).splitlines()) == 1
    mend(table, errors[0])
    assert not [one for one in errors_of(table) if one.kind == "error"]


def test_a_stair_that_partly_adjoins_is_told_with_the_turn_that_adjoins():
    plan = Plan()
    for name, z in (("low", 0.0), ("high", 3.0)):
        plan.storey(name, box(0, 0, 3.1, 5), z=z)
    plan.stair("stair", "low", [(1.65, 5), (2.95, 5)], "high", length=2.7, turn="right")
    (found,) = [one for one in plan.check() if one.item == "stairs.stair"]
    assert (found.kind, found.storey, found.remedy) == ("warning", "high", 'turn = "left"')
    assert found.text.startswith("only 0.05 of 1.30 m")
    assert str(found).endswith(found.remedy)
    table = table_of(plan)
    mend(table, found)
    assert not plan_of(table, Path("house"), Path()).check()


#: Changes that spoil the house below, and the key and the remedy of the error that each makes.
SPOILED = [
    ("doors", {"storey": None}, "doors.inner", 'storey = "low"'),
    ("doors", {"storey": 3}, "doors.inner", 'storey = "low"'),
    ("doors", {"name": None}, "doors.0", 'name = "door"'),
    ("doors", {"segment": [[4.4, 4]]}, "doors.inner", "segment = [[4.4, 4], [5.3, 4]]"),
    ("doors", {"segment": {"rooms": ["office"]}}, "doors.inner", 'rooms = ["office", "hall"]'),
    ("doors", {"segment": {"rooms": ["office", "hall"], "with": 1.0}}, "doors.inner", "width = 1.0"),
    ("doors", {"control": {"evry": 2.0}}, "doors.inner", "control = { every = 2.0 }"),
    ("doors", {"outside": "exits"}, "doors.inner", 'outside = "exit"'),
    ("rooms", {"name": None}, "rooms.0", 'name = "office"'),
    ("rooms", {"storey": "lo"}, "rooms.office", 'storey = "low"'),
    ("rooms", {"people": "12"}, "rooms.office", "people = 12"),
    ("rooms", {"people": -3}, "rooms.office", "people = 3"),
    ("areas", {"name": "office"}, "areas.office", 'name = "office (2)"'),
    ("areas", {"polygon": {"rooms": ["offce"]}}, "areas.start", 'polygon = { rooms = ["office"] }'),
    ("areas", {"polygon": {"rooms": ["office"], "inset": 9.0}}, "areas.start", 'polygon = { rooms = ["office"] }'),
    ("areas", {"polygon": [[60, 1], [62, 1], [62, 3], [60, 3]]}, "areas.start", "polygon = [[10"),
    ("shafts", {"direction": None}, "shafts.up", "direction = [0, 1]"),
    ("shafts", {"turn": "rigth"}, "shafts.up", 'turn = "right"'),
    ("shafts", {"kind": "spiral"}, "shafts.up", 'kind = "dog-leg"'),
    ("shafts", {"upper": "low"}, "shafts.up", 'upper = "high"'),
    ("shafts", {"lower": None}, "shafts.up", 'lower = "low"'),
    ("exits", {"segment": {"rooms": ["hall"], "side": 9}}, "exits.out", "side = 0, width = 0.9"),
    ("exits", {"segment": [[1.5, 8], [2.5, 8]]}, "exits.out", "segment = [[2.5, 10.0], [1.5, 10.0]]"),
    ("lifts", {"storeys": ["low", "hgh"]}, "lifts.lift", 'storeys = ["low", "high"]'),
    ("lifts", {"door": [[4, 12.5], [5, 12.5]]}, "lifts.lift", "door = [[4.0, 10.2], [5.0, 10.2]]"),
    ("lifts", {"door": None}, "lifts.lift", "door = [[3.5, 10.2], [5.5, 10.2]]"),
    ("lifts", {"operation": {"sped": 2.0}}, "lifts.lift", "operation = { speed = 2.0 }"),
    ("storeys", {"name": None}, "storeys.0", 'name = "low"'),
    ("storeys", {"height": 0.5}, "storeys.low", "z = 0.5"),
]


def house():
    """Return the table of a house with two storeys and an item of most kinds."""
    plan = Plan()
    plan.storey("low", wall=0.2)
    plan.room("office", "low", box(0, 0, 12, 4), people=3)
    plan.room("hall", "low", box(0, 4, 12, 10) - box(1, 6, 3, 7.5))
    plan.storey("high", z=3.0, like="low")
    plan.door("inner", "low", {"rooms": ["office", "hall"], "width": 0.9})
    plan.area("start", "low", {"rooms": ["office"], "inset": 0.5})
    plan.exit("out", "low", {"rooms": ["hall"], "side": 1, "width": 1.2})
    plan.lift("lift", ["low", "high"], box(3.5, 10.2, 5.5, 12.0), [(4.0, 10.2), (5.0, 10.2)])
    plan.shaft("up", "low", "high", foot=(8, 5), width=1.2, direction=(0, 1), length=2.7, turn="right")
    table = copy.deepcopy(table_of(plan))
    table["shafts"][0] |= {"foot": [8, 5], "width": 1.2}
    del table["shafts"][0]["lower_edge"], table["storeys"][0]["z"]
    return table


@pytest.mark.parametrize(("section", "change", "item", "remedy"), SPOILED)
def test_a_remedy_keeps_what_is_meant(section, change, item, remedy):
    table = house()
    row = table[section][0]
    for key, value in change.items():
        row[key] = value
        if value is None:
            del row[key]
    errors = [one for one in errors_of(table) if one.kind == "error"]
    assert {one.item for one in errors} == {item}
    assert remedy in errors[0].remedy
    name = row.get("name", "0")
    for error in errors:
        row["name"] = name
        mend(table, replace(error, item=f"{section}.{name}"))
        name = row["name"]
    assert [one for one in errors_of(table) if one.kind == "error"] == []


def test_a_storey_at_the_height_of_another_is_told_with_its_height():
    table = house()
    table["storeys"] += [{"name": "third", "z": 6.0, "like": "low"}]
    del table["storeys"][1]["z"]
    errors = [(one.item, one.remedy) for one in errors_of(table) if one.kind == "error"]
    assert errors == [("storeys.high", "z = 3")]


def test_keys_of_the_file_are_renamed_and_lists_are_written_as_lists():
    table = house() | {"headroom": "2.5"}
    table["dors"], table["exits"] = table.pop("doors"), table["exits"][0]
    errors = [(one.item, one.remedy) for one in errors_of(table) if one.kind == "error"]
    assert errors == [
        ("dors", "rename it to doors"),
        ("headroom", "headroom = 2.5"),
        ("exits", "write it as [[exits]]"),
    ]


def test_a_room_that_others_need_is_not_to_be_removed():
    table = house()
    table["rooms"][0]["polygon"] = 5
    errors = [one for one in errors_of(table) if one.kind == "error"]
    assert [(one.item, one.remedy) for one in errors] == [("rooms.office", "")]


def test_a_door_without_a_storey_is_told_where_ground_is_in_files_that_are_read_later():
    table = {
        "storeys": [{"name": "low", "file": "low.wkt"}, {"name": "high", "file": "high.wkt", "z": 3.0}],
        "doors": [{"name": "inner", "segment": [[4, 3], [5, 3]]}],
    }
    assert [(one.item, one.remedy) for one in errors_of(table)] == [("doors.inner", 'storey = "low"')]


@pytest.mark.parametrize("number", range(4))
def test_faults_of_several_items_are_found_in_one_pass_and_their_remedies_remove_them(number):
    table, spoiled = house(), set()
    for section in ("doors", "areas", "shafts", "exits", "lifts"):
        changes = [row[1:3] for row in SPOILED if row[0] == section and "name" not in row[1]]
        change, item = changes[number % len(changes)]
        table[section][0] = {key: value for key, value in (table[section][0] | change).items() if value is not None}
        spoiled.add(item)
    errors = [one for one in errors_of(table) if one.kind == "error"]
    assert {one.item for one in errors} == spoiled
    for error in {(one.item, one.remedy): one for one in errors}.values():  # without what is repeated on other storeys
        mend(table, error)
    assert [one for one in errors_of(table) if one.kind == "error"] == []
