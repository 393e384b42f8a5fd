"""What leaving out saves."""

import json

import numpy as np
import pytest

from evac.evidence import lean
from evac.evidence.lean import ALWAYS, NAMED, Trial, same_bits, scene_rows, trial
from evac.scenario.loading import load_case


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
    assert same_bits(trial(case, False), trial(case, True))
    assert not same_bits(trial(case, False), trial(case.change({"simulation.seed": 2}), False))


@pytest.mark.parametrize("part", NAMED, ids=lambda part: part.name)
def test_each_part_is_out_until_it_is_forced_in(part):
    case = load_case("square_room", dict(part.overrides))
    kind, name = next(iter(part.overrides)).split(".")
    label = f"{'force' if kind == 'forces' else 'behaviour'}: {name}"
    from evac.simulation import Simulation

    lean_run, full_run = Simulation(case), Simulation(case, full=True)
    assert next(entry.is_in for entry in lean_run.plan if entry.name == label) is False
    assert len(full_run.forces) + len(full_run.behaviours) == 1 + len(lean_run.forces) + len(lean_run.behaviours)


def test_rows_name_every_part_and_model():
    rows = scene_rows("square_room", 0.5, NAMED[:1], rounds=1)
    assert [(row["model"], row["part forced in"]) for row in rows] == [
        (model, part) for model in lean.MODELS for part in (ALWAYS.name, NAMED[0].name)
    ]
    assert {row["same bits"] for row in rows} == {"yes"}
    assert all(row["of the lean loop's [ms]"] > 0.0 for row in rows)


def test_page_is_written(tmp_path, monkeypatch):
    monkeypatch.setattr(lean, "COMMANDS", {"python alone": ["-c", "pass"], "import evac": ["-c", "import evac"]})
    monkeypatch.setattr(lean, "MODELS", ("DEM",))
    evidence = lean.Evidence("lean", tmp_path, quick=True)
    lean.run(evidence)
    assert {path.name for path in tmp_path.iterdir()} == {
        "README.md", "run.json", "parts.csv", "parts.png", "output.csv", "commands.csv",
    }  # fmt: skip
    assert "NO" not in (tmp_path / "parts.csv").read_text()
    assert "7 of 7" in json.loads((tmp_path / "run.json").read_text())["summary"]
