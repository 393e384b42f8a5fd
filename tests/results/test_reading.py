"""Results that are read from a folder: equal to those that were written; damage is found at this border."""

import json
import shutil
from dataclasses import fields
from pathlib import Path

import numpy as np
import pytest
from shapely import box

import evac
from evac.base.errors import EvacError, ResultError
from evac.folder.textfiles import plain

#: What is not written: the objects of the process, and what the loop needs for its next step.
LIVE = {"case_or_reader", "building_or_none", "crowd", "groups", "noticed", "advised"}
OF_THE_LOOP = {"velocity", "contact_force", "overlap", "mingled", "contact_radius", "speed_factor", "extra_direction"}


@pytest.fixture(scope="module")
def stairs(tmp_path_factory):
    """A run down a stair that ends when some are out; people of one group start late."""
    plan = evac.Plan()
    plan.storey("ground", box(0, 0, 4, 4))
    plan.storey("first", box(8, 0, 14, 4), z=2.0)
    plan.stair("main", "ground", [(4, 1), (4, 2.5)], "first", [(8, 2.5), (8, 1)])
    plan.exit("out", "ground", [(0, 1), (0, 2)])
    plan.area("room", "first", box(8, 0, 14, 4))
    people = {"number": 6, "area": "room"}
    late = {"name": "=late", "behaviours": {"response_time": {"time": 3.0}}}
    case = {
        "title": "Down a stair",
        "building": plan,
        "people": [people | {"name": "early"}, people | late],
        "contact": {"model": "dem"},
        "behaviours": {"response_time": {"time": 0.0}},
        "simulation": {"duration": 9.0, "no_progress": float("inf")},
        "output": {"picture": False},
    }
    return evac.run(case, tmp_path_factory.mktemp("stairs") / "result")


def same(one, other):
    if isinstance(one, np.ndarray):
        return one.dtype == other.dtype and np.array_equal(one, other, equal_nan=one.dtype.kind == "f")
    if isinstance(one, tuple):
        return len(one) == len(other) and all(map(same, one, other))
    return plain(one) == plain(other)


def check_same(read, written, but=()):
    for one in fields(written):
        if one.name not in LIVE.union(but):
            assert same(getattr(written, one.name), getattr(read, one.name)), one.name
    for name, array in written.crowd.values().items():
        if name not in OF_THE_LOOP:
            assert same(array, getattr(read.crowd, name)), name
    for group, other in zip(written.groups, read.groups, strict=True):
        assert (group.name, group.rows.tolist()) == (other.name, other.rows.tolist())
        assert group.settings == other.settings
    assert read.summary() == written.summary()
    assert read.case_table == written.case_table
    assert read.remarks == written.remarks


def test_results_are_equal_after_writing_and_reading(stairs):
    read = evac.read_results(stairs.folder)
    assert 0 < read.evacuated < read.number_of_people
    assert len(read.crossings[0]) > 0
    check_same(read, stairs)
    assert read.people.equals(stairs.people)
    assert same(read.moves.source, stairs.moves.source)
    assert read.case.to_dict() == stairs.case.to_dict()
    assert [level.name for level in read.building.levels] == [level.name for level in stairs.building.levels]
    assert evac.Results.read(stairs.folder).summary() == read.summary()


@pytest.fixture
def folder(stairs, tmp_path):
    """A copy of the result to change."""
    return Path(shutil.copytree(stairs.folder, tmp_path / "result"))


def test_without_a_trajectory_all_but_the_building_is_read(folder, stairs):
    (folder / "trajectory.evac").unlink()
    read = evac.read_results(folder)
    check_same(read, stairs, but={"folder"})
    assert read.trajectory is None
    with pytest.raises(ResultError, match=r"trajectory\.evac"):
        _ = read.building


def test_the_case_of_a_plugin_file_asks_for_it_and_runs_nothing(stairs, folder):
    data = json.loads((folder / "summary.json").read_text(encoding="utf-8"))
    data["case"]["plugins"] = {"files": ["bomb.py"]}
    (folder / "summary.json").write_text(json.dumps(data), encoding="utf-8")
    read = evac.read_results(folder)
    assert read.evacuated == stairs.evacuated
    assert "Down a stair" in read._repr_html_()
    with pytest.raises(EvacError, match=r"bomb\.py"):
        _ = read.case


def in_summary(*keys, value):
    def change(text):
        data = table = json.loads(text)
        for key in keys[:-1]:
            table = table[key]
        table[keys[-1]] = value
        return json.dumps(data)

    return change


def in_column(name, value):
    def change(text):
        head, first, *rest = text.splitlines()
        fields = first.split(",")
        fields[head.split(",").index(name)] = value
        return "\n".join([head, ",".join(fields), *rest])

    return change


@pytest.mark.parametrize(
    ("name", "change", "words"),
    [
        ("summary.json", None, "summary.json"),
        ("summary.json", lambda text: text[: len(text) // 2], "summary.json"),
        ("summary.json", lambda text: "[]", "summary.json"),
        ("summary.json", lambda text: 70 * '{"a":' + "1" + 70 * "}", "summary.json"),
        ("summary.json", in_summary("people", value="many"), "people"),
        ("summary.json", in_summary("people", value=5), "5 people"),
        ("people.csv", lambda text: text.replace(",out,", ",,", 1), "exit"),
        ("summary.json", in_summary("seed", value=99), "seed 99"),
        ("summary.json", in_summary("last_out", value=-1.0), "last_out"),
        ("summary.json", in_summary("exits", "out", "width", value=None), "exits.out.width"),
        ("summary.json", in_summary("case", "building", "closed", value=5), "case.building.closed"),
        ("summary.json", in_summary("routes", value=[]), "routes"),
        ("summary.json", in_summary("changes", value=[{"time": 1}]), "changes.0"),
        (
            "summary.json",
            in_summary("changes", value=[{"time": 1.0, "kind": "close", "what": "gate", "values": {}}]),
            "gate",
        ),
        ("people.csv", None, "people.csv"),
        ("people.csv", lambda text: text.rstrip().rpartition("\n")[0], "'people' is 11"),
        ("people.csv", lambda text: text.replace("exit_time", "left", 1), "exit_time"),
        ("people.csv", in_column("radius", "wide"), "radius"),
        ("people.csv", in_column("radius", "-0.2"), "radius"),
        ("people.csv", in_column("speed", ""), "speed"),
        ("people.csv", in_column("speed", "-1e308"), "speed"),
        ("people.csv", in_column("mass", "inf"), "mass"),
        ("people.csv", in_column("exit", "nowhere"), "nowhere"),
        ("people.csv", in_column("exit_time", "1.0"), "exit_time"),
        ("people.csv", in_column("end_level", ""), "end_level"),
        ("people.csv", in_column("start_level", ""), "start_level"),
        ("people.csv", in_column("route", ""), "route"),
        ("people.csv", in_column("group", "nobody"), "nobody"),
        ("people.csv", in_column("tau", "1" * 200_000), "people.csv"),
        ("crossings.csv", None, "crossings.csv"),
        ("crossings.csv", in_column("person", "12"), "person"),
        ("crossings.csv", in_column("portal", "gate"), "gate"),
        ("crossings.csv", in_column("time", "nan"), "time"),
    ],
)
def test_damaged_files_and_files_of_other_runs_are_named(folder, name, change, words):
    path = folder / name
    text = path.read_text(encoding="utf-8")
    path.unlink()
    if change is not None:
        assert change(text) != text
        path.write_text(change(text), encoding="utf-8")
    with pytest.raises(ResultError) as error:
        evac.read_results(folder)
    assert name in str(error.value)
    assert words in str(error.value)
    assert "\n" not in str(error.value)
