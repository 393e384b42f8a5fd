"""What leaving out saves."""

import json

import numpy as np
import pytest

from evac.case.loading import load_case
from evac.cli.main import COMMANDS
from evac.contract.registry import Registry
from evac.evidence.evidence import in_fresh_process
from evac.evidence.lean import commands, kernels, unused_route
from evac.evidence.lean import page as lean
from evac.evidence.lean.page import FIELDS, LEAN, NAMED, Part, Trial, parts_of, same_bits, scene_rows, trial
from evac.simulation.simulation import Simulation


def state(value):
    return {name: np.array([value]) for name in lean.COMPARED}


def test_bits_are_compared_in_every_tick():
    one = Trial(0.0, 0.0, [state(1.0), state(np.nan)])
    assert same_bits(one, Trial(9.0, 9.0, [state(1.0), state(np.nan)]))
    assert not same_bits(one, Trial(0.0, 0.0, [state(np.nextafter(1.0, 2.0)), state(np.nan)]))
    assert not same_bits(one, Trial(0.0, 0.0, [state(1.0)]))
    assert not same_bits(Trial(0.0, 0.0, [state(0.0)]), Trial(0.0, 0.0, [state(-0.0)]))


def test_another_seed_is_not_the_same():
    case = load_case("square_room", {"simulation.duration": 0.5})
    assert same_bits(trial(case, LEAN), trial(case, Part("all", full=True, loop=("tests", *lean.LOOP))))
    assert not same_bits(trial(case, LEAN), trial(case.change({"simulation.seed": 2}), LEAN))


@pytest.mark.parametrize("part", NAMED, ids=lambda part: part.name)
def test_each_part_is_out_until_it_is_forced_in(part):
    case = load_case("square_room", dict(part.overrides))
    label = part.name.partition(",")[0]
    lean_run, full_run = Simulation(case), Simulation(case, full=True)
    assert next(entry.is_in for entry in lean_run.plan if entry.name == label) is False
    assert len(full_run.forces) + len(full_run.behaviours) == 1 + len(lean_run.forces) + len(lean_run.behaviours)


@pytest.mark.parametrize("model", lean.MODELS)
def test_every_part_that_explain_lists_as_out_has_a_row_or_cannot_be_forced_in(model):
    case = load_case("square_room", lean.model_overrides(model))
    out = {part.name for part in Simulation(case).plan if not part.is_in}
    told = {"portals: tests for walls, portals and exits": "portals"}
    have = {told.get(part.name, part.name) for part in parts_of("square_room", model, ())}
    have |= {name.partition(",")[0] for name in have if name.startswith("tangential contact")}
    # What explain says of forces and behaviours when none is named stands for those of NAMED.
    assert out - have == {"stair speeds", "forces at a distance", "behaviours", "people outside"} | (
        {"position correction"} if model == "NSM2" else set()
    )


def test_an_unused_strategy_costs_its_field_and_nothing_else():
    registry = Registry([unused_route.__file__])
    part = next(part for part in parts_of("square_room", "DEM") if part.name == "fields: comfortable")
    plain = Simulation(load_case("square_room", {}, (), registry))
    forced = Simulation(load_case("square_room", dict(part.overrides), (), registry))
    assert [route.strategy for route in forced.fields.routes] == [
        *(route.strategy for route in plain.fields.routes),
        "comfortable",
    ]
    assert len(forced.behaviours) == len(plain.behaviours) == 0


@pytest.mark.slow
def test_rows_name_every_part_and_model():
    rows = list(scene_rows("square_room", 0.5, NAMED[:1], rounds=2))
    assert [(row["model"], row["part included"]) for row in rows] == [
        (model, part.name) for model in lean.MODELS for part in parts_of("square_room", model, NAMED[:1])
    ]
    assert {row["same bits"] for row in rows} == {"yes"}
    assert FIELDS.name in {row["part included"] for row in rows}
    for row in rows:
        assert row["loop without it [ms]"] > 0.0
        assert row["set-up, least [ms]"] <= row["set-up [ms]"] <= row["set-up, greatest [ms]"]
        assert row["loop, least [%]"] <= row["loop [%]"] <= row["loop, greatest [%]"]


def made_up_kernels(function, name, overrides, full, first):
    """The same two kernels in every run, and two more with everything in."""
    found = {"driver.advance": [3.0, 2000], "dem.spring": [1.0, 1000]}
    if full:
        found |= {"seams.reaches": [0.5, 500], "social.social": [0.25, 100]}
    assert set(first) == (set(found) - {"seams.reaches", "social.social"} if full else set())
    return {"kernels": found, "functions": 40 if full else 30, "before": 0}


def test_kernels_that_a_case_leaves_out_are_told_with_what_compiling_them_takes(monkeypatch):
    monkeypatch.setattr(kernels, "in_fresh_process", made_up_kernels)
    rows = kernels.kernel_rows(kernels.KernelCase("square_room", "DEM", {}, {}))
    (row,) = kernels.summary_rows(rows)
    assert (row["kernels"], row["functions"], row[kernels.CPU]) == (2, 30, 4.0)
    assert [row[f"left out: {key}"] for key in ("kernels", "functions", kernels.CPU)] == [2, 10, 0.75]
    found = {row["kernel"]: row["square_room, DEM"] for row in kernels.loaded_rows(rows)}
    assert found == {"driver.advance": "in", "dem.spring": "in", "seams.reaches": "if included",
                     "social.social": "if included"}  # fmt: skip


@pytest.mark.slow
def test_what_a_case_loads_is_what_its_step_loop_needs():
    simulation = Simulation(load_case("square_room", lean.model_overrides("DEM")))
    needed = {entry.label for entry in simulation.engine.entries(simulation.contact)}
    found = in_fresh_process(
        kernels.loaded, "square_room", lean.model_overrides("DEM"), False, ["evac_plugins.contact_dem.spring"]
    )
    assert needed <= set(found["kernels"])
    assert next(iter(found["kernels"])) == "evac_plugins.contact_dem.spring"
    assert found["functions"] > len(found["kernels"])
    assert all(span > 0.0 and size > 0 for span, size in found["kernels"].values())
    assert not any("seams" in label or "solver" in label for label in found["kernels"])


def test_every_command_is_timed(tmp_path):
    timed = {arguments[2] for arguments in commands.commands(tmp_path).values() if "evac" in arguments}
    assert timed >= set(COMMANDS)


@pytest.mark.slow
def test_output_of_a_fresh_process_counts_the_imports():
    switches = {"output.picture": True, "output.animation": False}
    commands.output_time(switches)
    assert in_fresh_process(commands.output_time, switches) > commands.output_time(switches)


@pytest.mark.slow
def test_page_is_written(tmp_path):
    lean.run(lean.Evidence("lean", tmp_path, quick=True))
    assert {path.name for path in tmp_path.iterdir()} == {
        "README.md", "run.json", "parts.csv", "output.csv", "commands.csv",
        "kernels.csv", "kernels_compiled.csv", "kernels_loaded.csv",
    }  # fmt: skip
    verdicts = json.loads((tmp_path / "run.json").read_text())["verdicts"]
    parts = len((tmp_path / "parts.csv").read_text().splitlines()) - 1
    assert (verdicts[0]["measured"], verdicts[0]["verdict"]) == (f"{parts} of {parts}", "met")
    page = (tmp_path / "README.md").read_text()
    lean.run(lean.Evidence("lean", tmp_path, page_only=True))
    assert (tmp_path / "README.md").read_text() == page
