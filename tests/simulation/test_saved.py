"""Whatever declares what it saves: a run that is resumed at any tick goes on to the bits of one that was not."""

from collections.abc import Iterator, Mapping

import numpy as np

import evac
from evac.base.saved import Saved
from evac.jit.kernels import Struct
from evac.simulation.lifts import Lifts
from evac.simulation.simulation import Simulation
from evac.trajectory.recorder import Recorder
from evac_plugins.behaviour_lift_use import LiftUse

#: Attributes that differ between two runs, or are computed again before they are used.
OTHERS = {
    *(
        "phases",
        "recording",
        "loop",
        "data",
        "registry",
        "contact",
        "plan",
        "_seconds",
        "world",
        "shared_scene",
        "fields",
    ),
    *(
        "_log",
        "_nodes",
        "_sights",
        "_seen",
        "_motion",
        "_wanted",
        "_ways",
        "waves",
        "queues",
        "_queues",
        "_classes",
        "_margins",
        "_walks",
        "_presence",
        "_moved",
        "_tick",
        "_share",
    ),
}


def everything():
    """Return a case with smoke, doses, doors, areas, places, arrivals, queues and behaviours that save something."""
    plan = {
        "storeys": [{"name": "f", "polygons": [[[0, 0], [30, 0], [30, 6], [0, 6]]]}],
        "exits": [
            {"name": "near", "storey": "f", "segment": [[0, 2], [0, 4]]},
            {"name": "far", "storey": "f", "segment": [[30, 2], [30, 4]]},
        ],
        "areas": [
            {"name": "start", "storey": "f", "polygon": [[7, 1], [11, 1], [11, 5], [7, 5]]},
            {"name": "west", "storey": "f", "polygon": [[0, 0], [6, 0], [6, 6], [0, 6]]},
            {"name": "yard", "storey": "f", "polygon": [[13, 1], [17, 1], [17, 5], [13, 5]]},
        ],
    }
    air = {"extinction": [0.0, 2.0, 4.0], "co": [0.0, 20000.0, 20000.0], "co2": 0.0, "o2": 20.9}
    inside = {"area": "start", "number": 5}
    return evac.load(
        {
            "building": {"plan": plan, "controls": {"near": {"every": 0.5, "delay": 0.4, "hold": 0.4}}},
            "contact": {"model": "nsm1"},
            "behaviours": {
                **{
                    "walking": {},
                    "response_time": {"time": {"uniform": [0.0, 2.0]}},
                    "together": {},
                    "helpers": {"areas": ["west"]},
                },
                **{"route_choice": {"exits": ["near", "far"], "every": 0.7}},
                **{"rest": {}, "riding": {}, "familiarity": {"main": ["near"]}, "teacher_following": {}},
            },
            "directions": {"spacing": 0.2, "quickest": {"period": 0.5}},
            "people": [
                {"name": "a", **inside, "strategy": "quickest", "behaviours": {"rest": {"after": 1.0, "pause": 2.0}}},
                {"name": "b", **inside, "behaviours": {"together": {"size": 2}}},
                {"name": "c", **inside, "assembly": ["at yard"]},
                {"name": "d", "arrive": {"rate": 2.0, "from": 0.5, "to": 5.0, "exit": "near"}},
                {"name": "e", "area": "west", "number": 2, "behaviours": {"helpers": {"device": "carry"}}},
                {"name": "g", "area": "start", "number": 2, "behaviours": {"teacher_following": {"teacher": "t"}}},
                {"name": "t", "area": "start", "number": 1},
                {"name": "f", "area": "west", "number": 2, "behaviours": {"helpers": {"fetches": "e"}}},
            ],
            "place": [{"name": "at yard", "kind": "assembly", "area": "yard"}],
            "conditions": [
                {"source": "prescribed", "area": "west", "times": [0, 2, 4], "values": air, "hold": True},
            ],
            "smoke": {"period": 0.6},
            "safety": {"visibility": 5.0, "fed": 0.3},
            "dose": {"heat": "none", "threshold": 0.05},
            "event": [
                {"kind": "bar", "target": "west", "time": 1.5},
                {"kind": "close", "target": "far", "time": 2.2, "name": "closing"},
                {"kind": "open", "target": "far", "when": {"event": "closing", "after": 1.0}},
                {"kind": "strategy", "target": "c", "value": [], "when": {"count": 4, "area": "yard"}},
                {"kind": "bar", "target": "west", "value": False, "time": 3.1},
            ],
            "simulation": {"duration": 8.0},
        }
    )


def values_of(part: object, name: str, seen: dict[int, object]) -> Iterator[tuple[str, object]]:
    """Yield the numbers and arrays of everything that a part of a run owns, with their places."""
    if isinstance(part, np.ndarray | bool | int | float):
        yield name, part
    elif id(part) not in seen:
        seen[id(part)] = part
        items: Mapping = {}
        if isinstance(part, Saved):
            items = vars(part)
        elif isinstance(part, Struct | Mapping):
            items = dict(part.items() if isinstance(part, Mapping) else part.values())
        elif isinstance(part, list | tuple):
            items = dict(enumerate(part))
        for key, value in items.items():
            if key not in OTHERS:
                yield from values_of(value, f"{name}.{key}", seen)


def assert_same(one, two, what):
    """Compare all that two runs own, and all that they save; return the classes of their parts."""
    seen: dict[int, object] = {}
    owned = dict(values_of(one, "", seen)) | one.state()
    others = dict(values_of(two, "", {})) | two.state()
    assert owned.keys() == others.keys()
    for name, value in owned.items():
        rows = one.population.crowd.level >= 0 if name.endswith("heading") else ...  # of people who are still seen
        if not name.endswith("seconds"):
            np.testing.assert_array_equal(
                np.asarray(others[name])[rows], np.asarray(value)[rows], err_msg=f"{name} {what}"
            )
        if isinstance(value, np.ndarray):
            assert others[name].flags.writeable == value.flags.writeable, f"{name} {what}"
    return {type(part) for part in seen.values()}


def declaring(base):
    """Return the classes of evac that declare what they save, without plugins that other tests have loaded."""
    own = {base} if base.saved and base.__module__.startswith(("evac.", "evac_plugins.")) else set()
    return own.union(*map(declaring, base.__subclasses__()))


def test_every_part_goes_on_from_any_tick_to_the_same_bits():
    """All that parts own is compared, so that nothing that a checkpoint forgets is made good by accident."""
    case = everything()
    whole = resumed = Simulation(case)
    met, seen = set(), set()
    for tick in range(60):
        whole.advance_tick()
        crowd = whole.population.crowd
        states = {
            "let through": crowd.passing >= 0,
            "outside": whole.outside.arrays.level >= 0,
            "to come": np.isnan(crowd.arrival_time),
            "at a place": whole.places.arrived,
            "stopped": whole.exposure.stopped,
        }
        seen |= {name for name, people in states.items() if people.any()}
        if tick % 6:
            resumed.advance_tick()
            assert_same(whole, resumed, f"after tick {tick}, resumed after {tick - tick % 6}")
        else:
            resumed = Simulation(case, shared_scene=whole.scene.shared_scene)
            resumed.restore(whole.state())
            met |= assert_same(whole, resumed, f"when resumed after tick {tick}")
    assert [change.kind for change in whole.scene.changes] == ["bar", "close", "bar", "open", "strategy"]
    assert seen == {*states}
    assert whole.scene.smoky is not None
    assert any("column" in key for key in whole.state())
    # Recorders are saved with their files; riders of lifts are resumed in test_lifts.py.
    assert declaring(Saved) - declaring(Recorder) - {LiftUse, Lifts} <= met
