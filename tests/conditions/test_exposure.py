"""People in smoke and gases: where and when the air is read, who is stopped, and what results say about it."""

import ast
import subprocess
import sys

import numpy as np
import pytest

import evac
from evac.analysis.measures import records
from evac.cli.main import main
from evac.conditions.law import share_with_irritants
from evac.export.vtk import people_polydata
from evac.simulation.shared import simulation_of
from evac.simulation.simulation import Simulation
from evac_buildings.office_fire.write_slices import CO, EXTINCTION, write_slices
from tests.conditions.corridor import corridor, prescribed, standing, two_storeys
from tests.runs import assert_same_bits, run_ticks

#: People are stopped within a second by 10 % of CO.
DOSE = {"heat": "none", "threshold": 0.05}


def test_values_are_linear_between_times():
    simulation = simulation_of(corridor(prescribed(times=[0, 10, 20], values={"extinction": [0, 4, 0]}, hold=True)))
    air, at = simulation.exposure.air, (np.zeros(1, np.int32), np.array([[50.0, 1.0]]), np.array([1.5]))
    found = [air.at(("extinction",), time, *at)[0, 0] for time in (0.0, 2.5, 10.0, 15.0, 20.0, 99.0)]
    np.testing.assert_allclose(found, [0.0, 1.0, 4.0, 2.0, 0.0, 0.0])


def test_a_run_that_outlasts_its_data_fails_unless_they_hold():
    table = prescribed(times=[0, 10], values={"extinction": [0, 1]})
    with pytest.raises(evac.ScenarioError, match=r"conditions\.0: the values end at 10 s .* hold = true"):
        simulation_of(corridor(table)).run()
    held = simulation_of(corridor({**table, "hold": True}))
    assert held.run().ended == "everybody out"
    late = {**table, "start": 4.0}
    with pytest.raises(evac.ScenarioError, match="the values end at 6 s"):
        simulation_of(corridor(late)).run()


def test_people_read_the_air_where_they_are():
    """A gradient of K made of ten areas: the speed follows it."""
    areas = [{"name": f"a{k}", "level": "f", "polygon": [[10 * k, 0], [10 * k + 10, 0], [10 * k + 10, 2], [10 * k, 2]]}
             for k in range(10)]  # fmt: skip
    tables = [prescribed(float(k), area=f"a{k}") for k in range(10)]
    case = corridor(*tables)
    case = case.change({"building.areas": areas})
    simulation = simulation_of(case)
    crowd, times = simulation.population.crowd, {}
    while not simulation.ended:
        before = crowd.position[0, 0]
        simulation.advance_tick()
        for x in range(2, 100, 5):
            if before < x <= crowd.position[0, 0]:
                times[x] = simulation.time - 0.1 * (crowd.position[0, 0] - x) / (crowd.position[0, 0] - before)
    for k in range(1, 10):
        speed = 5.0 / (times[10 * k + 7] - times[10 * k + 2])
        assert speed == pytest.approx(1.25 * (1.0 - 0.057 / 0.706 * k), rel=1e-5)


def test_a_child_walks_below_smoke_that_slows_others():
    case = corridor(prescribed(5.0, above=1.3), positions=((0.5, 0.6), (0.5, 1.4)))
    heights = {"people.p.height": {"list": [1.0, 1.8]}}
    simulation = simulation_of(case.change(heights))
    results = simulation.run()
    np.testing.assert_array_equal(results.exposure["greatest_extinction"], [0.0, 5.0])
    assert results.crowd.exit_time[1] > 1.5 * results.crowd.exit_time[0]


def stop_in_the_middle():
    """Three people, of whom the one in the middle area is stopped at once, in the way of the one behind."""
    area = {"name": "gas", "level": "f", "polygon": [[20, 0], [30, 0], [30, 2], [20, 2]]}
    places = ((10.0, 1.0), (25.0, 1.0), (40.0, 1.0))
    tables = {"dose": DOSE, "smoke": {"law": "none"}, "behaviours": {"walking": {}}}
    deadly = prescribed(
        area="gas", times=[0, 1, 2], values={"co": [100000, 100000, 0], "co2": 0.0, "o2": 20.9}, hold=True
    )
    return corridor(deadly, positions=places, **tables).change({"building.areas": [area]})


def test_people_who_are_stopped_stay_and_are_passed_and_the_run_ends_without_them(tmp_path):
    results = evac.run(stop_in_the_middle(), tmp_path / "result")
    assert (results.ended, results.exit_status) == ("everybody out who can move", 3)
    assert results.stopped.tolist() == [1]
    assert results.people["stopped_at"].notna().tolist() == [False, True, False]
    assert (results.evacuated, results.not_started, list(results.stuck)) == (2, 0, [])
    assert results.people["gas_dose"].gt(0.05).tolist() == [False, True, False]
    assert abs(results.crowd.position[1, 0] - 25.0) < 1.5
    assert np.abs(results.crowd.position[1] - results.start_position[1]).max() < 1.5
    assert results.crowd.distance[0] > 90.0  # it walked round
    assert any("stopped" in line for line in results.remarks)
    assert "2 of 3 people out, 1 stopped by gases or heat" in results.answer.outcome
    summary = results.summary()
    assert summary["stopped"] == summary["conditions"]["dose"]["stopped"] == 1
    read = evac.read_results(tmp_path / "result")
    assert read.summary()["conditions"] == summary["conditions"]
    assert read.people.equals(results.people)
    assert read.exit_status == 3


def before_a_door(folder, model, walking, strategy="fastest"):
    """Return a case of people who leave by a door before which gases of slices of FDS stop one of them at once."""

    def gas(x, y, z, time):
        return 0.2 * (x > 10.0) * (time < 1.5)

    clear = {"CARBON DIOXIDE": 0.0, "OXYGEN": 0.209}
    slices = [(CO, 1.5, False, gas), (EXTINCTION, 1.5, False, lambda x, y, z, time: 0.1 * time + 0.0 * x)]
    slices += [
        (f"{name} VOLUME FRACTION", 1.5, False, lambda x, y, z, t, v=v: v + 0.0 * x) for name, v in clear.items()
    ]
    path, _ = write_slices(folder, [(0, 12, 0, 6, 0, 3)], slices, np.arange(21.0))
    plan = {
        "storeys": [{"name": "f", "polygons": [[[0, 0], [12, 0], [12, 6], [0, 6]]]}],
        "exits": [{"name": "out", "storey": "f", "segment": [[12, 2], [12, 4]]}],
        "areas": [{"name": "start", "storey": "f", "polygon": [[1, 1], [7, 1], [7, 5], [1, 5]]}],
    }
    stays = {"name": "stays", "level": "f", "positions": [[11.5, 3.0]], "leave": False, "radius": 0.22}
    table = {
        "building": {"plan": plan},
        "contact": {"model": model},
        "people": [stays, {"name": "p", "number": 20, "area": "start", "speed": 1.2, "strategy": strategy}],
        "conditions": [{"source": "fds", "file": str(path), "hold": True}],
        "dose": {"heat": "none", "threshold": 0.05},
        "simulation": {"duration": 60.0},
        "behaviours": {"walking": {}} if walking else {},
    }
    return evac.load(table)


@pytest.mark.parametrize(("model", "walking"), [("dem", False), ("nsm1", False), ("nsm2", True)])
def test_people_who_are_stopped_before_a_door_are_not_pushed_away_but_passed(tmp_path, model, walking):
    results = simulation_of(before_a_door(tmp_path, model, walking)).run()
    assert (results.ended, results.exit_status, results.evacuated) == ("everybody out who can move", 3, 20)
    (stopped,) = results.stopped
    assert results.staying == 0  # who does not leave either is named once
    (remark,) = results.remarks
    assert "stopped" in remark
    assert np.abs(results.crowd.position[stopped] - [11.5, 3.0]).max() < 0.01
    assert np.nanmax(results.crowd.exit_time) < 30.0


def test_runs_with_slices_and_stopped_people_have_the_same_bits_resumed_and_full(tmp_path):
    case = before_a_door(tmp_path, "nsm2", True, "quickest").change({"smoke.period": 1.0, "people.p.speed": 2.0})
    case = case.change({"dose.susceptibility": "log-normal"})
    whole, first = run_ticks(simulation_of(case), 90), run_ticks(simulation_of(case), 41)
    assert first.exposure.stopped.any()
    assert first.scene.smoky is not None
    resumed = simulation_of(case)
    resumed.restore(first.state())
    for other in (run_ticks(resumed, 49), run_ticks(Simulation(case, full=True), 90)):
        assert_same_bits(whole, other)
        for name, values in whole.results().exposure.items():
            np.testing.assert_array_equal(values, other.results().exposure[name])


@pytest.mark.parametrize(
    ("case", "words"),
    [
        (lambda: standing(co=1.0, co2=1.0), ["o2", 'dose.without = ["o2"]']),
        (lambda: standing({"heat": "clothed"}, co=1.0, co2=1.0, o2=20.0), ["temperature"]),
        (lambda: corridor(prescribed(values={"co": 1.0})), ["extinction", 'law = "none"']),
        (lambda: standing({"without": ["o3"]}, co=1.0), ["dose.without", "'o3'", "did you mean"]),
    ],
)
def test_a_quantity_that_is_missing_is_refused_or_declared_off(case, words):
    with pytest.raises(evac.ScenarioError) as error:
        simulation_of(case())
    for word in words:
        assert word in str(error.value)
    assert "\n" not in str(error.value)


def test_a_level_on_which_a_source_lacks_what_another_has_elsewhere_is_refused():
    """Otherwise people there would breathe clear air in the middle of smoke."""
    plan = {
        "storeys": [
            {"name": name, "z": z, "polygons": [[[0, 0], [9, 0], [9, 4], [0, 4]]]}
            for name, z in (("a", 0.0), ("b", 3.0))
        ],
        "exits": [{"name": f"out {name}", "storey": name, "segment": [[0, 1], [0, 3]]} for name in "ab"],
    }
    gases = {"co": 1.0, "co2": 0.1, "o2": 20.0}
    tables = [prescribed(1.0, level="a", values=gases), prescribed(1.0, level="b")]
    people = [{"name": "p", "level": "a", "positions": [[5, 2]]}]
    table = {"building": {"plan": plan}, "people": people, "contact": {"model": "nsm1"}, "dose": {"heat": "none"}}
    table["conditions"] = tables
    with pytest.raises(evac.ScenarioError, match=r"no source provides co .* on level 'b'.* dose\.without"):
        simulation_of(evac.load(table))
    simulation_of(evac.load({**table, "conditions": [*tables, prescribed(values=gases, level="b")]}))
    simulation_of(evac.load({**table, "conditions": tables[:1]}))


SCRIPT = """
import sys, evac
results = evac.run(evac.load("square_room", {"simulation.duration": 1.0, "output.every": 0.5}), None)
print([name for name in sys.modules if name.startswith("evac.conditions.")])
"""


def test_without_conditions_nothing_of_the_room_is_used():
    """Plugins import the base classes of sources and laws, as they are registered."""
    done = subprocess.run([sys.executable, "-c", SCRIPT], capture_output=True, text=True, check=True)
    used = {"evac.conditions.law", "evac.conditions.source"}
    assert set(ast.literal_eval(done.stdout.splitlines()[-1])) <= used
    case = evac.load("square_room", {"conditions": []})
    assert simulation_of(case, will_run=False).exposure is None


def test_smoke_on_the_levels_is_recorded_and_read_by_behaviours(tmp_path):
    area = {"name": "west", "level": "f", "polygon": [[0, 0], [50, 0], [50, 2], [0, 2]]}
    table = prescribed(area="west", times=[0, 2, 4], values={"extinction": [0, 0, 8]}, hold=True)
    waits = {"behaviours": {"response_time": {"time": 0.0, "begin": "cue", "fields": {"extinction": 2.0}}}}
    case = corridor(table).change({"building.areas": [area], "simulation.duration": 8.0, **waits})
    results = evac.run(case, tmp_path / "result")
    field = results.trajectory.field("extinction")
    times = results.trajectory.time
    assert field.unit == "1/m"
    assert field.at([0, 0], np.array([[10.5, 1.0], [80.5, 1.0]]))[times == 4.0].tolist() == [[8.0, 0.0]]
    assert field.at([0], np.array([[10.5, 1.0]]))[times == 2.0].tolist() == [[0.0]]
    assert 4.0 <= results.crowd.start_time[0] <= 4.2


def test_people_who_are_stopped_do_not_wait_in_a_queue(tmp_path):
    area = {"name": "west", "level": "f", "polygon": [[0, 0], [50, 0], [50, 2], [0, 2]]}
    table = prescribed(area="west", values={"extinction": 0.0, "co": 1e5, "co2": 0.0, "o2": 21.0})
    case = corridor(table, positions=((0.5, 1.0), (90.0, 1.0)), dose=DOSE).change({"building.areas": [area]})
    results = evac.run(case, tmp_path / "result")
    assert (results.stopped.tolist(), results.exit_status) == ([0], 3)
    (found,) = records(results.trajectory)
    assert found.started[
        (found.person == 0) & (results.trajectory.time[found.frame] < results.exposure["stopped_at"][0])
    ].all()
    assert not found.waits.any()
    assert "queue" not in results.answer.queue


def test_doses_and_smoke_are_in_the_tables_of_motion_and_in_exports(tmp_path):
    area = {"name": "west", "level": "f", "polygon": [[0, 0], [50, 0], [50, 2], [0, 2]]}
    values = {"extinction": [0, 4], "co": [0, 30000], "co2": [0, 5], "o2": [21, 15]}
    table = prescribed(area="west", times=[0, 10], values=values, hold=True)
    case = corridor(table, positions=((0.5, 1.0), (80.0, 1.0)), dose={"heat": "none"})
    folder = tmp_path / "result"
    evac.run(case.change({"building.areas": [area], "simulation.duration": 12.0}), folder)
    trajectory = evac.read_trajectory(folder)
    frame = trajectory.frame.set_index(["time", "person"]).sort_index()
    assert frame["extinction"].loc[10.0].tolist() == [4.0, 0.0]
    assert frame["extinction"].loc[5.0].tolist() == pytest.approx([1.6, 0.0])  # of the last update, at 4 s
    doses = trajectory.dose[:, 0]
    np.testing.assert_array_equal(frame["dose"].loc[:, 0], doses)
    assert (np.diff(doses) >= 0.0).all()
    assert doses[-1] > 0.1
    assert main(["export", str(folder), "--to", "csv"]) == 0
    (table,) = (folder / "export").glob("*.csv")
    assert table.read_text().splitlines()[0].split(",")[-2:] == ["dose", "extinction"]
    points = people_polydata(trajectory, trajectory[-1]).point_arrays
    np.testing.assert_array_equal(points["dose"], trajectory[-1]["dose"].astype(np.float32))


def test_a_run_does_not_end_for_lack_of_progress_while_the_air_can_change():
    closing = {"event": [{"kind": "close", "target": "out", "time": 1.0}]}
    settings = {"simulation": {"duration": 200.0, "no_progress": 5.0}}
    smoke = prescribed(times=[0, 100], values={"extinction": [0.0, 1.0]}, hold=True)
    ends = [simulation_of(corridor(*air, **closing, **settings)).run() for air in ((), (smoke,))]
    assert [run.ended for run in ends] == ["no progress"] * 2
    assert ends[0].time < 95.0
    assert ends[1].time == pytest.approx(100.0, abs=1.1)
    out = simulation_of(corridor(smoke, dose={"heat": "none", "without": ["co", "co2", "o2"]})).run()
    assert out.time == pytest.approx(out.last_out, abs=0.11)


@pytest.mark.parametrize(("duration", "stopped"), [(100.0, 1), (40.0, 0)])
def test_people_at_a_refuge_breathe_its_air(duration, stopped):
    plan = two_storeys() | {"areas": [{"name": "r", "storey": "up", "polygon": [[0, 4], [12, 4], [12, 8], [0, 8]]}]}
    case = corridor(
        prescribed(values={"co": 20000.0}),
        building={"plan": plan},
        people=[{"name": "chair", "area": "r", "number": 1, "steepest": 0.1}],
        place=[{"name": "safe", "kind": "refuge", "area": "r"}],
        dose={"heat": "none", "without": ["co2", "o2"]},
        smoke={"law": "none", "routes": False},
        simulation={"duration": duration},
    )
    results = simulation_of(case).run()
    rate = 3.317e-5 * 20000.0**1.036 * 25.0 / 30.0 / 60.0
    assert len(results.stopped) == stopped
    assert results.exit_status == 3 * stopped
    assert results.time == pytest.approx(1.0 / rate if stopped else duration, abs=0.6)
    assert results.conditions["dose"]["growing"] == 1 - stopped
    assert any("still took a dose" in line for line in results.remarks) == (not stopped)


def test_who_crawls_in_thick_smoke_waits_because_of_it_and_not_for_a_door():
    area = {"name": "smoke", "level": "f", "polygon": [[20, 0], [30, 0], [30, 2], [20, 2]]}
    for extinction, place in ((12.0, "smoke on 'f'"), (8.0, None)):  # of which the law makes 0.125 and 0.443 m/s
        case = corridor(prescribed(extinction, area="smoke"), positions=((10.0, 0.5), (10.0, 1.5)))
        results = evac.run(case.change({"building.areas": [area]}), progress=False)
        assert results.conditions["slow_from"] == pytest.approx(0.84 * 0.706 / 0.057, rel=0.03)
        assert (results.hold_up and results.hold_up.place) == place
        waited = sum(queue.waited for queue in results.queues)
        assert waited == pytest.approx(2 * 10.0 / 0.125 if place else 0.0, rel=0.1, abs=1.0)


@pytest.mark.parametrize(("hcl", "place"), [(150.0, "smoke on 'f'"), (30.0, None)])
def test_irritants_that_alone_would_not_make_people_slow_count_with_the_smoke(hcl, place):
    smoke = prescribed(values={"extinction": 6.0, "hcl": hcl, "co": 0.0, "co2": 0.04, "o2": 20.9}, hold=True)
    results = evac.run(corridor(smoke, positions=((95.0, 1.0),), dose={"heat": "none"}), progress=False)
    assert (results.hold_up and results.hold_up.place) == place
    fields = {field.name: results.trajectory.field(field.name).values for field in results.trajectory.level_fields}
    left = max(0.1, 1.0 - 0.057 * 6.0 / 0.706 - (1.0 - share_with_irritants(np.array([hcl / 900.0]))[0]))
    inside = fields["extinction"] == 6.0
    np.testing.assert_allclose(fields["speed_in_smoke"][inside], 1.25 * left, rtol=1e-5)
    np.testing.assert_allclose(fields["speed_in_smoke"][~inside], 1.25, rtol=1e-5)
