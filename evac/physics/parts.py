"""Kernels of the step loop that a run is known to need before its first step."""

from collections.abc import Mapping, Sequence

from evac.base.errors import PluginError, fault, is_foreign, plugin_code
from evac.base.parameters import did_you_mean
from evac.directions.sampling import sample_travel_times
from evac.jit import Entry, call_body_force, call_pair_force
from evac.physics import driver
from evac.physics.contact.memory import recall, retain
from evac.physics.contact.model import ContactModel, SolvedContactModel
from evac.physics.contact.overlaps import separate
from evac.physics.contact.packing import check_indices, cutoff_of, packed_row
from evac.physics.contact.pair_contact import PairContact
from evac.physics.contact.rows import call_solver
from evac.physics.contact.solver import Solver
from evac.physics.force import Force, add_body_forces, add_forces
from evac.physics.seams import reaches
from evac.physics.state import LoadedSolver


def entries_of_loop(
    model: ContactModel, forces: Sequence[Force], solvers: Mapping[str, type[Solver]], has_seams: bool, full: bool
) -> list[Entry]:
    """Return the kernels that the step loop of a run is known to need."""
    entries = list(entries_of_parts(model, forces, has_seams).values())
    if isinstance(model, PairContact):
        model.check_pair()
    if model.along_the_way:
        entries.append(sample_travel_times)
    if model.law is None:
        entries += [driver.open_step, driver.set_clock, driver.prepare_step, driver.finish_step, driver.undo_step]
    else:
        entries.append(driver.advance)
    if isinstance(model, SolvedContactModel):
        entries.append(solver_of(model, solvers).solve)
        if full:
            entries.append(solver_of(model, solvers, stronger=True).solve)
        if full and model.separates:
            entries.append(separate)
    for force in forces:
        entries += functions_of(force)
    return list(dict.fromkeys(entries))


def entries_of_parts(model: ContactModel, forces: Sequence[Force], has_seams: bool) -> dict[str, Entry]:
    """Return the kernels whose addresses `Parts` has in a run, by name, except those of solvers and `separation`."""
    entries: dict[str, Entry] = {} if model.law is None else {"law": model.law}
    if model.memory:
        entries |= {"recall": recall, "retain": retain}
    if has_seams:
        entries["seams"] = reaches
    if any(force.pair is not None for force in forces):
        entries["forces"] = add_forces
    if any(force.body is not None for force in forces):
        entries["body_forces"] = add_body_forces
    return entries


def functions_of(force: Force) -> list[Entry]:
    """Return the compiled functions of a force."""
    functions: list[Entry] = []
    what = f"force {force.name!r}"
    for name, call in (("pair", call_pair_force), ("body", call_body_force)):
        function = getattr(force, name)
        if function is not None:
            call.check(function, f"{what}: {name}", type(force))
            check_indices(function, len(packed_row(force, what)), what)
            functions.append(function)
    if not functions:
        remedy = "define `pair`, decorated with evac.jit.pair_force, or `body`, decorated with evac.jit.body_force"
        raise fault(what, "names no function", remedy, force)
    cutoff_of(force)
    return functions


def load_solver(solver: type[Solver]) -> LoadedSolver:
    """Return a solver as kernels call it."""
    return LoadedSolver(solve=solver.solve.address, is_checked=int(is_foreign(solver)))


def solver_of(model: SolvedContactModel, solvers: Mapping[str, type[Solver]], stronger: bool = False) -> type[Solver]:
    """Return the solver of a contact model, or its stronger solver for solves that fail."""
    name = model.solver
    for _ in range(1 + stronger):
        if name not in solvers:
            raise PluginError(f"contact.{model.name}.solver: unknown solver {name!r}; {did_you_mean(name, [*solvers])}")
        solver = solvers[name]
        with plugin_code(f"solver {name!r}", solver):
            call_solver.check(getattr(solver, "solve", None), f"solver {name!r}: solve", solver)
        name = solver.stronger
    return solver
