import re

import numpy as np
import pytest

from evac.people.groups import overlapping, unusual
from evac.people.population import Group
from evac.physics.state import make_crowd


def group(crowd):
    return [Group("walkers", np.arange(len(crowd.level), dtype=np.int32), {})]


@pytest.mark.parametrize(
    ("quantity", "value", "words"),
    [
        ("speed", 130.0, "people.walkers.speed is 130 to 130 m/s"),
        ("speed", 0.0, "people.walkers.speed is 0 to 0 m/s"),
        ("radius", 0.02, "people.walkers.radius is 0.02 to 0.02 m,"),
        ("mass", 70000.0, "people.walkers.mass is 7e+04 to 7e+04 kg"),
        ("tau", 50.0, "people.walkers.tau is 50 to 50 s"),
    ],
)
def test_a_slip_of_the_unit_is_told(quantity, value, words):
    crowd = make_crowd([[0.0, 0.0], [5.0, 0.0]], **{"speed": 1.3, quantity: value})
    (note,) = unusual(crowd, group(crowd))
    assert note.startswith(words)
    assert "unit" in note


@pytest.mark.parametrize(("mass", "words"), [(700.0, "80 to 700 kg"), (1.0, "1 to 80 kg")])
def test_one_of_many_is_enough(mass, words):
    crowd = make_crowd([[float(k), 0.0] for k in range(10)], mass=np.array([80.0] * 9 + [mass]), speed=1.3)
    assert words in unusual(crowd, group(crowd))[0]


def test_overlaps_at_the_start_are_counted_by_level():
    crowd = make_crowd([[0.0, 0.0], [0.3, 0.0], [0.3, 0.3], [0.0, 0.0]], radius=0.2, speed=1.3)
    crowd.level[3] = 1  # above the first
    assert overlapping(crowd) == (2, pytest.approx(0.1))
    assert re.search("^2 pairs .* 0.10 m", unusual(crowd, group(crowd))[0])
    crowd.contact_radius[:] = 0.14  # of the bodies that touch
    assert overlapping(crowd) == (0, 0.0)


def test_every_pair_that_overlaps_is_found():
    random = np.random.default_rng(5)
    position, radius = random.uniform(-3.0, 3.0, (200, 2)), random.uniform(0.1, 0.3, 200)
    crowd = make_crowd(position, radius=radius, speed=1.3)
    one, other = np.triu_indices(200, 1)
    overlap = radius[one] + radius[other] - np.hypot(*(position[one] - position[other]).T)
    assert overlapping(crowd) == ((overlap > 0.0).sum(), pytest.approx(overlap.max()))
