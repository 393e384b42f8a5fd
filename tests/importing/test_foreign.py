"""Buildings made by others (../shared/data/foreign) are imported as independent libraries read them (foreign.csv)."""

import csv
import resource
from collections import defaultdict

import numpy as np
import pytest
import shapely

from evac import BuildingError, import_building
from evac.building.model.links import levels_reaching
from evac.importing.rooms import NEGLIGIBLE
from tests.importing.independent import FOREIGN, TABLE, rows_of

pytestmark = pytest.mark.skipif(not FOREIGN.is_dir(), reason="../shared/data/foreign is not there")

EXPECTED: dict[str, dict[str, float]] = defaultdict(dict)
with TABLE.open(encoding="utf-8") as file:
    for row in csv.DictReader(file):
        EXPECTED[row["file"]][row["quantity"]] = float(row["value"])

#: Options of files that name no exit.
OPTIONS = {
    "aknz_evac.wkt": {"exits": [1]},
    "bjnortier_floorplan.dxf": {"exits": [1]},
    "caserne.geojson": {"exits": [3, 5, 6, 7, 9]},
    "constructiq_house_plan.dxf": {"exits": [6], "options": {"plan": "1"}},
    "corner_with_shortcut.wkt": {"exits": [5]},
    "double_bottleneck.wkt": {"exits": [3]},
    "imdf_unit.geojson": {"exits": [1, 3, 4]},
    "office_rooms.wkt": {"exits": [11]},
    "westport-1.geojson": {"exits": [15, 16, 17, 18]},
    "wrld3d_cad.dxf": {"exits": [1]},
}
#: Nothing in them can be walked to an exit.
REFUSED = ("TallBuilding.ifc", "ios_411_walls.ifc", "nav_test.obj")
SLOW = (
    "AC11-Institute.ifc",
    "aknz_evac.wkt",
    "caserne.geojson",
    "imdf_unit.geojson",
    "ios_411_walls.ifc",
    "westport-1.geojson",
    "wrld3d_cad.dxf",
    "xbim_House.ifc",
)


def marked(name):
    return pytest.param(name, marks=[pytest.mark.slow] if name in SLOW else [])


@pytest.mark.parametrize("name", [marked(name) for name in sorted(EXPECTED) if name not in REFUSED])
def test_the_whole_building_is_imported(tmp_path, name):
    made = import_building([FOREIGN / name], tmp_path / "case", **OPTIONS.get(name, {}))
    floors = [level for level in made.building.levels if level.kind == "floor"]
    found = {
        "storeys": len({level.name.partition(" z=")[0].partition(" (")[0] for level in floors}),
        "stairs": len(made.building.stairs),
        "exits": len(made.building.exits),
        "area": pytest.approx(sum(level.polygon.area for level in floors), rel=0.02),
    }
    assert made.fault == ""
    assert EXPECTED[name] == {quantity: found[quantity] for quantity in EXPECTED[name]}
    # Nobody starts in stairwells. Ground without a way out, such as a shaft, is negligible, and told with its place.
    joined = levels_reaching(made.building, made.building.exits)
    empty = [room for room in made.rooms if not room.number]
    wells, empty = ([one for one in empty if (one.level in joined) == is_open] for is_open in (True, False))
    for room in wells:
        (area,) = [one for one in made.building.areas if one.name == room.name]
        ends = [portal.segments for portal in made.building.portals_of(room.level)]
        assert area.polygon.dwithin(shapely.linestrings(np.concatenate(ends).reshape(-1, 2, 2)), 1.0).any()
    assert sum(room.ground for room in empty) <= NEGLIGIBLE * sum(level.polygon.area for level in floors)
    told = {one.level for one in made.findings if one.kind == "warning" and one.place}
    assert {made.building.levels[room.level].name for room in empty} <= told


def test_storeys_without_a_stair_are_refused(tmp_path):
    made = import_building([FOREIGN / "TallBuilding.ifc"], tmp_path / "case")
    assert not made.is_accepted
    (missing,) = made.missing
    assert missing.startswith("3 of 4 storeys have no way out")
    assert not [one for one in made.findings if one.kind == "warning"]
    assert len(made.building.exits) == EXPECTED["TallBuilding.ifc"]["exits"]


@pytest.mark.parametrize(
    ("options", "reason"),
    [
        ({}, r"joins nothing.*building\.up = \"y\""),
        pytest.param({"up": "y"}, r"only 0\.00 m deep between its portals", marks=pytest.mark.slow),
    ],
)
def test_hills_of_a_game_whose_levels_are_wedges_are_refused(tmp_path, options, reason):
    with pytest.raises(BuildingError, match=rf"nav_test.*{reason}"):
        import_building([FOREIGN / "nav_test.obj"], tmp_path / "case", options=options)


@pytest.mark.slow
def test_a_product_whose_shape_has_no_end_is_named(tmp_path):
    started = resource.getrusage(resource.RUSAGE_CHILDREN).ru_utime
    with pytest.raises(BuildingError, match=r"IfcWallStandardCase #218 .* takes more than 2 s"):
        import_building([FOREIGN / "ios_411_walls.ifc"], tmp_path, options={"product_time": 2.0})
    assert resource.getrusage(resource.RUSAGE_CHILDREN).ru_utime - started < 60.0


@pytest.mark.slow
@pytest.mark.parametrize("name", [marked(name) for name in sorted(EXPECTED) if not name.endswith(".ifc")])
def test_the_table_is_what_the_independent_reading_finds(name):
    for library in {".dxf": ["ezdxf"], ".obj": ["trimesh"]}.get(name[name.rindex(".") :], []):
        pytest.importorskip(library)
    with TABLE.open(encoding="utf-8") as file:
        rows = [tuple(row) for row in csv.reader(file) if row[0] == name]
    assert list(rows_of(FOREIGN / name)) == rows
