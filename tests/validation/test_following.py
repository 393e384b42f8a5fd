"""Teacher following in the whole school, and a group with a slow member in a corridor."""

import numpy as np

from evac.evidence.validation.buildings import rectangle
from evac.scenario.loading import load_case
from evac.simulation import Simulation
from tests.validation.buildings import simulate, track

SECOND = 1.0  # of travel time


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


def share_ahead(simulation):
    """Return the share of all pupils' time spent more than a second ahead of their teacher."""
    return float(np.mean(np.concatenate(leads(simulation)) > SECOND))


def test_pupils_keep_behind_their_teachers_and_six_classes_get_out():
    kept = []
    for seed in (1, 2, 3, 4):
        simulation = Simulation(load_case("primary_school", {"simulation.seed": seed}))
        ahead = leads(simulation)
        assert np.mean(np.concatenate(ahead) > SECOND) <= 0.05
        kept += [np.mean(values > SECOND) <= 0.05 for values in ahead if len(values)]
        assert simulation.ended == "everybody out"
        stair = {row for row, level in enumerate(simulation._start[1]) if level > 0}
        crossed = set(simulation.population.crossings[0].tolist())
        assert stair <= crossed
    assert np.mean(kept) >= 0.95  # of the pupils of all runs


def test_without_the_behaviour_pupils_run_ahead():
    changes = {f"people.{number}.behaviours": {} for number in range(1, 12, 2)}
    case = load_case("primary_school", changes | {"behaviours.teacher_following": False})
    assert share_ahead(Simulation(case)) > 0.05


def test_a_blocked_teacher_releases_its_class():
    """A teacher who cannot walk: its class waits, then goes on without it."""
    simulation = Simulation(
        load_case("primary_school", {"people.teacher_1a.speed": 1e-6, "simulation.duration": 150.0})
    )
    simulation.run()
    groups = {group.name: group.rows for group in simulation.population.groups}
    crowd = simulation.population.crowd
    assert crowd.level[groups["teacher_1a"][0]] >= 0
    assert np.isfinite(crowd.exit_time[groups["class_1a"]]).all()


def spread(folder, follow):
    """NIST TN 1822, 2.9: four people at 1.25 m/s and one at 0.5 m/s walk 60 m; the spread of their exit times [s]."""
    rest = {"name": "rest", "positions": [[1.0 + 0.8 * k, 0.8] for k in range(4)], "z": 0.0, "speed": 1.25}
    settings = {"behaviours": {"teacher_following": {}}} if follow else {}
    if follow:
        rest["behaviours"] = {"teacher_following": {"teacher": "slow"}}
    slow = {"name": "slow", "positions": [[4.5, 2.2]], "z": 0.0, "speed": 0.5}
    simulation = simulate(
        folder, [rectangle(0, 0, 60, 3)], [("end", [[60, 0], [60, 3]], 0.0)], [slow, rest], **settings
    )
    simulation.run()
    return float(np.ptp(simulation.population.crowd.exit_time))


def test_nist_2_9_a_group_arrives_together(tmp_path):
    assert spread(tmp_path, follow=True) <= 10.0
    assert spread(tmp_path, follow=False) > 30.0
