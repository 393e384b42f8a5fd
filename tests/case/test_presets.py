"""Presets: what groups take from them, and faults in them."""

import re

import pytest

from evac.case import case_from, load_case
from evac.case.schema import DESCRIPTION, GroupSettings, PeopleSettings, shipped_presets
from tests.case.faults import lines_of, says

PRESETS = {
    "presets": {"pupil": {"radius": 0.15, "speed": 1.1, "strategy": "shortest"}, "adult": {"mass": 80.0}},
    "people.pupils.preset": "pupil",
    "people.teacher.preset": "adult",
}


def test_a_group_takes_from_its_preset_what_it_does_not_say(case_file, registry):
    case = load_case(case_file, PRESETS, registry=registry)
    pupils, teacher = case.people
    assert (pupils.speed.mean(), pupils.radius.mean(), pupils.strategy) == (1.1, 0.2, "shortest")
    assert (teacher.mass.mean(), teacher.speed) == (80.0, GroupSettings.model_fields["speed"].default)
    faster = case.change({"presets.pupil.speed": 1.4, "people.pupils.strategy": "fastest"})
    assert (faster.people[0].speed.mean(), faster.people[0].strategy) == (1.4, "fastest")
    assert case_from(case.to_dict(), case.source, registry=registry).to_dict() == case.to_dict()


def test_a_group_with_a_preset_is_the_same_as_one_that_says_it_all(case_file, registry):
    case = load_case(case_file, PRESETS, registry=registry)
    plain = {"people.pupils.speed": 1.1, "people.pupils.strategy": "shortest", "people.teacher.mass": 80.0}
    for one, other in zip(case.people, load_case(case_file, plain, registry=registry).people, strict=True):
        assert one.model_dump(exclude={"preset"}) == other.model_dump(exclude={"preset"})


@pytest.mark.parametrize(
    ("key", "value", "line"),
    [
        ("people.pupils.preset", "pupl", "people.pupils.preset: unknown preset 'pupl'; did you mean 'pupil'?"),
        ("presets.pupil.sped", 1.0, "presets.pupil.sped: unknown key; did you mean 'speed'?"),
        ("presets.pupil.number", 5, "presets.pupil.number: unknown key; it belongs to people: did you mean "
         "'people.number'?"),
        ("presets.pupil.speed", -1.0, "presets.pupil.speed: must be at least 0, got -1"),
        ("presets.adult", 3, "presets.adult: must be a table, got 3"),
        ("presets.pupil.behaviours", {"wiat": {"time": 2.0}},
         "presets.pupil.behaviours.wiat: unknown behaviour; did you mean 'wait'?"),
        ("people.teacher.preset", 3, "people.teacher.preset: must be a valid string, got 3"),
    ],
)  # fmt: skip
def test_a_fault_of_a_preset_is_one_line(case_file, registry, key, value, line):
    assert lines_of(case_file, {**PRESETS, key: value}, registry) == [f"{case_file}: {line} (set by an override)"]


def test_a_preset_that_does_not_fit_a_group_is_a_fault_of_the_group(case_file, registry):
    (line,) = lines_of(case_file, {**PRESETS, "presets.pupil.mass": {"list": [60.0, 70.0]}}, registry)
    assert says(line, case_file, "people.pupils.mass: 2 values for 5 people")


@pytest.mark.parametrize("name", shipped_presets())
def test_every_shipped_preset_is_a_group_and_has_its_source(case_file, registry, name):
    preset = shipped_presets()[name]
    case = load_case(case_file, {"people.pupils.preset": name}, registry=registry)
    group = case.people[0]
    assert group.steepest == preset.get("steepest")
    assert group.speed.mean() == pytest.approx(
        case.change({"people.pupils.speed": preset["speed"]}).people[0].speed.mean()
    )
    assert preset["about"]
    assert re.search(r"\d{4}|FDS\+Evac", preset["source"])
    assert set(preset) - set(DESCRIPTION) <= set(PeopleSettings.model_fields)


def test_a_preset_of_the_case_goes_before_a_shipped_one(case_file, registry):
    case = load_case(
        case_file, {"people.pupils.preset": "adult", "presets": {"adult": {"speed": 0.5}}}, registry=registry
    )
    assert case.people[0].speed.mean() == 0.5


def test_impaired_people_of_guidelines_are_slower_and_wheelchairs_wide():
    shipped = shipped_presets()
    assert shipped["wheelchair"]["radius"] == 0.4
    assert not shipped["wheelchair"]["turns"]
    assert shipped["imo_male_30_to_50"]["speed"] == {"uniform": [0.97, 1.62]}
    assert shipped["impaired"]["speed"] == {"uniform": [0.46, 0.76]}
