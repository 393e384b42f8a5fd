"""Teacher following: classes walk behind their teachers, and teachers wait for their classes."""

import math
from typing import Any

import numpy as np

from evac.base.errors import ScenarioError
from evac.base.parameters import Parameter, did_you_mean
from evac.building.model.building import FLAT
from evac.directions.fields import PackedFields
from evac.directions.sampling import column_of, sample_travel_time
from evac.jit import Bytes, Floats, Ints, Struct, inner, kernel
from evac.jit.kernels import FloatGrid
from evac.people.behaviour import Behaviour, BehaviourScene
from evac.physics.state import Crowd

PROGRESS = 0.5  #: Decrease of the remaining travel time below its minimum so far that counts as progress [s].

#: Lower limit of speeds in the computation of gaps, since people who cannot walk never close a gap [m/s].
SLOWEST = 1e-9

# Columns of the memory of a class.
LAST_TRAVEL_TIME, WAITED, TEACHER_TRAVEL_TIME, HINDERED, WAITS_NO_MORE, ROUTE = range(6)


class Classes(Struct):
    """Teachers, members and their memory; the members of class g are at first[g] to first[g + 1]."""

    teacher: Ints  # (classes,) row in Crowd
    first: Ints  # (classes + 1,)
    member: Ints  # (members,) row in Crowd
    memory: FloatGrid  # (classes, 6)
    goes_alone: Bytes  # (members,) 1: does not follow the teacher
    ends_inside: Bytes  # (routes,) 1: leads to an area, not to an exit
    behind: Floats  # (members,) travel times of the members behind a teacher, ascending [s]
    speed: Floats  # (members,) and their speeds [m/s]


class Rules(Struct):
    """The parameters of `TeacherFollowing` and the tick [s]."""

    tick: float
    trail: float
    lag: float
    patience: float
    stuck: float


class TeacherFollowing(Behaviour):
    """Groups follow their teacher, the group of one person that their key ``teacher`` names.

    Positions are compared by the remaining travel time T. With the lead L = T_teacher - T_member of a member:

    - Members take the route of their teacher, and start at the later of both start times.
    - A member more than `trail` behind (L < -trail) walks at full speed. From there, its speed decreases to zero at
      L = 0: the speed factor is -L / trail, limited to [0, 1].
    - The teacher and the members behind form a line. The gap D is the longest time that a member needs to reach the
      next person ahead in the line, at most the travel time of the teacher to the exit, so that teachers do not stop
      in front of it. The teacher walks at full speed up to D = lag / 2. From there, the speed decreases to zero at
      D = lag: the speed factor is 2 (1 - D / lag), limited to [0, 1].
    - On the way to an area, such as one at which the class gathers, members walk at full speed as soon as the teacher
      is within `trail` of its middle.
    - A teacher who has waited for `patience` without progress of the last member continues until the gaps are closed
      (D <= lag / 2).
    - If a teacher has wanted to walk for more than `stuck` without progress, the members ahead give way: each walks
      independently until `trail` ahead, or behind again. After another `patience` without progress, and after the
      teacher has left, all members walk independently. This prevents permanent blocking by classes that wait for each
      other on a stair, or by members in the way of their teacher.

    Teachers wait for gaps in the line and not for the length of the class, because a class is long in a queue, where a
    teacher who walked slowly ahead of it would be overtaken and pushed aside.
    """

    name = "teacher_following"
    reads = ("position", "level", "contact_radius", "speed", "route", "start_time")
    writes = ("route", "speed_factor", "start_time")
    group_keys = ("teacher",)
    saved = ("memory", "goes_alone")

    trail = Parameter(3.0, "time behind the teacher below which members slow down", unit="s", above=0.0)
    lag = Parameter(4.0, "gap in the line of the class at which the teacher stops", unit="s", above=0.0)
    patience = Parameter(10.0, "time for which a teacher waits without progress", unit="s", minimum=0.0, infinite=True)
    stuck = Parameter(10.0, "time without progress after which members give way", unit="s", minimum=0.0)

    def prepare(self, scene: BehaviourScene) -> None:
        """Find the classes and their teachers."""
        followers = [group for group in scene.groups if "teacher" in group.settings]
        sizes = [len(group.rows) for group in followers]
        self.memory = np.tile([np.inf, 0.0, np.inf, 0.0, 0.0, -1.0], (len(followers), 1))
        self.goes_alone = np.zeros(sum(sizes), dtype=np.uint8)
        self._classes = Classes(
            teacher=np.array([_teacher_of(group, scene.groups) for group in followers], dtype=np.int32),
            first=np.concatenate([[0], np.cumsum(sizes)]).astype(np.int32),
            member=np.concatenate([np.zeros(0, np.int32), *(group.rows for group in followers)]).astype(np.int32),
            memory=self.memory,
            goes_alone=self.goes_alone,
            ends_inside=np.array([bool(route.area) for route in scene.fields.routes], dtype=np.uint8),
            behind=np.zeros(sum(sizes)),
            speed=np.zeros(sum(sizes)),
        )
        self._rules = Rules(tick=scene.tick, trail=self.trail, lag=self.lag, patience=self.patience, stuck=self.stuck)
        self._scene = scene

    def act(self, crowd: Crowd, time: float) -> None:
        """Set the speed factors of teachers and members, and the routes and start times of members."""
        follow(crowd, self._scene.fields.packed, self._classes, self._rules, time)

    def is_needed(self, scene: BehaviourScene) -> bool:
        """Return False if no group has a teacher."""
        return any("teacher" in group.settings for group in scene.groups)


def _teacher_of(group: Any, groups: tuple[Any, ...]) -> int:
    """Return the row of the teacher of a group."""
    key = f"people.{group.name}.behaviours.teacher_following.teacher"
    wanted = group.settings["teacher"]
    names = {other.name: other for other in groups if other.name != group.name}
    if wanted not in names:
        raise ScenarioError(f"{key}: no other group is named {wanted!r}; {did_you_mean(str(wanted), list(names))}")
    rows = names[wanted].rows
    if len(rows) != 1:
        raise ScenarioError(f"{key}: a teacher must be one person, but {wanted!r} has {len(rows)}; set its number = 1")
    return int(rows[0])


@kernel
def follow(crowd: Crowd, fields: PackedFields, classes: Classes, rules: Rules, time: float) -> None:
    """Apply the rules of `TeacherFollowing` to every class whose teacher is inside."""
    memory = classes.memory
    for g in range(len(classes.teacher)):
        t = classes.teacher[g]
        if crowd.level[t] < 0:
            continue
        if memory[g, ROUTE] != crowd.route[t]:  # travel times of different routes are not comparable
            memory[g, ROUTE] = crowd.route[t]
            memory[g, LAST_TRAVEL_TIME] = math.inf
            memory[g, TEACHER_TRAVEL_TIME] = math.inf
        x, y = crowd.position[t, 0], crowd.position[t, 1]
        own = sample_travel_time(
            fields, x, y, crowd.level[t], column_of(fields, crowd.route[t], crowd.contact_radius[t])
        )
        behind = pace_members(crowd, fields, classes, rules, time, g, own)
        if time >= crowd.start_time[t] and math.isfinite(own):
            last = classes.behind[behind - 1] if behind > 0 else own
            delay = min(widest_gap(own, classes, behind), own / max(crowd.speed[t, FLAT], SLOWEST))
            pace = teacher_factor(memory, g, last, delay / rules.lag, rules.patience, rules.tick)
            crowd.speed_factor[t] *= pace
            add_waiting_time(memory, g, TEACHER_TRAVEL_TIME, HINDERED, own, pace * rules.tick)


@inner
def pace_members(crowd, fields, classes, rules, time, g, own):
    """Apply the rules for members to class g, whose teacher has the remaining travel time `own`.

    Writes the members behind the teacher to ``classes.behind`` and ``classes.speed``; returns their number.
    """
    t = classes.teacher[g]
    hindered = classes.memory[g, HINDERED]
    has_arrived = classes.ends_inside[crowd.route[t]] and own < rules.trail
    count = 0
    for k in range(classes.first[g], classes.first[g + 1]):
        m = classes.member[k]
        if crowd.level[m] < 0:
            continue
        if fields.field_of[crowd.level[m], crowd.route[t]] >= 0:
            crowd.route[m] = crowd.route[t]
        if time <= crowd.start_time[m] < crowd.start_time[t]:
            crowd.start_time[m] = crowd.start_time[t]
        x, y = crowd.position[m, 0], crowd.position[m, 1]
        column = column_of(fields, crowd.route[m], crowd.contact_radius[m])
        remaining = sample_travel_time(fields, x, y, crowd.level[m], column)
        lead = own - remaining
        if not math.isfinite(lead):
            continue
        if lead <= 0.0:
            insert_in_line(classes, count, remaining, crowd.speed[m, FLAT])
            count += 1
        if hindered > rules.stuck + rules.patience:
            classes.goes_alone[k] = 1
        elif not 0.0 < lead < rules.trail:
            classes.goes_alone[k] = 0
        elif hindered > rules.stuck:
            classes.goes_alone[k] = 1
        if not classes.goes_alone[k] and not has_arrived:
            crowd.speed_factor[m] *= min(max(-lead / rules.trail, 0.0), 1.0)
    return count


@inner
def insert_in_line(classes, count, remaining, speed):
    """Insert a member into the line of `count` people behind a teacher, which is sorted by travel time."""
    place = count
    while place > 0 and classes.behind[place - 1] > remaining:
        classes.behind[place] = classes.behind[place - 1]
        classes.speed[place] = classes.speed[place - 1]
        place -= 1
    classes.behind[place] = remaining
    classes.speed[place] = speed


@inner
def widest_gap(own, classes, count):
    """Return the longest time [s] that a person in the line needs to the present position of the next one ahead."""
    widest, ahead = 0.0, own
    for k in range(count):
        widest = max(widest, (classes.behind[k] - ahead) / max(classes.speed[k], SLOWEST))
        ahead = classes.behind[k]
    return widest


@inner
def teacher_factor(memory, g, last, share, patience, tick):
    """Return the speed factor of a teacher at a gap of `share` times `lag`, and update its waiting time."""
    pace = min(max(2.0 * (1.0 - share), 0.0), 1.0)
    if pace == 1.0:
        memory[g, WAITS_NO_MORE] = 0.0
    add_waiting_time(memory, g, LAST_TRAVEL_TIME, WAITED, last, (1.0 - pace) * tick)
    if memory[g, WAITED] > patience:
        memory[g, WAITS_NO_MORE] = 1.0
    if memory[g, WAITS_NO_MORE] == 1.0:
        return 1.0
    return pace


@inner
def add_waiting_time(memory, g, seen, vain, remaining, spent):
    """Add the time `spent` [s] to column `vain`, or reset it if the travel time has decreased below column `seen`."""
    if remaining < memory[g, seen] - PROGRESS:
        memory[g, seen] = remaining
        memory[g, vain] = 0.0
    else:
        memory[g, vain] += spent
