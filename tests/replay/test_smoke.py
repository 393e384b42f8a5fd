"""Smoke and doses in the page."""

import numpy as np
import pytest

import evac
from evac.pictures import palette
from evac.pictures.palette import colouring
from tests.conditions.corridor import corridor, prescribed


@pytest.fixture(scope="module")
def result(tmp_path_factory):
    """Three people in a corridor: one in smoke and gases that get denser, one behind them, one in clear air."""
    area = {"name": "west", "level": "f", "polygon": [[0, 0], [50, 0], [50, 2], [0, 2]]}
    values = {"extinction": [0, 4], "co": [0, 30000], "co2": [0, 5], "o2": [21, 15]}
    smoke = prescribed(area="west", times=[0, 10], values=values, hold=True)
    positions = ((0.5, 1.0), (45.0, 1.0), (80.0, 1.0))
    case = corridor(smoke, positions=positions, dose={"heat": "none"})
    case = case.change(
        {"building.areas": [area], "simulation.duration": 15.0, "smoke.contrast": 8.0, "safety": {"visibility": 10.0}}
    )
    return evac.run(case, tmp_path_factory.mktemp("smoke") / "result")


def test_the_page_has_the_smoke_and_the_doses_of_the_trajectory(browser, result):
    trajectory = result.trajectory
    browser.open(trajectory.path.with_name("replay.html"))
    for name in ("dose", "visibility", "smoke at heads"):
        browser.run(f"replay.act.colour('{name}')")
        browser.run(f"replay.act.layer('{name}')") if name != "dose" else None
    smoke = trajectory.field("extinction")
    assert np.nanmax(trajectory.dose) > 0.1
    for k in range(0, len(trajectory), 5):
        frame = trajectory[k]
        browser.run(f"replay.act.seek({frame['time']})")
        browser.settle()
        found = browser.run(
            """(() => {
              const { record, people, state } = replay, { now } = record, rows = [...Array(now.count).keys()];
              const of = (name) => rows.map((i) => people.valueOf(name, now, i));
              return { dose: of("dose"), smoke: of("smoke at heads"), seen: of("visibility") };
            })()"""
        )
        expected = [smoke.at([0], at[None])[k, 0] for at in frame["position"]]
        assert found["dose"] == pytest.approx(frame["dose"], abs=0.00051)
        assert found["smoke"] == pytest.approx(expected, abs=0.03)
        assert found["seen"] == pytest.approx(8.0 / np.maximum(found["smoke"], 1e-6))
        visibility = colouring(trajectory, "visibility").of(frame)[:, 0]
        share = np.minimum(np.array(found["seen"]) / 30.0, 1.0)
        assert np.abs(visibility - 255 * palette.ramp_of("speed")[(255 * share).astype(int)]).max() < 8
    for place in ("#legend", "#layer-legend"):
        assert "mean height of heads" in browser.text(place)


def test_the_verdict_opens_the_page_and_the_least_margins_lead_to_people(browser, result):
    browser.open(result.trajectory.path.with_name("replay.html"))
    assert browser.text("#answer").startswith(result.verdict["text"])
    assert browser.run("document.querySelector('#answer p').className") == "red"
    (bar,) = browser.run("[...document.querySelectorAll('#bars div')].map((one) => [one.className, one.title])")
    assert bar[0] == "red"
    assert "'f' is not left by everybody, available for 2.0 s (visibility)" in bar[1]
    least = result.margins["least_margin"]
    worst = int(np.nanargmin(least))
    assert f"{least[worst]:.1f} s: person {worst}" in browser.text("#margins li")
    row = "document.querySelector('#margins button')"
    browser.run(f"{row}.scrollIntoView()")
    browser.click(
        *browser.run(f"(({{ x, y, width, height }}) => [x + width / 2, y + height / 2])({row}.getBoundingClientRect())")
    )
    assert browser.run("replay.stage.meshes.track.count") > 0
    browser.settle()
    shown = browser.run("[replay.state.selected, replay.state.time]")
    assert shown == [worst, pytest.approx(result.margins["least_margin_at"][worst])]


def test_the_layer_is_seen_where_smoke_is(browser, result):
    browser.open(result.trajectory.path.with_name("replay.html"))
    assert browser.run("document.getElementById('layer').value") == "smoke at heads"  # as it opens
    for name, shown, limit in (("smoke at heads", [255, 0], 0.8), ("visibility", [17, 255], 10.0)):
        browser.run(f"replay.act.layer('{name}')")
        browser.run("replay.act.seek(12)")
        browser.settle()
        found = browser.run(
            f"""(() => {{
              const {{ density, people, smoke, record }} = replay, [ox, oy] = record.origin;
              const bytes = smoke.layer("{name}", record.now.frame, people.scaleOf("{name}", ""));
              const {{ top }} = people.scaleOf("{name}", ""), at = (x) => bytes[density.node(0, x - ox, 1 - oy)];
              return [at(20), at(90), smoke.limitOf("{name}", people) * top];
            }})()"""
        )
        assert found[:2] == [pytest.approx(seen, abs=3) for seen in shown]
        assert found[2] == pytest.approx(limit)  # where the visibility is 10 m, with a contrast of 8


def test_a_run_without_conditions_has_neither(browser, storeys):
    browser.open(storeys[0])
    options = "[...document.querySelectorAll('#colour option, #layer option')]"
    choices = browser.run(f"{options}.map((one) => one.value)")
    assert not {"dose", "visibility", "smoke at heads"} & {*choices}
