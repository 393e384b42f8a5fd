"""Kernels of the step loop that a run is known to need before its first step."""

from collections.abc import Mapping, Sequence

from evac.directions.sampling import sample_travel_times
from evac.errors import PluginError, plugin_code
from evac.jit import Entry
from evac.parameters import did_you_mean
from evac.physics import driver
from evac.physics.contact_model import ContactModel, SolvedContactModel
from evac.physics.drive import add_forces, drive, drive_overdamped
from evac.physics.force import Force
from evac.physics.overlaps import separate
from evac.physics.rows import call_solver
from evac.physics.seams import reaches
from evac.physics.solver import Solver


def entries_of_loop(
    model: ContactModel, forces: Sequence[Force], solvers: Mapping[str, type[Solver]], has_seams: bool, full: bool
) -> list[Entry]:
    """Return the kernels that the step loop of a run is known to need."""
    found = [sample_travel_times, drive_of(model)]
    if model.law is None:
        found += [driver.open_step, driver.set_clock, driver.approach, driver.conclude, driver.cut]
    else:
        found += [driver.advance, model.law]
    if isinstance(model, SolvedContactModel):
        found.append(solver_of(model, solvers).solve)
        if full:
            found.append(solver_of(model, solvers, stronger=True).solve)
        if full and model.separates:
            found.append(separate)
    if has_seams:
        found.append(reaches)
    if forces:
        found += [add_forces, *(force.pair for force in forces)]
    return found


def drive_of(model: ContactModel) -> Entry:
    """Return the drive kernel for a contact model."""
    chosen: Entry = drive_overdamped if model.overdamped else drive
    return chosen


def solver_of(model: SolvedContactModel, solvers: Mapping[str, type[Solver]], stronger: bool = False) -> type[Solver]:
    """Return the solver of a contact model, or its stronger solver for solves that fail.

    Raises
    ------
    PluginError
        The solver is not registered, or its kernel has the wrong signature.
    """
    name = model.solver
    for _ in range(1 + stronger):
        if name not in solvers:
            raise PluginError(f"contact.{model.name}.solver: unknown solver {name!r}; {did_you_mean(name, [*solvers])}")
        found = solvers[name]
        with plugin_code(f"solver {name!r}"):
            call_solver.check(getattr(found, "solve", None), f"solver {name!r}: solve")
        name = found.stronger
    return found
