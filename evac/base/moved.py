"""Former names of modules, which are refused with the present ones."""

import sys
from collections.abc import Sequence
from importlib.abc import MetaPathFinder
from importlib.machinery import ModuleSpec
from types import ModuleType

#: Modules that documents or plugins named, and where their content is now.
MOVED = {
    "evac.behaviour": "evac.people.behaviour",
    "evac.case.keys": "evac.base.keys",
    "evac.errors": "evac.base.errors",
    "evac.hookspecs": "evac.contract.hooks",
    "evac.jit.layout": "evac.jit.structs",
    "evac.output": "evac.trajectory, evac.analysis, evac.results, evac.pictures, evac.export or evac.report",
    "evac.parameters": "evac.base.parameters",
    "evac.physics.contact_model": "evac.physics.contact.model",
    "evac.physics.contacts": "evac.physics.contact.contacts",
    "evac.physics.pair_contact": "evac.physics.contact.pair_contact",
    "evac.physics.rows": "evac.physics.contact.rows",
    "evac.physics.solver": "evac.physics.contact.solver",
    "evac.registry": "evac.contract.registry",
    "evac.running": "evac.simulation.running",
    "evac.scenario": "evac.case",
}


class MovedModules(MetaPathFinder):
    """Refuses former names; asked after all other finders."""

    def find_spec(
        self, fullname: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        """Raise an error for a module that has moved."""
        if fullname in MOVED:
            raise ModuleNotFoundError(f"{fullname} is now {MOVED[fullname]}", name=fullname)
        return None


def refuse_former_names() -> None:
    """Make imports of modules that have moved fail with their present names."""
    if not any(isinstance(finder, MovedModules) for finder in sys.meta_path):
        sys.meta_path.append(MovedModules())
