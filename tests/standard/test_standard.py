"""The standard tests: names, buildings, runs and their folders, criteria, verdicts, and the page."""

import html
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from shapely import box

from evac.base.errors import SimulationError
from evac.results.results import Results
from evac.simulation.simulation import Simulation
from evac.standard import plans
from evac.standard.crowds import STAIR_DENSITIES, STAIR_SPEEDS, speeds_on_a_stair, weidmann
from evac.standard.trial import Outcome, StandardTest, Trial, check
from evac.standard.verify import (
    FAILED,
    NOT_APPLICABLE,
    PASSED,
    STANDARDS,
    TESTS,
    Result,
    carry_out,
    check_rows,
    find_tests,
    of_standard,
    page_of,
)
from evac.study.statistics import mean_interval as of_a_study


def found_times(*values):
    return check("time [s]", "RiMEA", values, low=26.0, high=34.0)


PERSON = {"positions": [[1.0, 1.0]], "z": 0.0, "speed": 1.0, "tau": 0.5}

#: The tests of each standard.
NUMBERS = {
    "RiMEA": [str(number) for number in range(1, 17)],
    "IMO": [str(number) for number in range(1, 13)],
    "NIST": ["1.1", *(f"2.{k}" for k in range(1, 11)), "3.1", "3.2", "3.3", "4.1", "5.1", "5.2"],
    "ISO": [*(str(number) for number in range(1, 22)), "V"],
}

HALF = """
'''People walk at half their speed.'''

import evac


class Half(evac.Behaviour):
    '''Half the speed.'''

    name = "half"
    writes = ("speed_factor",)

    def act(self, crowd, time):
        crowd.speed_factor *= 0.5


evac_interface = 3
"""


def corridor(length=6.0):
    return plans.one_storey(box(0, 0, length, 2), exits={"end": plans.across(length, 0, 2)})


def test_every_test_of_every_standard_has_one_row():
    names = [name for test in TESTS for name in test.names]
    assert sorted(names) == sorted(f"{one}-{number}" for one, numbers in NUMBERS.items() for number in numbers)
    assert list(STANDARDS) == list(NUMBERS)


def test_names_are_found_in_any_case_and_once():
    (test,) = find_tests(["imo-8", "NIST-2.8", "Iso-6"])
    assert test.names == ("IMO-8", "NIST-2.8", "ISO-6")
    assert find_tests(["nist"]) == of_standard("NIST")
    assert find_tests(["RiMEA-1", "all"]) == list(TESTS)


def test_a_test_without_measure_says_why(tmp_path):
    for test in TESTS:
        if test.measure is None:
            verdict = carry_out(test, Trial(tmp_path), 1).verdict
            assert verdict == NOT_APPLICABLE
            assert test.why.startswith(f"{verdict}: ")
    assert not list(tmp_path.iterdir())


def test_only_the_flow_through_a_door_fails_by_design():
    assert [test.names for test in TESTS if test.by_design] == [("IMO-4", "NIST-5.2", "ISO-11")]


def test_the_flow_through_a_door_fails_by_default_and_passes_with_the_preset(tmp_path):
    test = replace(find_tests(["IMO-4"])[0], runs=1)
    regulation = Trial(tmp_path / "regulation", settings=("behaviours.walking.preset=regulation",))
    assert carry_out(test, Trial(tmp_path), 1).verdict == FAILED
    assert carry_out(test, regulation, 1).verdict == PASSED


@pytest.mark.slow
def test_people_are_faster_down_a_stair_than_up_at_equal_densities(tmp_path):
    test = replace(find_tests(["RiMEA-13"])[0], runs=1)
    faster = carry_out(test, Trial(tmp_path), 1).checks[-1].mean
    assert 1.1 < faster < 1.6  # speeds alone: 1.36 (IMO MSC.1/Circ.1533, annex 3)


def test_speeds_on_a_stair_count_at_the_densities_that_were_measured():
    """So many people on 10 m2 at each moment: in the middle of the band up, faster down by 15 %, wrong elsewhere."""
    numbers = [1, 6, 8, 10, 12, 14, 15, 30]

    def runs(plan, people, way):
        x = np.where(np.arange(40) < np.repeat(numbers, 10)[:, None], 2.5, -1.0)
        middle = np.interp(0.1 * np.repeat(numbers, 10), STAIR_DENSITIES, np.mean(STAIR_SPEEDS["up"], axis=0))
        middle[(np.repeat(numbers, 10) < 6) | (np.repeat(numbers, 10) > 15)] = 9.0
        speed = np.broadcast_to((middle * (1.15 if way == "down" else 1.0))[:, None], x.shape)
        return [SimpleNamespace(trajectory=SimpleNamespace(position=np.stack([x, x], axis=2), speed=speed))]

    up, down, ratio = speeds_on_a_stair(SimpleNamespace(runs=runs))
    assert (up.values, down.values, ratio.values) == ((1.0,), (1.0,), (pytest.approx(1.15),))


def test_an_exit_that_closes_is_not_used_and_would_be_if_it_stayed_open(tmp_path):
    (test,) = find_tests(["ISO-9"])
    assert carry_out(test, Trial(tmp_path / "closes"), 1).verdict == PASSED
    open_, used = carry_out(test, Trial(tmp_path / "stays", settings=("event=[]",)), 1).checks
    assert open_.is_passed
    assert used.values == (0.0,)


def test_a_test_runs_alone_and_leaves_its_folder(tmp_path):
    (test,) = find_tests(["RiMEA-1"])
    result = carry_out(test, Trial(tmp_path), 3)
    assert result.verdict == PASSED
    results = Results.read(tmp_path / "RiMEA-1" / "run-3")
    assert results.keeps_distance == ["walking"]
    assert result.checks[0].values == (pytest.approx(results.crowd.exit_time[0]),)


def test_settings_reach_the_case(tmp_path):
    (run,) = Trial(tmp_path, settings=("contact.model=dem", "people.0.tau=1.5")).runs(corridor(), [PERSON])
    assert run.results.case.contact.model == "dem"
    assert run.last_out() == pytest.approx(5.0 + 1.5, abs=0.06)


def test_a_plugin_with_half_the_speed_fails_the_corridor(tmp_path):
    plugin = tmp_path / "half.py"
    plugin.write_text(HALF)
    trial = Trial(tmp_path / "out", settings=("behaviours.half={}",), plugin_files=(plugin,))
    result = carry_out(find_tests(["RiMEA-1"])[0], trial, 1)
    assert result.verdict == FAILED
    assert result.checks[0].mean == pytest.approx(40.0 / 0.665 + 0.5, abs=0.2)


def test_a_run_that_cannot_go_on_fails_its_test_alone(tmp_path):
    def measure(trial):
        raise SimulationError("no step")

    result = carry_out(StandardTest(("RiMEA-1",), "a corridor", measure), Trial(tmp_path), 1)
    assert (result.verdict, result.error) == (FAILED, "no step")
    assert [row["met"] for row in check_rows(result)] == ["NO: error"]


class Planned(Trial):
    """A trial that runs nothing and raises `PlannedError` with its first case."""

    def run_case(self, case, label):
        raise PlannedError(case)


class PlannedError(Exception):
    """A case is ready to be run."""


#: People, exits and ground [m2] of the first case of each test, and the least and the greatest desired speed [m/s].
FIRST_CASES = [
    ("RiMEA-1", 1, 1, 84, 1.33, 1.33),
    ("RiMEA-2", 1, 2, 36, 1.33, 1.33),
    ("RiMEA-3", 1, 2, 36, 1.33, 1.33),
    ("RiMEA-4", 80, 1, 200, 1.21, 1.396),
    ("RiMEA-5", 10, 1, 40, 1.33, 1.33),
    ("RiMEA-6", 20, 1, 44, 1.029, 1.604),
    ("RiMEA-7", 300, 1, 7200, 0.5186, 2.24),
    ("RiMEA-8", 136, 1, 478.48, 0.75, 0.75),
    ("RiMEA-9", 1000, 4, 600, 0.97, 1.619),
    ("RiMEA-10", 23, 2, 187.44, 1.002, 1.603),
    ("RiMEA-11", 1000, 2, 600, 0.97, 1.619),
    ("RiMEA-12", 150, 1, 100.2, 0.9764, 1.61),
    ("RiMEA-13", 100, 1, 218, 0.9956, 1.606),
    ("RiMEA-14", 100, 1, 360, 1, 1),
    ("RiMEA-15", 500, 1, 880, 1.34, 1.34),
    ("RiMEA-16", 18, 1, 72, 1.174, 1.829),
    ("IMO-1", 1, 1, 84, 1, 1),
    ("IMO-2", 1, 2, 36, 1, 1),
    ("IMO-3", 1, 2, 36, 1, 1),
    ("IMO-4", 100, 1, 52.7, 0.9956, 1.606),
    ("IMO-7", 50, 1, 1200, 1.029, 1.604),
    ("IMO-8", 100, 2, 220, 0.9956, 1.606),
    ("IMO-11", 150, 1, 78, 1.261, 1.339),
    ("IMO-12", 280, 1, 200, 1.2, 1.4),
    ("NIST-1.1", 300, 1, 1000, 1.201, 1.999),
    ("NIST-2.1", 1, 1, 120, 1, 1),
    ("NIST-2.2", 1, 2, 180, 1, 1),
    ("NIST-2.4", 100, 1, 2400, 0.8484, 1.602),
    ("NIST-2.5", 1, 1, 200, 1.25, 1.25),
    ("NIST-2.6", 1, 1, 25, 1.898, 1.898),
    ("NIST-2.7", 1, 1, 85.52, 1, 1),
    ("NIST-2.9", 15, 1, 240, 0.2, 1.25),
    ("NIST-2.10", 25, 1, 46, 0.8, 1.25),
    ("NIST-3.2", 1, 2, 120, 1.2, 1.2),
    ("NIST-3.3", 50, 2, 120, 1.029, 1.604),
    ("NIST-4.1", 1, 2, 150, 1, 1),
    ("ISO-3", 1, 2, 36, 1, 1),
    ("ISO-12", 100, 1, 207, 0.9956, 1.606),
    ("ISO-13", 60, 1, 120, 1, 1),
    ("ISO-14", 15, 1, 240, 0.5, 1.25),
    ("ISO-17", 10, 1, 125, 1.2, 1.2),
    ("ISO-21", 1, 2, 60.7846, 1.898, 1.898),
]


@pytest.mark.parametrize(("name", "people", "exits", "ground", "slowest", "fastest"), FIRST_CASES)
def test_the_first_case_of_each_test_is_that_of_its_standard(tmp_path, name, people, exits, ground, slowest, fastest):
    (test,) = find_tests([name])
    with pytest.raises(PlannedError) as planned:
        list(test.measure(Planned(tmp_path)))
    simulation = Simulation(planned.value.args[0], will_run=False)
    building, speed = simulation.building, simulation.population.crowd.speed[:, 0]
    assert (len(speed), len(building.exits)) == (people, exits)
    assert sum(level.polygon.area for level in building.levels) == pytest.approx(ground)
    assert [speed.min(), speed.max()] == pytest.approx([slowest, fastest], rel=1e-3)


def test_every_test_that_is_run_has_its_first_case():
    assert [name for name, *_ in FIRST_CASES] == [test.name for test in TESTS if test.measure]


@pytest.mark.parametrize(
    ("name", "model"),
    [
        *(("RiMEA-1", "dem"), ("RiMEA-1", "nsm1"), ("RiMEA-1", "nsm2"), ("RiMEA-2", "nsm2"), ("RiMEA-6", "dem")),
        *(
            pytest.param(f"RiMEA-{k}", model, marks=pytest.mark.slow)
            for k, model in ((3, "dem"), (5, "nsm1"), (6, "nsm2"))
        ),
    ],
)
def test_the_models_of_the_paper_pass_the_tests_of_people_who_walk_alone(tmp_path, name, model):
    test, paper = find_tests([name])[0], Trial(tmp_path, settings=(f"contact.model={model}",), is_paper=True)
    checks = carry_out(replace(test, runs=1), paper, 1).checks
    assert [check.quantity for check in checks if not check.is_passed and "random places" not in check.quantity] == []
    if name == "RiMEA-1":
        crowd = Results.read(tmp_path / name / "run-1").crowd
        assert crowd.exit_time == pytest.approx([40.0 / 1.33 + 0.5], abs=0.006)
        assert crowd.distance == pytest.approx([40.0], abs=0.02)


def test_each_seed_has_a_folder_and_an_outcome(tmp_path):
    runs = Trial(tmp_path, seeds=(1, 2)).runs(corridor(), [PERSON], "two words")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["two-words-1", "two-words-2"]
    for one in runs:
        assert one.last_out() == pytest.approx(5.0 + 0.5, abs=0.01)
        assert one.passing_times(0, 4.0) == pytest.approx([3.0 + 0.5], abs=0.02)
        assert one.out_by("end").tolist() == [True]
        assert one.densities(0, 0, 2, 2)[0] == 0.25


def test_passing_times_lie_between_recorded_states():
    x = np.array([[0.0, 5.0, 3.0, 0.0], [3.0, 6.0, 5.0, 1.0], [5.0, 7.0, np.nan, 2.0]])
    motion = SimpleNamespace(time=np.array([0.0, 1.0, 3.0]), position=np.stack([x, np.zeros_like(x)], axis=2))
    times = Outcome(SimpleNamespace(), motion).passing_times(0, 4.0)
    assert times == pytest.approx([2.0, np.nan, 0.5, np.nan], nan_ok=True)  # the second begins beyond the line


def test_people_left_make_a_run_blocked(tmp_path):
    (run,) = Trial(tmp_path).runs(corridor(), [PERSON], simulation={"duration": 2.0})
    assert run.is_blocked
    assert np.isnan(run.last_out())
    assert np.isnan(run.passing_times(0, 4.0)).all()


@pytest.mark.parametrize(
    ("plan", "kinds", "portals"),
    [
        (plans.straight_stair(8.0, 6.0), ["flight", "floor", "floor"], 2),
        (plans.halls_and_stair("up", 1.2, 3.0, 3.0), ["flight", "floor", "floor"], 2),
        (plans.halls_and_stair("down", 2.0, 5.0, 3.0), ["flight", "floor", "floor"], 2),
        (plans.room_corridor_stair(), ["flight", "floor", "floor"], 2),
        (plans.detour_and_stairs(), ["flight", "flight", "floor", "floor"], 4),
        (plans.ring_and_bridge(), ["flight", "flight", "floor", "floor"], 4),
        (plans.cabins()[0], ["floor"], 0),
        (plans.rooms_and_bottlenecks([1.0, 0.8], 0.2, 10.0), ["floor"], 0),
        (plans.rooms_and_bottlenecks([1.0], 5.0, 0.0), ["floor"], 0),
    ],
)
def test_buildings_hang_together(plan, kinds, portals):
    building = plan.building()
    assert sorted(level.kind for level in building.levels) == kinds
    assert len(building.portals) == portals


@pytest.mark.parametrize(
    ("values", "verdict"),
    [
        ((26.0,), "yes"),
        ((30.0, 30.2), "yes"),
        ((30.0, 36.0), "yes, not certain: 33"),
        ((33.0, 37.0), "NO, not certain: 35, 1.03 times the bound"),
        ((68.0, 68.0), "NO: 68, 2 times the bound"),
        ((68.0,), "NO: 68, 2 times the bound"),
        ((13.0,), "NO: 13, 0.5 times the bound"),
        ((30.0, np.nan, 30.0), "NO: 1 of 3 runs block"),
        ((np.nan,), "NO: 1 of 1 runs block"),
    ],
)
def test_a_check_is_passed_by_its_mean_and_by_no_blocked_run(values, verdict):
    found = found_times(*values)
    assert found.verdict == verdict
    assert found.is_passed == verdict.startswith("yes")


def test_blocked_runs_are_left_out_of_the_mean_and_counted():
    found = found_times(28.0, np.nan, 32.0, 30.0)
    assert (found.mean, found.blocked) == (30.0, 1)
    assert found.interval == of_a_study(np.array([28.0, 32.0, 30.0]))
    assert found_times(np.nan).mean is None


def test_a_check_of_several_runs_without_an_interval_is_not_certain():
    assert found_times(0.83, 1.65).interval is None  # Student's t gives -3.93 to 6.41
    assert found_times(14.0, 46.0).verdict == "yes, not certain: 30"


def test_weidmanns_curve_has_its_published_values():
    assert [weidmann(density) for density in (0.5, 1.0, 2.0, 3.0)] == pytest.approx(
        [1.298, 1.058, 0.606, 0.331], abs=1e-3
    )
    assert weidmann(5.4) == pytest.approx(0.0)


def test_a_test_is_passed_if_all_its_checks_are():
    test = find_tests(["RiMEA-2"])[0]
    mixed = Result(test, (found_times(30.0), check("speed [m/s]", "RiMEA", [0.5], low=1.0)))
    whole = Result(test, (found_times(30.0), check("speed [m/s]", "RiMEA", [1.5], low=1.0)))
    assert (mixed.verdict, whole.verdict) == (FAILED, PASSED)


def test_the_page_says_for_each_test_how_it_ended_and_why(tmp_path):
    """A test that is passed, one that misses two bounds, one that fails by design, and one that is not applicable."""

    def run(names, title, **more):
        return StandardTest(names, title, lambda trial: (), **more)

    tests = [run(("RiMEA-1",), "one"), run(("IMO-1", "NIST-2.1"), "two"), run(("IMO-4",), "three", by_design="so")]
    tests.append(next(test for test in TESTS if test.measure is None))
    good, low, high = found_times(30.0), found_times(20.0), found_times(40.0)
    checks = (good,), (good, low, high), (high,), ()
    results = [Result(test, each) for test, each in zip(tests, checks, strict=True)]
    assert [one.verdict for one in results] == [PASSED, FAILED, FAILED, NOT_APPLICABLE]
    page = " ".join(page_of(results, Trial(tmp_path, is_paper=True, settings=("a=1", "b=2")), 7).split())
    missed = "; ".join(f"{one.quantity}: {one.verdict}" for one in (low, high))
    reasons = ("", missed, f"{missed.rpartition('; ')[2]}; so", tests[3].why.partition(": ")[2])
    for test, reason in zip(tests, reasons, strict=True):
        row = page[page.index(html.escape(test.title)) :].partition("</tr>")[0]
        assert row.rstrip().endswith(f"{html.escape(reason)}</td>")
    assert "as in the paper" in page
    assert "a=1 b=2" in page
