"""Values that a case or a CSV file prescribes: where and when they apply, and what is refused."""

import numpy as np
import pytest

import evac
from evac.simulation.shared import simulation_of
from tests.conditions.corridor import prescribed

ROOM = [[0, 0], [10, 0], [10, 4], [0, 4]]


def storeys(*tables, **more):
    """Return a case of two storeys without people who leave, with tables of conditions."""
    plan = {
        "storeys": [{"name": name, "z": z, "polygons": [ROOM]} for name, z in (("down", 0.0), ("up", 3.0))],
        "exits": [{"name": f"out {name}", "storey": name, "segment": [[0, 1], [0, 3]]} for name in ("down", "up")],
        "areas": [{"name": "west", "storey": "down", "polygon": [[0, 0], [5, 0], [5, 4], [0, 4]]}],
    }
    people = [{"name": "p", "level": "down", "positions": [[8, 2]]}]
    table = {"building": {"plan": plan}, "contact": {"model": "nsm1"}, "people": people, "conditions": list(tables)}
    return evac.load({**table, **more})


def at(case, level, x, time, head=1.5, quantity="extinction"):
    """Return a value at a place, at a height above the floor."""
    simulation = simulation_of(case)
    level = simulation.building.level_named(level)
    place = np.array([level.index], np.int32), np.array([[x, 2.0]]), np.array([level.z_min + head])
    return simulation.exposure.air.at((quantity,), time, *place)[0, 0]


def test_the_last_of_several_sources_that_overlap_applies_quantity_by_quantity():
    case = storeys(
        prescribed(1.0, values={"co": 10.0}),
        prescribed(2.0, area="west"),
        prescribed(3.0, area="west", times=[0, 10], values={"extinction": [3.0, 5.0]}, below=1.0, hold=True),
    )
    assert at(case, "up", 2.0, 0.0) == at(case, "down", 8.0, 0.0) == 1.0
    assert at(case, "down", 2.0, 0.0) == 2.0
    assert at(case, "down", 2.0, 5.0, head=0.9) == 4.0
    assert at(case, "down", 2.0, 5.0, head=0.9, quantity="co") == 10.0


def test_a_csv_file_describes_levels_over_time(tmp_path):
    path = tmp_path / "smoke.csv"
    path.write_text(
        "\ufefftime, level, extinction, co\n0, down, 0, 5\n20, down, 4, 5\n\n0, up, 1, 0\n", encoding="utf-8"
    )
    case = storeys({"source": "prescribed", "file": str(path), "hold": True})
    assert [at(case, "down", 2.0, time) for time in (0.0, 5.0, 20.0, 99.0)] == [0.0, 1.0, 4.0, 4.0]
    assert at(case, "up", 2.0, 50.0) == 1.0
    assert at(case, "down", 2.0, 1.0, quantity="co") == 5.0


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("extinction\n1\n", ["line 1", "'time'"]),
        ("time,co,co\n0,1,1\n", ["line 1", "once"]),
        ("time,extinction\n0,1\n5\n", ["line 3", "2 cells"]),
        ("time,extinction\n0,many\n", ["line 2", "numbers"]),
        ("time,extinction\n", ["no lines"]),
        ("time,extinction\n0,-1\n", ["extinction", "-1", "[0, 10000]"]),
        ("time,extinction\n0,nan\n", ["extinction", "nan"]),
        ("time,temperature\n0,293\n9,400\n", ["temperature", "kelvin"]),
        ("time,extinction\n0,1\nnan,2\n9,3\n", ["times", "increase"]),
        ("time,extinction\n0,1\ninf,2\n", ["times", "increase"]),
        ("time,smoke\n0,1\n", ["smoke", "no such quantity"]),
        ("time,level,extinction\n0,cellar,1\n", ["'cellar'", "level"]),
        ("time,extinction\n0,1\n1,1\n2,1\n13,1\n", ["between 2 and 13 s", "every 1 s", "times and values"]),
        ("time,extinction\n0,\x001\n", ["line"]),
        ("\xff\xfe", ["UTF-8"]),
    ],
)
def test_damaged_csv_files_are_refused_with_the_line_or_the_quantity(tmp_path, text, words):
    path = tmp_path / "smoke.csv"
    path.write_bytes(text.encode("latin-1"))
    with pytest.raises(evac.ScenarioError) as error:
        simulation_of(storeys({"source": "prescribed", "file": str(path)}))
    assert all(word in str(error.value) for word in ["smoke.csv", *words]), error.value
    assert "\n" not in str(error.value)
