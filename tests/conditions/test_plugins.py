"""The documented plugins run: a law of the speed in smoke, and a cloud that moves through a car park."""

import re
from pathlib import Path

import numpy as np
import pytest

import evac
from evac.conditions.law import share_in_smoke
from evac.conformance import check_plugin
from evac.contract.registry import Registry
from evac.simulation.simulation import Simulation

PAGE = (Path(__file__).parents[2] / "docs/plugins_movement.md").read_text(encoding="utf-8")


@pytest.fixture
def documented(tmp_path):
    """Write the documented code of a class to a plugin file."""

    def write(name):
        code = next(one for one in re.findall(r"```text\n(.*?)```", PAGE, re.DOTALL) if f"class {name}(" in one)
        path = tmp_path / f"{name.lower()}.py"
        path.write_text(code, encoding="utf-8")
        return path

    return write


def test_the_documented_law_has_ten_lines_and_conforms(documented):
    path = documented("Half")
    assert len([line for line in path.read_text().splitlines() if line.strip()]) <= 10
    check_plugin(Registry([path]).smoke_laws["half"])


def car_park(plugin, **keys):
    """Return a car park of 60 m by 16 m in which people stand, with a cloud that passes along x."""
    plan = {
        "storeys": [{"name": "park", "polygons": [[[0, 0], [60, 0], [60, 16], [0, 16]]]}],
        "exits": [{"name": "out", "storey": "park", "segment": [[60, 6], [60, 10]]}],
    }
    places = [[10.0, 4.0], [30.0, 8.0], [50.0, 12.0]]
    table = {
        "building": {"plan": plan},
        "contact": {"model": "nsm1"},
        "people": [{"name": "p", "level": "park", "positions": places, "leave": False, "radius": 0.2}],
        "conditions": [{"source": "cloud", "speed": 2.0}],
        "simulation": {"duration": 30.0},
        **keys,
    }
    return evac.load(table, plugin_files=[plugin])


def test_a_cloud_that_moves_through_a_car_park_is_read_by_each_person_when_it_passes(documented):
    path = documented("Cloud")
    simulation = Simulation(car_park(path, smoke={"routes": False, "sampling": 0.1}))
    exposure, met = simulation.exposure, np.full(3, np.nan)
    for _ in range(300):
        simulation.exposure.act(simulation.time, simulation.fields)
        now = 2.0 * np.exp(-((simulation.population.crowd.position[:, 0] - 2.0 * simulation.time) ** 2))
        np.testing.assert_allclose(exposure.share, np.maximum(0.1, 1.0 - 0.057 / 0.706 * now))
        met = np.where(np.isnan(met) & (now > 1.99), simulation.time, met)
        simulation.step += simulation.case.simulation.steps_per_tick
    np.testing.assert_allclose(met, [5.0, 15.0, 25.0], atol=0.11)
    np.testing.assert_allclose(exposure.extinction, 2.0, atol=0.02)


def test_a_source_that_fails_is_named_with_its_line(documented):
    path = documented("Cloud")
    path.write_text(path.read_text().replace("self.speed * time", "self.speeds * time"))
    with pytest.raises(evac.PluginError, match=r"source 'cloud'.*speeds.*cloud\.py, line"):
        Simulation(car_park(path)).run()


@pytest.mark.parametrize(
    ("returned", "words"),
    [
        ("position[:, 0]", r"source 'cloud': at: returns values of shape \(\d+,\), not \(1, \d+\)"),
        ("np.full((1, len(level)), np.inf)", "source 'cloud': at: gives inf for extinction"),
        ("np.full((1, len(level)), -0.5)", r"gives -0\.5 for extinction"),
    ],
)
def test_values_that_no_air_has_are_refused(documented, returned, words):
    path = documented("Cloud")
    text = path.read_text()
    path.write_text(text.replace(text[text.index("return 2.0") :].splitlines()[0], f"return {returned}"))
    with pytest.raises(evac.PluginError, match=words + r".*cloud\.py, line"):
        Simulation(car_park(path, smoke={"routes": False})).advance_tick()


@pytest.mark.parametrize(
    ("returned", "words"), [("desired * float('nan')", "finite"), ("desired[:1]", "for each person")]
)
def test_speeds_that_nobody_has_are_refused(documented, returned, words):
    law = documented("Half")
    text = law.read_text()
    law.write_text(text.replace(text[text.index("return ") :].splitlines()[0], f"return {returned}"))
    case = car_park(documented("Cloud"))
    case = evac.load(case.to_dict(), {"smoke.law": "half"}, plugin_files=[*case.plugin_files, law])
    with pytest.raises(evac.PluginError, match=rf"law 'half': speed.*half\.py.*{words}"):
        Simulation(case).advance_tick()


LAW = """
from evac import SmokeLaw

class Broken(SmokeLaw):
    '''A law with a mistake.'''

    name = "broken"

    def speed(self, desired, extinction):
        {body}

evac_interface = 3
"""

CLOUD = """
import numpy as np
from evac import ConditionSource

class Cloud(ConditionSource):
    '''A source with a mistake.'''

    name = "cloud"
    {attribute}

    def open(self, scene):
        return ["extinction"]

    def at(self, quantities, time, level, position, height):
        {body}

evac_interface = 3
"""


@pytest.mark.parametrize(
    "body", ["desired *= 0.5; return desired", "return 1j * desired", "return ['a'] * len(desired)"]
)
def test_a_law_that_writes_to_its_arguments_or_returns_no_real_numbers_is_refused(tmp_path, body):
    path = tmp_path / "broken.py"
    path.write_text(LAW.format(body=body), encoding="utf-8")
    law = Registry([path]).smoke_laws["broken"]()
    desired = np.ones(3)
    with pytest.raises(evac.PluginError, match=r"law 'broken': speed.*broken\.py"):
        share_in_smoke(law, desired, np.full(3, 0.5), None)
    np.testing.assert_array_equal(desired, 1.0)


@pytest.mark.parametrize(
    ("attribute", "body"),
    [
        ("", "position[:] = 0.0; return np.zeros((1, len(level)))"),
        ("", "return 1j * np.ones((1, len(level)))"),
        ("", "return [['a'] * len(level)]"),
        ("last = float('nan')", "return np.zeros((1, len(level)))"),
    ],
)
def test_a_source_that_writes_to_its_arguments_or_returns_no_real_numbers_is_refused(tmp_path, attribute, body):
    path = tmp_path / "cloud.py"
    path.write_text(CLOUD.format(attribute=attribute, body=body), encoding="utf-8")
    case = car_park(path, conditions=[{"source": "cloud"}])
    with pytest.raises(evac.PluginError, match=r"source 'cloud'.*cloud\.py"):
        Simulation(case).run()
