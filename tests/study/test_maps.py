"""Maps over the runs of a study: those of its runs made again, one by one."""

import numpy as np
import pytest

import evac
from evac.analysis.maps import level_maps
from evac.report.figures import BEYOND
from evac.report.study import study_report
from evac.results.verdict import least_margins
from evac.study.maps import LIMITS, MARGIN, SPACING, maps_over_runs
from evac.study.outputs import hold_up_of
from tests.conditions.corridor import corridor


def test_maps_over_runs_are_those_of_the_runs(tmp_path):
    people = [{"name": "p", "area": "f", "number": 4}]
    plan = {
        "storeys": [{"name": "f", "polygons": [[[0, 0], [8, 0], [8, 4], [0, 4]]]}],
        "exits": [{"name": "e", "storey": "f", "segment": [[8, 1], [8, 3]]}],
        "areas": [{"name": "f", "storey": "f", "polygon": [[0, 0], [4, 0], [4, 4], [0, 4]]}],
    }
    case = corridor(people=people, building={"plan": plan}, safety={"available": 4.0})
    study = evac.repeat(case, 3, maps=True, folder=tmp_path / "s", workers=1)
    runs = [study.run_again(0, k, tmp_path / str(k)) for k in range(3)]
    own = [level_maps(run.trajectory, spacing=SPACING)["f"] for run in runs]
    again = evac.read_study(tmp_path / "s")
    (over,) = maps_over_runs(again, 0).values()
    for name in ("density", "max_density", "waiting", "usage"):
        np.testing.assert_allclose(
            again.maps()["f"].array(name), np.mean([one.array(name) for one in own], axis=0), 1e-5
        )
    shares = 100.0 * np.mean([np.nan_to_num(one.waiting) > LIMITS["waiting"] for one in own], axis=0)
    floor = ~np.isnan(own[0].density)
    np.testing.assert_allclose(over.shares["waiting"][floor], shares[floor])
    cells = {}
    for run in runs:
        least = {}
        for one in least_margins(run.margins, run.trajectory):
            place = min(int(one.y / SPACING), 7), min(int(one.x / SPACING), 15)
            least[place] = min(one.margin, least.get(place, np.inf))
        for place, margin in least.items():
            cells.setdefault(place, []).append(margin)
    assert {place: over.least_margin[place] for place in cells} == pytest.approx(
        {place: np.mean(margins) for place, margins in cells.items()}, rel=1e-5
    )
    late = {place: 100.0 * sum(margin < 0.0 for margin in margins) / 3 for place, margins in cells.items()}
    assert {place: over.shares[MARGIN][place] for place in cells} == pytest.approx(late)
    assert max(late.values()) > 0.0
    assert np.isfinite(over.least_margin).sum() == len(cells)
    assert again.building().levels[0].polygon.equals(runs[0].building.levels[0].polygon)
    text = study_report(study.folder)
    assert "mean over runs" in text
    assert "Share of the runs with margins below 0 s" in text
    for name, limit in LIMITS.items():
        beyond, is_any = BEYOND[name].format(limit), bool((over.shares[name] > 0.0).any())
        told = [words in text for words in (f"Share of the runs with {beyond}.", f"No run has {beyond} at any place.")]
        assert told == [is_any, not is_any]
    assert evac.repeat(case, 2, workers=1).maps() == {}
    (bare,) = maps_over_runs(evac.repeat(case.change({"safety": None}), 1, maps=True, workers=1), 0).values()
    assert np.isnan(bare.least_margin).all()
    assert np.nanmax(bare.maps.density) > 0.0


def test_what_holds_up_most_over_runs_is_told_as_of_runs(tmp_path):
    plan = {
        "storeys": [{"name": "f", "polygons": [[[0, 0], [8, 0], [8, 4], [0, 4]]]}],
        "exits": [{"name": "e", "storey": "f", "segment": [[8, 1], [8, 1.6]]}],
    }
    case = corridor(people=[{"name": "p", "level": "f", "number": 50}], building={"plan": plan})
    case = case.change({"behaviours.walking": {}})
    study = evac.repeat(case, 2, folder=tmp_path / "s", workers=1)
    queues = [study.run_again(0, k, tmp_path / str(k)).queues for k in range(2)]
    share = sum(of[0].waited for of in queues) / sum(queue.waited for of in queues for queue in of)
    assert {of[0].place for of in queues} == {"exit 'e'"}
    assert hold_up_of(study, 0) == (
        f"What holds up most is exit 'e': {100.0 * share:.0f} % of all waiting, long in 2 of 2 runs"
    )
    assert hold_up_of(study, 0) in study_report(study.folder).replace("&#39;", "'")
    few = evac.repeat(case.change({"people.p.number": 1}), 1, workers=1)
    assert hold_up_of(few, 0) == "Little waiting in every run"
    assert not hold_up_of(
        evac.repeat(case.change({"output.trajectory": False, "output.replay": False}), 1, workers=1), 0
    )
