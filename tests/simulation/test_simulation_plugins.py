"""Plugins in the loop: what they may write, draw and add, and what is told where they fail."""

import textwrap

import numpy as np
import pytest

from evac.base.errors import PluginError
from evac.case.loading import load_case
from evac.simulation.simulation import Simulation
from tests.runs import SQUEEZED, in_the_room, model_of, run_ticks


@pytest.mark.parametrize("model", ["dem", "nsm2"])
def test_a_behaviour_that_reads_contact_forces_does_not_depend_on_the_output(model, tmp_path):
    changes = {"behaviours.squeezed": {}, "simulation.seed": 2, **model_of(model)}
    ends = [Simulation(in_the_room(tmp_path, SQUEEZED, **changes, **{"output.every": every})) for every in (0.1, 2.0)]
    ends = [simulation.run() for simulation in ends]
    free = Simulation(load_case("square_room", {"simulation.seed": 2, **model_of(model)})).run()
    assert ends[0].last_out == ends[1].last_out != free.last_out


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("scene.crowd.route[:] = 99999", "'squeezed': .*route 99999 for person 0"),
        ("scene.crowd.start_time[2] = float('nan')", "nan to start_time of person 2"),
        ("scene.crowd.speed_factor[1] = -1.0", "-1.0 to speed_factor of person 1"),
    ],
)
def test_what_prepare_writes_is_checked(tmp_path, line, words):
    text = SQUEEZED.replace("def act(self, crowd, time)", "def prepare(self, scene)")
    text = text.replace("crowd.speed_factor[crowd.contact_force > 300.0] *= 0.5", line)
    text = text.replace('("speed_factor",)', '("speed_factor", "start_time", "route")')
    with pytest.raises(PluginError, match=words):
        Simulation(in_the_room(tmp_path, text, **{"behaviours.squeezed": {}}))


def test_what_a_behaviour_writes_for_people_outside_is_checked(tmp_path):
    text = SQUEEZED.replace("def act(self, crowd, time)", "keeps_distance = True\n\n        def prepare(self, scene)")
    text = text.replace(IN_PLACE, "scene.outside.speed_factor[3] = float('nan')")
    with pytest.raises(PluginError, match=r"'squeezed': .*nan .*outside\.speed_factor .*person 3 "):
        Simulation(in_the_room(tmp_path, text, **{"behaviours.squeezed": {}}))


IN_PLACE = "crowd.speed_factor[crowd.contact_force > 300.0] *= 0.5"


def test_a_contact_model_that_fails_is_named_before_the_first_step_too(tmp_path):
    text = """
        from evac import ContactModel, hookimpl
        evac_interface = 3

        class Failing(ContactModel):
            '''Fails at once.'''
            name = "failing"

            def own(self, people, world):
                raise ValueError("oops")

        @hookimpl
        def evac_contact_models():
            return [Failing]
        """
    case = in_the_room(tmp_path, text, **model_of("failing"))
    with pytest.raises(PluginError, match=r"^contact model 'failing': ValueError: oops \(.*odd\.py, line"):
        Simulation(case).run()


FORCES = """
    from evac import Force, hookimpl
    evac_interface = 3
    from evac.jit import pair_force

    @pair_force
    def tail(gap, nx, ny, vx, vy, ex, ey, p):
        f = 100.0 * 2.718281828 ** (-max(gap, 0.0) / 0.5)
        return f * nx, f * ny

    @pair_force
    def idle(gap, nx, ny, vx, vy, ex, ey, p):
        return (1e-12 * nx, 1e-12 * ny) if gap < 3.0 else (0.0, 0.0)

    class Tail(Force):
        '''Does not end at its cut-off.'''
        name = "tail"
        pair = tail
        def cutoff(self):
            return 0.1

    class Idle(Force):
        '''Next to nothing, far.'''
        name = "idle"
        pair = idle
        def cutoff(self):
            return 3.0

    @hookimpl
    def evac_forces():
        return [Tail, Idle]
"""


def test_each_force_ends_at_its_own_cutoff(tmp_path):
    changes = {"forces.tail": {}, "forces.idle": {}, "simulation.duration": 1.0}
    both = Simulation(in_the_room(tmp_path, FORCES, [[2.0, 2.2], [2.0, 2.8]], **changes)).run().crowd.position
    del changes["forces.idle"]
    alone = Simulation(in_the_room(tmp_path, FORCES, [[2.0, 2.2], [2.0, 2.8]], **changes)).run().crowd.position
    np.testing.assert_allclose(both, alone, rtol=0.0, atol=1e-9)


@pytest.mark.parametrize("method", ["is_needed", "cutoff", "packed"])
def test_a_force_that_fails_is_named(tmp_path, method):
    fails = f"        def {method}(self):\n            return 1 / 0\n\n    class Idle"
    with pytest.raises(PluginError, match=r"force 'tail'.*ZeroDivisionError: .*odd\.py, line"):
        Simulation(in_the_room(tmp_path, FORCES.replace("    class Idle", fails, 1), **{"forces.tail": {}}))


def test_a_plan_knows_what_a_behaviour_does_at_ticks():
    case = load_case("square_room", {"behaviours.walking": {}})
    (row,) = [row for row in Simulation(case).plan if row.part == "behaviour: walking"]
    assert row.why == "at every tick"


RANDOM = """
    from evac import Behaviour, hookimpl
    evac_interface = 3

    class One(Behaviour):
        '''Draws a factor for everybody at each tick.'''
        name = "one"
        writes = ("speed_factor",)

        def prepare(self, scene):
            self.generator = scene.generator
            self.first = scene.generator.random()

        def act(self, crowd, time):
            crowd.speed_factor[:] *= self.generator.uniform(0.5, 1.0)

    class Other(One):
        '''Another one.'''
        name = "other"

    @hookimpl
    def evac_behaviours():
        return [One, Other]
"""


def test_each_behaviour_and_each_seed_draws_of_its_own(tmp_path):
    case = in_the_room(tmp_path, RANDOM, **{"behaviours.one": {}, "behaviours.other": {}})
    runs = [Simulation(case.change({"simulation.seed": seed})) for seed in (1, 2)]
    drawn = [behaviour.first for run in runs for behaviour, _ in run.behaviours]
    assert len(set(drawn)) == 4


def test_what_a_behaviour_adds_to_a_direction_holds_for_one_tick(tmp_path):
    text = SQUEEZED.replace("speed_factor", "extra_direction")
    text = text.replace("crowd.extra_direction[crowd.contact_force > 300.0] *= 0.5", "crowd.extra_direction[:] += 0.1")
    simulation = run_ticks(Simulation(in_the_room(tmp_path, text, **{"behaviours.squeezed": {}})), 3)
    assert (simulation.population.crowd.extra_direction == 0.1).all()


def test_every_plugin_is_told_of_the_end(tmp_path):
    text = """
        from evac import hookimpl
        evac_interface = 3

        @hookimpl
        def evac_finish(simulation):
            simulation.told.append(__file__)
        """
    files = [tmp_path / "one.py", tmp_path / "other.py"]
    for file in files:
        file.write_text(textwrap.dedent(text), encoding="utf-8")
    simulation = Simulation(load_case("square_room", {"simulation.duration": 0.1}, plugin_files=files))
    simulation.told = []
    simulation.run()
    assert sorted(simulation.told) == sorted(map(str, files))
