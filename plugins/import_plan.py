"""Importer of plan files: TOML with storeys, stairs, doors, exits, areas and obstacles, see docs/plans.md."""

from collections.abc import Sequence
from pathlib import Path

from evac.building.importer import Importer
from evac.building.plan.plan import Plan
from evac.building.plan.plantable import plan_of, read_table


class PlanImporter(Importer):
    """Plan files (.plan.toml): storeys, whose shapes may be in separate files, with stairs, doors, exits and areas."""

    name = "plan"
    suffixes = (".plan.toml",)

    def files(self, path: Path) -> Sequence[Path]:
        """Return the plan file and those of its storeys."""
        return (path, *self.read(path).files)

    def read(self, path: Path) -> Plan:
        """Read a plan; raise ValueError if the file is not TOML."""
        return plan_of(read_table(path), path, path.parent)
