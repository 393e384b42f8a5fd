"""A building in several formats: the same rooms, widths and travel times, and a case that runs."""

import json

import numpy as np
import pytest
from shapely.geometry import shape

import evac
from evac.cli.main import main
from tests.journeys.cases import HOUSE, JOURNEYS

#: Places of the house on which travel times are compared: level, x, y.
PLACES = [
    ("hall", 4.0, 4.0),
    ("hall", 12.0, 6.0),
    ("gallery", 10.0, 2.0),
    ("gallery", 12.5, 6.5),
    ("gallery", 3.0, 4.0),
]


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    """The house as a plan, a file of a plan, GeoJSON of a run, and a case that was imported from it."""
    folder = tmp_path_factory.mktemp("house")
    case = evac.load(JOURNEYS["events"], {"simulation.duration": 0.5, "output.replay": False})
    results = evac.run(case, folder / "run")
    assert main(["export", str(folder / "run"), "--to", "geojson", "--out", str(folder / "house.geojson")]) == 0
    made = evac.import_building([folder / "house.geojson"], folder / "imported")
    return folder, results.building, made


def test_a_building_is_the_same_in_every_format(files):
    folder, drawn, _ = files
    for path in (folder / "house.geojson", folder / "imported" / "case.toml", folder / "run"):
        if path.name == "run":
            other = evac.read_results(path).building
        elif path.name == "case.toml":
            other = evac.Simulation(path).building
        else:
            other = evac.read_building(path)
        assert [(one.name, one.kind, one.stair) for one in other.levels] == [
            (one.name, one.kind, one.stair) for one in drawn.levels
        ]
        for one, level in zip(drawn.levels, other.levels, strict=True):
            assert one.polygon.symmetric_difference(level.polygon).area < 1e-6
            assert (level.z_min, level.z_max) == (pytest.approx(one.z_min), pytest.approx(one.z_max))
            assert level.slope == pytest.approx(one.slope)
            np.testing.assert_allclose(level.uphill, one.uphill, atol=1e-9)
        for of in ("exits", "portals", "doors"):
            widths = [{one.name: one.width for one in getattr(building, of)} for building in (drawn, other)]
            assert widths[1] == pytest.approx(widths[0])
        areas = {one.name: (one.level, pytest.approx(one.polygon.area)) for one in drawn.areas}
        assert {one.name: (one.level, one.polygon.area) for one in other.areas} == areas
        walls = [np.hypot(*(one.walls[:, 2:] - one.walls[:, :2]).T).sum() for one in (drawn, other)]
        assert walls[1] == pytest.approx(walls[0])


def test_ways_are_as_long_in_every_format(files):
    folder, _, _ = files
    plan, imported = (
        evac.load({**JOURNEYS["events"], "event": [], "building": building})
        for building in ({"plan": HOUSE}, {"mesh": str(folder / "house.geojson")})
    )
    times = []
    for case in (plan, imported):
        simulation = evac.Simulation(case)
        numbers = {level.name: level.index for level in simulation.building.levels}
        level = [numbers[name] for name, _, _ in PLACES]
        place = np.array([place[1:] for place in PLACES])
        times.append(
            [
                simulation.fields.travel_time_at(np.array(level, np.int32), place, route, np.full(len(place), 0.2))
                for route in range(len(simulation.fields.routes))
            ]
        )
    np.testing.assert_allclose(times[0], times[1], rtol=1e-3)
    assert np.isfinite(times[0]).all()


def test_an_imported_case_runs_and_says_what_was_read(files, capsys):
    folder, drawn, made = files
    assert made.is_accepted
    assert (made.folder / "levels.png").stat().st_size > 10_000
    report = (made.folder / "report.md").read_text()
    assert all(exit_.name in report for exit_ in drawn.exits)
    results = evac.run(evac.load(made.folder / "case.toml", {"simulation.duration": 60.0}), folder / "result")
    assert results.ended == "everybody out"
    assert {*results.exits} == {exit_.name for exit_ in drawn.exits}
    assert [row["name"] for row in results.doors] == ["inner"]
    assert main(["check", str(made.folder / "case.toml")]) == 0
    told = capsys.readouterr().out
    for name in [level.name for level in drawn.levels if level.kind == "floor"] + [*results.exits, "inner"]:
        assert name in told
    assert main(["export", str(folder / "result"), "--to", "geojson", "--out", str(folder / "again.geojson")]) == 0
    one, other = (
        {
            (feature["properties"]["kind"], feature["properties"]["name"]): shape(feature["geometry"])
            for feature in json.loads((folder / name).read_text())["features"]
            if feature["properties"]["kind"] != "wall"
        }
        for name in ("house.geojson", "again.geojson")
    )
    ways = {key for key in one if key[0] in ("exit", "floor", "flight", "portal")}
    assert ways <= other.keys()
    for key in ways:
        assert one[key].hausdorff_distance(other[key]) < 1e-6
