"""Teacher following in a straight corridor, where the remaining travel time is the distance to its end."""

from types import SimpleNamespace

import numpy as np
import pytest
from shapely import box

import evac
from evac.directions.fields import NO_CELL_WALLS, Fields, PackedFields
from evac.directions.routes import Route
from evac.people.behaviour import BehaviourScene
from evac.physics.state import make_crowd
from evac.simulation.scene import SharedScene
from evac.simulation.simulation import Simulation
from evac_plugins.behaviour_teacher_following import TeacherFollowing

LENGTH = 100.0
TICK = 0.1


def corridor_fields():
    """Return the fields of a corridor: route 0 ends at x = LENGTH, route 1 at x = 0, route 2 nowhere."""
    x = np.repeat(np.arange(LENGTH + 1.0), 5)
    return Fields(
        routes=(Route(("east",)), Route(("west",)), Route(("none",))),
        packed=PackedFields(
            origin=np.zeros((1, 2)),
            shape=np.array([[len(x) // 5, 5]], dtype=np.int32),
            spacing=1.0,
            width=np.zeros(0),
            field_of=np.array([[0, 1, -1]], dtype=np.int32),
            offset=np.array([0, len(x)], dtype=np.int64),
            direction=np.zeros((2 * len(x), 2)),
            travel_time=np.concatenate([LENGTH - x, x]),
            walls=NO_CELL_WALLS,
        ),
    )


class Corridor:
    """People who walk to the right without touching: each with a place and a speed, in groups."""

    def __init__(self, *groups, start_time=0.0, **parameters):
        """Take groups as (name, [x ...], [speed ...], settings)."""
        self.x = np.concatenate([np.asarray(x, dtype=float) for _, x, _, _ in groups])
        self.speed = np.concatenate([np.asarray(speed, dtype=float) for _, _, speed, _ in groups])
        n = len(self.x)
        ends = np.cumsum([len(x) for _, x, _, _ in groups])
        self.groups = tuple(
            SimpleNamespace(name=name, rows=np.arange(end - len(x), end, dtype=np.int32), settings=settings)
            for (name, x, _, settings), end in zip(groups, ends, strict=True)
        )
        self.crowd = make_crowd(np.column_stack([self.x, np.full(n, 2.0)]), start_time=start_time)
        self.crowd.speed[:] = self.speed[:, None]
        self.blocked = np.zeros(n, dtype=bool)
        self.out = np.full(n, np.nan)
        self.behaviour = TeacherFollowing(**parameters)
        self.scene = BehaviourScene(
            self.crowd,
            SharedScene(SimpleNamespace(links=()), corridor_fields()),
            self.groups,
            np.random.default_rng(1),
            TICK,
        )
        self.step = 0
        self.behaviour.prepare(self.scene)

    def tick(self):
        """Let everybody decide, then walk for one tick."""
        crowd, time = self.crowd, self.step * TICK
        crowd.speed_factor[:] = 1.0
        self.behaviour.act(crowd, time)
        walks = (crowd.level >= 0) & ~self.blocked & (time >= crowd.start_time)
        self.x += np.where(walks, self.speed * crowd.speed_factor * TICK, 0.0)
        crowd.position[:, 0] = self.x
        self.step += 1
        self.out[(self.x >= LENGTH) & (crowd.level >= 0)] = self.step * TICK
        crowd.level[self.x >= LENGTH] = -1

    def run(self, seconds):
        for _ in range(round(seconds / TICK)):
            self.tick()


FOLLOWS = {"teacher": "teacher"}


def test_a_slow_teacher_keeps_its_class_behind():
    class_ = Corridor(("teacher", [10.0], [0.8], {}), ("class", np.linspace(8, 9.9, 22), [1.6] * 22, FOLLOWS))
    leads = []
    while class_.crowd.level[0] >= 0:
        class_.tick()
        leads.append(class_.x[1:].max() - class_.x[0])
    assert max(leads) <= 0.0
    assert class_.out[0] == pytest.approx(90 / 0.8, abs=2 * TICK)
    class_.run(20)
    assert np.isfinite(class_.out).all()


def test_members_take_up_the_pace_behind_their_teacher_and_stand_ahead_of_it():
    places = [6.0, 7.0, 8.0, 9.0, 10.0, 11.0, 12.0]
    class_ = Corridor(("teacher", [10.0], [1.0], {}), ("class", places, [1.0] * 7, FOLLOWS), trail=2.0)
    class_.behaviour.act(class_.crowd, 0.0)
    assert class_.crowd.speed_factor[1:] == pytest.approx([1.0, 1.0, 1.0, 0.5, 0.0, 0.0, 0.0])


@pytest.mark.parametrize(("gap", "factor"), [(0.0, 1.0), (4.0, 1.0), (6.0, 0.5), (8.0, 0.0), (9.0, 0.0)])
def test_teacher_slows_for_the_widest_gap_in_its_line(gap, factor):
    """Three follow; a fourth, who stands ahead, is not in the line."""
    places = [28.0 - gap, 28.0, 29.0, 31.0]
    class_ = Corridor(("teacher", [30.0], [1.0], {}), ("class", places, [1.0] * 4, FOLLOWS), lag=8.0)
    class_.behaviour.act(class_.crowd, 0.0)
    assert class_.crowd.speed_factor[0] == pytest.approx(factor)


@pytest.mark.parametrize(("left", "factor"), [(20.0, 0.0), (8.0, 0.0), (6.0, 0.5), (4.0, 1.0), (1.0, 1.0)])
def test_in_front_of_the_exit_a_teacher_leads_its_class_out(left, factor):
    class_ = Corridor(("teacher", [LENGTH - left], [1.0], {}), ("class", [10.0], [1.0], FOLLOWS), lag=8.0)
    class_.behaviour.act(class_.crowd, 0.0)
    assert class_.crowd.speed_factor[0] == pytest.approx(factor)


def test_members_set_off_no_earlier_than_their_teacher():
    class_ = Corridor(
        ("teacher", [10.0], [1.0], {}), ("class", [5.0, 6.0], [1.0] * 2, FOLLOWS), start_time=[4.0, 1.0, 7.0]
    )
    class_.tick()
    assert class_.crowd.start_time.tolist() == [4.0, 4.0, 7.0]


def test_members_take_their_teachers_route_where_there_is_one():
    class_ = Corridor(("teacher", [50.0], [1.0], {}), ("class", [45.0], [1.0], FOLLOWS), ("others", [1.0], [1.0], {}))
    class_.crowd.route[0] = 1
    class_.tick()
    assert class_.crowd.route.tolist() == [1, 1, 0]
    class_.crowd.route[0] = 2
    class_.tick()
    assert class_.crowd.route[1] == 1


def test_members_ahead_make_way_for_a_hindered_teacher():
    """After 5 s: as far as `trail` ahead, where they stand and let it pass."""
    class_ = Corridor(("teacher", [10.0], [1.0], {}), ("class", [9.9, 10.5], [1.2] * 2, FOLLOWS), stuck=5.0, trail=3.0)
    class_.blocked[0] = True
    class_.run(5.0)
    assert class_.x[2] == 10.5
    class_.run(9.0)
    assert class_.x[1] < 10.0
    assert 13.0 <= class_.x[2] <= 13.0 + 1.2 * TICK
    class_.blocked[:] = [False, True, False]
    class_.run(1.0)  # the teacher has made progress
    stood = class_.x[2]
    class_.run(2.0)
    assert class_.x[2] == stood
    class_.run(2.0)
    assert class_.x[0] > class_.x[2] > stood  # it follows again


def test_a_blocked_teacher_releases_its_class():
    class_ = Corridor(
        ("teacher", [10.0], [1.0], {}),
        ("class", np.linspace(2, 11, 8), [1.2] * 8, FOLLOWS),
        stuck=10.0,
        patience=10.0,
        trail=3.0,
    )
    class_.blocked[0] = True
    class_.run(20.0)
    assert class_.x[1:].max() <= 13.0 + 1.2 * TICK
    class_.run(100.0)
    assert np.isfinite(class_.out[1:]).all()


def test_a_teacher_that_waits_in_vain_goes_on():
    class_ = Corridor(("teacher", [10.0], [1.0], {}), ("class", [9.0, 1.0], [1.0] * 2, FOLLOWS), patience=10.0)
    class_.blocked[2] = True
    class_.run(9.0)
    assert class_.x[0] == 10.0
    class_.run(100.0)
    assert np.isfinite(class_.out[:2]).all()


def waiting(straggler=10.0, **parameters):
    """Return a teacher at x = 50 whose class is one pupil who does not come nearer; it stands for a gap of 4 s."""
    given = {"lag": 4.0, "patience": 10.0, **parameters}
    class_ = Corridor(("teacher", [50.0], [1.0], {}), ("class", [straggler], [1.0], FOLLOWS), **given)
    class_.blocked[1] = True
    return class_


def test_a_teacher_waits_again_once_its_class_has_caught_up():
    class_ = waiting()
    class_.run(11.0)
    assert class_.crowd.speed_factor[0] == 1.0  # it waits no more
    class_.x[1] = class_.crowd.position[1, 0] = class_.x[0]
    class_.tick()
    class_.x[1] = class_.crowd.position[1, 0] = 10.0
    class_.tick()
    assert class_.crowd.speed_factor[0] == 0.0


def test_two_classes_in_each_others_way_get_out():
    """Single file: the pupils of each class stand before the other's teacher, and nobody can pass."""
    order = ("class_b", 12.0), ("class_a", 11.0), ("teacher_b", 10.0), ("teacher_a", 9.0)
    follows = {"class_a": {"teacher": "teacher_a"}, "class_b": {"teacher": "teacher_b"}}
    queue = Corridor(*((name, [x], [1.5], follows.get(name, {})) for name, x in order))
    for _ in range(round(200 / TICK)):
        before = queue.x.copy()
        queue.tick()
        for i in range(1, 4):
            if queue.crowd.level[i - 1] >= 0:
                queue.x[i] = max(before[i], min(queue.x[i], queue.x[i - 1] - 0.5))
        queue.crowd.position[:, 0] = queue.x
    assert np.isfinite(queue.out).all()


def walking_class(plan, others, force):
    """Return the case of a class that walks behind its teacher, and of people who come towards it."""
    person = {"speed": {"normal": [1.34, 0.26], "minimum": 0.7}, "speed_up": {"factor": 0.5}, "radius": 0.2}
    people = [
        {"name": "teacher", "number": 1, "area": "teacher", "exits": ["far"], **person, "speed": 1.2},
        {"name": "class", "number": 20, "area": "class", "exits": ["far"], **person},
    ]
    people[1]["behaviours"] = {"teacher_following": {"teacher": "teacher"}}
    if others:
        people.append({"name": "others", "number": 20, "area": "others", "exits": ["near"], **person})
    content = {"building": plan, "people": people, "behaviours": {"teacher_following": {}, "walking": {}}}
    return Simulation(evac.load(content | {"forces": force, "contact": {"model": "nsm2"}}))


def on_stairs(force):
    plan = evac.Plan()
    plan.storey("below", box(0, 0, 10, 6))
    plan.storey("above", box(16, 0, 26, 6), z=3.0)
    plan.stair("stair", "below", [(10, 2), (10, 4)], "above", [(16, 2), (16, 4)])
    plan.exit("near", "below", [(0, 1), (0, 3)])
    plan.exit("far", "above", [(26, 1), (26, 3)])
    plan.area("teacher", "below", box(8.6, 2.5, 9.4, 3.5))
    plan.area("class", "below", box(2, 0.3, 8.4, 5.7))
    return walking_class(plan, False, force)


def in_two_way_traffic(force):
    plan = evac.Plan()
    plan.storey("floor", box(0, 0, 40, 4))
    plan.exit("near", "floor", [(0, 0), (0, 4)])
    plan.exit("far", "floor", [(40, 0), (40, 4)])
    plan.area("teacher", "floor", box(9, 1.5, 10, 2.5))
    plan.area("class", "floor", box(2, 0.3, 8.5, 3.7))
    plan.area("others", "floor", box(16, 0.3, 36, 3.7))
    return walking_class(plan, True, force)


@pytest.mark.parametrize("force", [{}, {"social": {}}])
@pytest.mark.parametrize("scene", [on_stairs, in_two_way_traffic])
def test_with_walking_a_class_stays_behind_its_teacher_and_together(scene, force):
    simulation = scene(force)
    crowd, distances = simulation.population.crowd, []
    rows = {group.name: group.rows for group in simulation.population.groups_for("teacher_following")}
    teacher, members = rows["teacher"][0], rows["class"]
    while not simulation.ended:
        simulation.advance_tick()
        if crowd.level[teacher] >= 0:
            here = members[crowd.level[members] == crowd.level[teacher]]
            distances += list(np.hypot(*(crowd.position[here] - crowd.position[teacher]).T))
    assert simulation.ended == "everybody out"
    assert crowd.exit_time[teacher] < crowd.exit_time[members].min()
    assert np.median(distances) < 6.0
    assert crowd.exit_time[members].max() - crowd.exit_time[teacher] < 15.0
