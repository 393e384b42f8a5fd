"""Whole simulations of large halls, each in a process of its own: set-up by phases, first ticks, peak memory."""

import sys
import time
from pathlib import Path
from typing import Any

import numpy as np

from evac.case.loading import load_case
from evac.evidence.evidence import Evidence, Row, in_fresh_process
from evac.evidence.scaling.halls import hall_case
from evac.evidence.scaling.walks import bytes_of, cpu_time, minimal_cost, start_minimal
from evac.evidence.scenes import model_overrides
from evac.evidence.verdicts import at_most
from evac.simulation.simulation import Simulation

SIZES, QUICK_SIZES = (100_000, 1_000_000), (1_000,)

#: What a simulation of the most people may take: CPU time before its first tick [s], memory [GB].
MOST_SECONDS, MOST_MEMORY = 60.0, 1.2

#: People whose simulation comes first, so that packages and kernels are loaded.
FEWEST = 20

#: Ticks made before the memory is read, and then timed.
WARM, TIMED = 2, 3

#: Phases of a simulation that the table shows, as shares of all but the kernels.
SHOWN = ("building", "directions", "people", "preparation")

#: What is simulated: model and behaviour.
SCENES = (("DEM", ""), ("NSM1 inertial", ""), ("NSM2", ""), ("DEM", "headway"))

SECTION = "From the case to the first ticks"


def run(evidence: Evidence) -> None:
    """Add the table to the page."""
    sizes = QUICK_SIZES if evidence.quick else SIZES
    tasks = [(people, *scene, evidence.seed) for people in sizes for scene in SCENES]
    rows = evidence.measured("large", lambda: (in_fresh_process(simulate, *task) for task in tasks))
    people = max(row["people"] for row in rows)
    seconds, memory = (
        max(row[column] for row in rows if row["people"] == people) for column in ("set-up [s]", "peak memory [MB]")
    )
    scenes = ", ".join(model + (f" with {behaviour}" if behaviour else "") for model, behaviour in SCENES)
    what = f"{people:,} people, maximum of {scenes}:"
    evidence.verdict(at_most(f"{what} CPU time before the first tick", seconds, MOST_SECONDS, "s", SECTION))
    evidence.verdict(at_most(f"{what} peak memory", 1e-3 * memory, MOST_MEMORY, "GB", SECTION))
    evidence.show("large", __name__, rows=rows, formats={f"{phase} [%]": ".0f" for phase in SHOWN})


def simulate(people: int, model: str, behaviour: str, seed: int) -> Row:
    """Return the row of one simulation; peak memory is that of the process, so each wants one of its own."""
    changes: dict[str, Any] = model_overrides(model) | {"simulation.seed": seed}
    changes |= {f"behaviours.{behaviour}": {}} if behaviour else {}
    Simulation(load_case(hall_case(FEWEST), changes)).advance_tick()  # loads packages and kernels
    case = load_case(hall_case(people), changes)
    start = time.process_time()
    simulation = Simulation(case)
    simulation.engine.load(simulation.contact)
    spent, phases = time.process_time() - start, simulation.phases.seconds()
    first = cpu_time(simulation.advance_tick)
    for _ in range(WARM - 1):
        simulation.advance_tick()
    peak = peak_memory()
    steps, step = case.simulation.steps_per_tick, case.simulation.step
    minimal = start_minimal(simulation.population.crowd, simulation.fields.packed, steps, step)
    spans, least = [], []
    for _ in range(TIMED):
        inside = simulation.population.inside
        spans.append(cpu_time(simulation.advance_tick) / steps / inside)
        least.append(minimal_cost(minimal, steps, step))
    minimal_step = float(np.median(least)) * len(minimal.radius)
    total = sum(phases[phase] for phase in SHOWN)
    return {
        "people": people,
        "model": model,
        "behaviour": behaviour,
        "nodes": len(simulation.fields.packed.travel_time),
        "set-up [s]": spent,
        **{f"{phase} [%]": 100.0 * phases[phase] / total for phase in SHOWN},
        "set-up [minimal steps]": spent / minimal_step,
        "first tick [s]": first,
        "first tick [minimal steps]": first / minimal_step,
        "ns per person-step": 1e9 * float(np.median(spans)),
        "times minimal": float(np.median(np.divide(spans, least))),
        "peak memory [MB]": 1e-6 * peak,
        "memory, times minimal": peak / bytes_of(minimal),
    }


def peak_memory() -> int:
    """Return the most memory that this process has had so far [bytes]."""
    status = Path("/proc/self/status")
    if status.is_file():  # what getrusage tells includes the parent's, up to the start of this program
        fields = dict(line.split(":", 1) for line in status.read_text().splitlines())
        return 1024 * int(fields["VmHWM"].split()[0])
    import resource

    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * (1 if sys.platform == "darwin" else 1024)
