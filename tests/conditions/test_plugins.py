"""The documented plugins run: a law of the speed in smoke, and a cloud that moves through a car park."""

import shutil
from pathlib import Path

import numpy as np
import pytest

import evac
from evac.conformance import check_plugin
from evac.contract.registry import Registry
from evac.simulation.simulation import Simulation

EXAMPLES = Path(__file__).parents[2] / "docs/examples/conditions"


@pytest.fixture
def documented(tmp_path):
    """Return a copy of the documented plugin file of a class."""
    return lambda name: Path(shutil.copy(EXAMPLES / f"{name.lower()}.py", tmp_path))


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
        with simulation.population.writable():
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
