"""Teacher following: a class keeps behind its teacher, and the teacher waits for its class."""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from evac.behaviour import Behaviour, BehaviourScene
from evac.building.model import FLAT
from evac.directions.fields import PackedFields
from evac.directions.sampling import sample_travel_time
from evac.errors import ScenarioError
from evac.hookspecs import hookimpl
from evac.jit import Bytes, Floats, Ints, Struct, inner, kernel
from evac.jit.layout import FloatGrid
from evac.parameters import Parameter, did_you_mean
from evac.physics.state import Crowd

#: Somebody has made progress once its remaining travel time is less by this much than the least so far [s].
PROGRESS = 0.5

#: Who is slower than this counts as that fast: who cannot walk at all closes no gap [m/s].
SLOWEST = 1e-9

# Columns of the memory of a class.
LAST_TRAVEL_TIME, WAITED, TEACHER_TRAVEL_TIME, HINDERED, WAITS_NO_MORE, ROUTE = range(6)


class Classes(Struct):
    """Teachers, members and what is remembered of them; members of class g stand at first[g] to first[g + 1]."""

    teacher: Ints  # (classes,) row in Crowd
    first: Ints  # (classes + 1,)
    member: Ints  # (members,) row in Crowd
    memory: FloatGrid  # (classes, 6)
    goes_alone: Bytes  # (members,) 1: released
    behind: Floats  # (members,) travel times of those behind a teacher, from the first in line [s]
    speed: Floats  # (members,) and their speeds [m/s]


class Rules(Struct):
    """The parameters of `TeacherFollowing` and the tick [s]."""

    tick: float
    trail: float
    lag: float
    patience: float
    stuck: float


class TeacherFollowing(Behaviour):
    """Keeps the members of a group behind the teacher whom the key ``teacher`` of the group names (a group of one).

    The order of people is determined by the remaining travel time T of the directions, also across doors, stairs and
    storeys. With the lead L = T_teacher - T_member:

    - a member takes its teacher's route, and starts no earlier than its teacher: at the later of the
      two start times;
    - a member walks at full speed while it is more than `trail` behind (L < -trail); from there its speed decreases
      to zero at L = 0: its factor is -L / trail, limited to [0, 1];
    - the teacher and the members behind it form a line. D is the longest time that one of them needs, at its own
      speed, to reach the present position of its neighbour ahead; it is at most the time that the teacher needs to
      the exit. The teacher walks at full speed up to D = lag / 2; from there its speed decreases to zero at D = lag:
      its factor is 2 (1 - D / lag), limited to [0, 1];
    - a teacher that has waited for `patience` while its last member made no progress continues until the
      gaps are closed (D <= lag / 2);
    - if a teacher has wanted to walk for more than `stuck` without progress, members ahead of it give way: each
      continues alone until it is `trail` ahead, or behind again. After another `patience` without progress, and
      once the teacher has left the building, all members continue alone.

    A teacher waits for gaps in the line and not for the length of its class: a class in a queue is long, and a
    teacher that walks slowly ahead of it is overtaken and pushed aside. Because D is limited by its own time to the
    exit, it does not stop in front of the exit. The last rule prevents a permanent blockage by classes that wait for
    each other on a stair, or by members who are in the way of their teacher.

    Raises
    ------
    ScenarioError
        The teacher of a group does not exist, is the group itself, or is not a single person.
    """

    name = "teacher_following"
    reads = ("position", "level", "speed", "route", "start_time")
    writes = ("route", "speed_factor", "start_time")
    group_keys = ("teacher",)

    trail = Parameter(3.0, "distance in time behind the teacher below which members slow down", unit="s", above=0.0)
    lag = Parameter(4.0, "gap in the line of its class at which a teacher stops", unit="s", above=0.0)
    patience = Parameter(10.0, "longest time that a teacher waits without effect", unit="s", minimum=0.0, infinite=True)
    stuck = Parameter(10.0, "time without progress of a teacher until members ahead give way", unit="s", minimum=0.0)

    def prepare(self, scene: BehaviourScene) -> None:
        """List the classes and their teachers."""
        followers = [group for group in scene.groups if "teacher" in group.settings]
        sizes = [len(group.rows) for group in followers]
        self._classes = Classes(
            teacher=np.array([_teacher_of(group, scene.groups) for group in followers], dtype=np.int32),
            first=np.concatenate([[0], np.cumsum(sizes)]).astype(np.int32),
            member=np.concatenate([np.zeros(0, np.int32), *(group.rows for group in followers)]).astype(np.int32),
            memory=np.tile([np.inf, 0.0, np.inf, 0.0, 0.0, -1.0], (len(followers), 1)),
            goes_alone=np.zeros(sum(sizes), dtype=np.uint8),
            behind=np.zeros(sum(sizes)),
            speed=np.zeros(sum(sizes)),
        )
        self._rules = Rules(tick=scene.tick, trail=self.trail, lag=self.lag, patience=self.patience, stuck=self.stuck)
        self._scene = scene

    def act(self, crowd: Crowd, time: float) -> None:
        """Set everybody's speed factor, and the members' routes and start times."""
        follow(crowd, self._scene.fields.packed, self._classes, self._rules, time)

    def is_needed(self, scene: BehaviourScene) -> bool:
        """Return False if no group has a teacher."""
        return any("teacher" in group.settings for group in scene.groups)

    def state(self) -> dict[str, NDArray[Any]]:
        """Return the memory of the classes and who goes alone."""
        return {"memory": self._classes.memory.copy(), "goes_alone": self._classes.goes_alone.copy()}

    def restore(self, state: dict[str, NDArray[Any]]) -> None:
        """Restore what `state` returned."""
        self._classes.memory[:] = state["memory"]
        self._classes.goes_alone[:] = state["goes_alone"]


def _teacher_of(group: Any, groups: tuple[Any, ...]) -> int:
    """Return the row of the person whom `group` follows."""
    key = f"people.{group.name}.behaviours.teacher_following.teacher"
    wanted = group.settings["teacher"]
    names = {other.name: other for other in groups if other.name != group.name}
    if wanted not in names:
        raise ScenarioError(f"{key}: no other group is named {wanted!r}; {did_you_mean(str(wanted), list(names))}")
    rows = names[wanted].rows
    if len(rows) != 1:
        raise ScenarioError(f"{key}: a teacher is one person, but group {wanted!r} has {len(rows)}; set its number = 1")
    return int(rows[0])


@kernel
def follow(crowd: Crowd, fields: PackedFields, classes: Classes, rules: Rules, time: float) -> None:
    """Apply the rules of `TeacherFollowing` to every class whose teacher is inside."""
    memory = classes.memory
    for g in range(len(classes.teacher)):
        t = classes.teacher[g]
        if crowd.level[t] < 0:
            continue
        if memory[g, ROUTE] != crowd.route[t]:  # travel times of two routes cannot be compared
            memory[g, ROUTE] = crowd.route[t]
            memory[g, LAST_TRAVEL_TIME] = math.inf
            memory[g, TEACHER_TRAVEL_TIME] = math.inf
        x, y = crowd.position[t, 0], crowd.position[t, 1]
        own = sample_travel_time(fields, x, y, crowd.level[t], crowd.route[t])
        behind = pace_members(crowd, fields, classes, rules, time, g, own)
        if time >= crowd.start_time[t] and math.isfinite(own):
            last = classes.behind[behind - 1] if behind > 0 else own
            delay = min(widest_gap(own, classes, behind), own / max(crowd.speed[t, FLAT], SLOWEST))
            pace = lead_on(memory, g, last, delay / rules.lag, rules.patience, rules.tick)
            crowd.speed_factor[t] *= pace
            count_vain(memory, g, TEACHER_TRAVEL_TIME, HINDERED, own, pace * rules.tick)


@inner
def pace_members(crowd, fields, classes, rules, time, g, own):  # type: ignore[no-untyped-def]
    """Apply the members' rules to class g, whose teacher has the travel time `own` left.

    List those behind the teacher in ``classes.behind`` and ``classes.speed``; return how many they are.
    """
    t = classes.teacher[g]
    hindered = classes.memory[g, HINDERED]
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
        remaining = sample_travel_time(fields, x, y, crowd.level[m], crowd.route[m])
        lead = own - remaining
        if not math.isfinite(lead):
            continue
        if lead <= 0.0:
            enter_line(classes, count, remaining, crowd.speed[m, FLAT])
            count += 1
        if hindered > rules.stuck + rules.patience:
            classes.goes_alone[k] = 1
        elif not 0.0 < lead < rules.trail:
            classes.goes_alone[k] = 0
        elif hindered > rules.stuck:
            classes.goes_alone[k] = 1
        if not classes.goes_alone[k]:
            crowd.speed_factor[m] *= min(max(-lead / rules.trail, 0.0), 1.0)
    return count


@inner
def enter_line(classes, count, remaining, speed):  # type: ignore[no-untyped-def]
    """Enter somebody in the line of `count` people behind a teacher, which is sorted by travel time."""
    place = count
    while place > 0 and classes.behind[place - 1] > remaining:
        classes.behind[place] = classes.behind[place - 1]
        classes.speed[place] = classes.speed[place - 1]
        place -= 1
    classes.behind[place] = remaining
    classes.speed[place] = speed


@inner
def widest_gap(own, classes, count):  # type: ignore[no-untyped-def]
    """Return the longest time [s] that somebody in a teacher's line takes to where its neighbour ahead is now."""
    widest, ahead = 0.0, own
    for k in range(count):
        widest = max(widest, (classes.behind[k] - ahead) / max(classes.speed[k], SLOWEST))
        ahead = classes.behind[k]
    return widest


@inner
def lead_on(memory, g, last, share, patience, tick):  # type: ignore[no-untyped-def]
    """Return a teacher's speed factor at a `share` of the gap at which it stands, and remember how long it waits."""
    pace = min(max(2.0 * (1.0 - share), 0.0), 1.0)
    if pace == 1.0:
        memory[g, WAITS_NO_MORE] = 0.0
    count_vain(memory, g, LAST_TRAVEL_TIME, WAITED, last, (1.0 - pace) * tick)
    if memory[g, WAITED] > patience:
        memory[g, WAITS_NO_MORE] = 1.0
    if memory[g, WAITS_NO_MORE] == 1.0:
        return 1.0
    return pace


@inner
def count_vain(memory, g, seen, vain, remaining, spent):  # type: ignore[no-untyped-def]
    """Add the time `spent` [s] to column `vain`, or start anew once less travel time is left than column `seen` has."""
    if remaining < memory[g, seen] - PROGRESS:
        memory[g, seen] = remaining
        memory[g, vain] = 0.0
    else:
        memory[g, vain] += spent


evac_interface = 2


@hookimpl
def evac_behaviours() -> Sequence[type[Behaviour]]:
    """Return the behaviour of this module."""
    return [TeacherFollowing]
