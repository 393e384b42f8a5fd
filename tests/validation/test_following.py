"""Teacher following in the whole school, and a group with a slow member in a corridor."""

import numpy as np
import pytest

from evac.case.loading import load_case
from evac.simulation.simulation import Simulation
from tests.validation.buildings import rectangle, track, write_case

SECOND = 1.0  # of travel time

#: Whether people keep their distance, and whether the social force pushes them apart.
KEEPING_APART = ((False, True), (True, False))


def out_before_teacher(simulation):
    """Return how many of the groups "class..." got out before the group "teacher..." of the same ending."""
    exit_time = simulation.population.crowd.exit_time
    groups = {group.name: group.rows for group in simulation.population.groups}
    return sum(
        int((exit_time[rows] < exit_time[groups[name.replace("class", "teacher")][0]]).sum())
        for name, rows in groups.items()
        if name.startswith("class")
    )


@pytest.mark.parametrize(("headway", "social"), KEEPING_APART)
def test_a_class_stays_behind_a_teacher_who_waits_for_the_last(tmp_path, headway, social):
    """Twelve follow through 20 m of corridor to a door, and one more at 0.6 m/s."""
    follows = {"behaviours": {"teacher_following": {"teacher": "teacher"}}}
    people = [
        {"name": "teacher", "positions": [[9.0, 1.5]], "z": 0.0},
        {"name": "class", "area": "front", "number": 12, **follows},
        {"name": "last", "positions": [[1.0, 1.5]], "z": 0.0, "speed": 0.6, **follows},
    ]
    sections = {
        "contact.model": "nsm2",
        "behaviours": {"teacher_following": {}} | ({"headway": {}} if headway else {}),
        "forces": {"social": {}} if social else {},
    }
    door, front = ("door", [[20, 0.9], [20, 2.1]], 0.0), ("front", (4, 0.3, 8.5, 2.7), 0.0)
    for seed in (1, 2):
        seeded = sections | {"simulation.seed": seed}
        simulation = Simulation(write_case(tmp_path, [rectangle(0, 0, 20, 3)], [door], people, [front], seeded))
        simulation.run()
        assert simulation.ended == "everybody out"
        assert out_before_teacher(simulation) == 0


def leads(simulation):
    """Run and return each pupil's leads over its teacher [s], one for each tick while both are inside and walk."""
    groups = {group.name: group.rows for group in simulation.population.groups}
    classes = [name for name in groups if name.startswith("class")]
    pupils = np.concatenate([groups[name] for name in classes])
    teacher = np.concatenate([np.full(len(groups[n]), groups[n.replace("class", "teacher")][0]) for n in classes])
    found = [[] for _ in pupils]
    for time, crowd in track(simulation):
        remaining = simulation.fields.travel_time_at(crowd.level, crowd.position, crowd.route)
        both = (crowd.level[pupils] >= 0) & (crowd.level[teacher] >= 0) & (time >= crowd.start_time[pupils])
        for k in np.flatnonzero(both):
            found[k].append(remaining[teacher[k]] - remaining[pupils[k]])
    return [np.array(values) for values in found]


def test_pupils_keep_behind_their_teachers_and_six_classes_get_out():
    kept = []
    for seed in (1, 2):
        simulation = Simulation(load_case("primary_school", {"simulation.seed": seed}))
        ahead = leads(simulation)
        assert np.mean(np.concatenate(ahead) > SECOND) <= 0.05
        kept += [np.mean(values > SECOND) <= 0.05 for values in ahead if len(values)]
        assert simulation.ended == "everybody out"
        stair = {row for row, level in enumerate(simulation.start_level) if level > 0}
        crossed = set(simulation.population.crossings[0].tolist())
        assert stair <= crossed
    assert np.mean(kept) >= 0.95  # of the pupils of all runs
