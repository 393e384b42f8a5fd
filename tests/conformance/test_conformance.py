"""Everything registered holds to the contract; and each check finds what it is there for."""

import numpy as np
import pytest

from evac.case.loading import load_case
from evac.conformance import check_plugin, physics
from evac.contract.registry import Registry
from evac.people.behaviour import Behaviour
from evac.physics.contact.model import ContactModel

REGISTRY = Registry()

#: Other values of built-in contact models that change what they compute.
VARIANTS = {
    "nsm1": [{"variant": "overdamped"}, {"solver": "uzawa"}],
    "nsm2": [{"normal_dissipation": 0.0}, {"tangential_dissipation": 100.0}, {"position_correction": True}],
}

#: Cases in which the built-in behaviours have something to do.
CASES = {
    "response_time": ("square_room", {"behaviours.response_time": {"time": {"uniform": [0.0, 2.0]}}}),
    "teacher_following": ("primary_school", {"directions.spacing": 0.2}),
    "route_choice": (
        "square_room",
        {
            "behaviours.route_choice": {"strategies": ["fastest", "shortest", "comfortable"], "every": 0.3},
            "people": [
                {
                    "name": "one",
                    "number": 1,
                    "area": "room",
                    "behaviours": {"route_choice": {"strategies": ["comfortable"]}},
                },
                {"name": "others", "number": 5, "area": "room"},
            ],
        },
    ),
}


def models():
    for name in REGISTRY.contact_models:
        for values in [{}, *VARIANTS.get(name, [])]:
            yield pytest.param(name, values, id="-".join([name, *map(str, values.values())]))


@pytest.mark.parametrize(("name", "values"), list(models()))
def test_a_contact_model_conforms(name, values):
    check_plugin(REGISTRY.contact_models[name], **values)


class Rigid(ContactModel):
    """Bodies that neither overlap nor rebound, exactly, in NumPy."""

    name = "rigid_in_numpy"
    reach_share = 1.0

    def step(self, contacts, h):
        velocity, push = contacts.free.copy(), contacts.percussion
        share = np.append(1.0 / contacts.mass, 0.0)  # the last one is that of walls
        velocity = np.vstack([velocity, np.zeros(2)])
        push[:], change = 0.0, np.inf
        while change > 1e-12:
            change = 0.0
            for c, (i, j, n) in enumerate(zip(contacts.body, contacts.other, contacts.normal, strict=True)):
                asked = (n @ (velocity[i] - velocity[j]) + max(contacts.gap[c], 0.0) / h) / (share[i] + share[j])
                more = max(-asked, -push[c])
                push[c] += more
                velocity[i] += more * share[i] * n
                velocity[j] -= more * share[j] * n
                change = max(change, abs(more) * share[i])
        return velocity[:-1]


def test_a_model_without_overlaps_conforms():
    physics.check_collision(Rigid())
    physics.check_crowd(Rigid())


@pytest.mark.parametrize("name", list(REGISTRY.solvers))
def test_a_solver_conforms(name):
    check_plugin(REGISTRY.solvers[name])


@pytest.mark.parametrize("reading", ["isotropic", "anisotropic"])
def test_the_social_force_conforms(reading):
    check_plugin(REGISTRY.forces["social"], reading=reading)


@pytest.mark.parametrize("name", list(REGISTRY.forces))
def test_a_force_conforms(name):
    check_plugin(REGISTRY.forces[name])


@pytest.mark.parametrize("name", list(REGISTRY.recorders))
def test_a_recorder_conforms(name):
    check_plugin(REGISTRY.recorders[name])


@pytest.mark.parametrize("name", list(REGISTRY.behaviours))
def test_a_behaviour_conforms(name):
    source, changes = CASES.get(name, ("square_room", {f"behaviours.{name}": {}}))
    check_plugin(REGISTRY.behaviours[name], load_case(source, changes))


@pytest.mark.parametrize("name", list(REGISTRY.smoke_laws))
def test_a_law_of_speed_in_smoke_conforms(name):
    check_plugin(REGISTRY.smoke_laws[name])


def test_the_source_of_slices_conforms():
    check_plugin(REGISTRY.condition_sources["fds"], load_case("office_fire", {"safety": None, "compartment": []}))


def test_the_source_of_prescribed_values_conforms():
    table = {"source": "prescribed", "values": {"extinction": 1.0, "co": 90.0}}
    check_plugin(REGISTRY.condition_sources["prescribed"], load_case("square_room", {"conditions": [table]}))


@pytest.mark.parametrize("name", list(REGISTRY.importers))
def test_an_importer_conforms(name):
    check_plugin(REGISTRY.importers[name], load_case("square_room") if name == "meshio" else None)


@pytest.mark.parametrize("name", list(REGISTRY.exporters))
def test_an_exporter_conforms(name):
    check_plugin(REGISTRY.exporters[name])


class Owner(Behaviour):
    """Owns a field, as smoke."""

    name = "owner"
    reads = writes = ("speed_factor",)

    def prepare(self, scene):
        self.field = scene.level_field("smoke", "1/m")

    def act(self, crowd, time):
        self.field.values += 0.1
        crowd.speed_factor[:] *= 0.9

    def state(self):
        return {}


def test_a_behaviour_with_a_field_of_its_own_conforms():
    check_plugin(Owner)
