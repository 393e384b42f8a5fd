"""The kernels that a scene loads, and the time to compile them if none is on disk."""

import sys
import time
from collections.abc import Iterator, Mapping, Sequence
from types import ModuleType
from typing import Any, NamedTuple

from evac.case.loading import load_case
from evac.evidence.evidence import Evidence, Row, in_fresh_process
from evac.evidence.verdicts import reported
from evac.jit.kernels import entries_of
from evac.simulation.simulation import Simulation

#: Simulated time after which a scene has loaded all kernels that it needs [s].
DURATION = 20.0

SECTION = "Kernels"
CPU = "CPU [s]"

#: The two runs of a case.
AS_IT_IS, ALL_IN = "as it is", "all in"


class KernelCase(NamedTuple):
    """A shipped case with a model, and parts that it can name without needing them."""

    scene: str
    model: str
    overrides: Mapping[str, Any]  # overrides that choose the model
    named: Mapping[str, Any]  # overrides that name forces and behaviours, for the run with all parts


def report_kernels(evidence: Evidence, cases: Sequence[KernelCase]) -> None:
    """Add the kernels that the cases load, and the compilation time saved if none is on disk."""
    rows = evidence.measured("kernels", lambda: [row for case in cases for row in kernel_rows(case)])
    table = list(summary_rows(rows))
    for row in table:
        text = f"{row['kernels']} kernels, {row[CPU]:.1f} CPU s;"
        text += f" left out {row['left out: kernels']}, {row[f'left out: {CPU}']:.1f} CPU s"
        evidence.verdict(reported(f"{row['scene']}, {row['model']}: compiling", text, "-", SECTION))
    evidence.show("kernels", __name__, rows=rows, compiled=table)


def kernel_rows(case: KernelCase) -> list[Row]:
    """Return a row per kernel that a case loads by default, and with all parts."""
    rows: list[Row] = []
    for variant in (AS_IT_IS, ALL_IN):
        overrides = dict(case.overrides) | (dict(case.named) if variant == ALL_IN else {})
        loads: dict[str, Any] = {"before": 1}
        while loads["before"]:  # kernels that were missing are on disk the next time
            first = [row["kernel"] for row in rows]
            loads = in_fresh_process(loaded, case.scene, overrides, variant == ALL_IN, first)
        head = {"scene": case.scene, "model": case.model, "variant": variant, "functions": loads["functions"]}
        for label, (span, size) in loads["kernels"].items():
            rows.append({**head, "kernel": label, CPU: span, "object code [kB]": 1e-3 * size})
    return rows


def loaded(name: str, overrides: Mapping[str, Any], full: bool, first: Sequence[str]) -> Row:
    """Run a case, then compile the kernels that it has loaded, beginning with those with labels in `first`.

    ``kernels`` are CPU time [s] and bytes of each; ``functions`` how many are in them; ``before`` how many of these the
    run has compiled in this process, which then are not compiled again.
    """
    quiet = {"output.animation": False, "output.picture": False, "simulation.duration": DURATION}
    Simulation(load_case(name, {**overrides, **quiet}), full=full).run()
    modules = [module for module in sys.modules.values() if isinstance(module, ModuleType)]
    entries = {entry for module in modules for entry in entries_of(module) if entry.is_ready}
    from evac.jit.compiler import compile_entry, compiled_functions  # imports numba, which is not timed

    before = len(compiled_functions())
    seconds = {}
    for entry in sorted(entries, key=lambda entry: (entry.label not in first, entry.label)):
        start = time.process_time()
        code = compile_entry(entry, "timed")
        seconds[entry.label] = time.process_time() - start, len(code)
    return {"kernels": seconds, "functions": len(compiled_functions()), "before": before}


def summary_rows(rows: Sequence[Row]) -> Iterator[Row]:
    """Return a row per case: kernels, functions and CPU time as it is, and those that it leaves out."""
    for scene, model in dict.fromkeys((row["scene"], row["model"]) for row in rows):
        own = [row for row in rows if (row["scene"], row["model"]) == (scene, model)]
        lean, full = ([row for row in own if row["variant"] == variant] for variant in (AS_IT_IS, ALL_IN))
        needed = {row["kernel"] for row in lean}
        out = [row for row in full if row["kernel"] not in needed]
        yield {
            "scene": scene,
            "model": model,
            "kernels": len(lean),
            "functions": lean[0]["functions"],
            CPU: sum(row[CPU] for row in lean),
            "left out: kernels": len(out),
            "left out: functions": full[0]["functions"] - lean[0]["functions"],
            f"left out: {CPU}": sum(row[CPU] for row in out),
        }


def loaded_rows(rows: Sequence[Row]) -> list[Row]:
    """Return a row per kernel, and in a column for each case whether it is in, or only if included."""
    cases = list(dict.fromkeys((row["scene"], row["model"]) for row in rows))
    variants: dict[str, dict[tuple[str, str], str]] = {}
    for row in sorted(rows, key=lambda row: bool(row["variant"] == ALL_IN)):
        words = "if included" if row["variant"] == ALL_IN else "in"
        variants.setdefault(row["kernel"], {}).setdefault((row["scene"], row["model"]), words)
    return [
        {"kernel": kernel} | {", ".join(case): variants[kernel].get(case, "-") for case in cases}
        for kernel in sorted(variants)
    ]
