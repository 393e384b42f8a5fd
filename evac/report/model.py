"""The model: what computed the results, with which parameters, and how to repeat it."""

import base64
import hashlib
from collections.abc import Mapping, Sequence
from typing import Any

from evac.base.distributions import told
from evac.case.toml import case_text
from evac.report.templates import APPENDIX, Section, section
from evac.results.record import CaseTable

#: Greatest number of lines of a case that is printed, on two or three pages.
MOST_LINES = 450

#: What keys of [simulation] and [directions] are.
WORDS = {
    "step": "time step [s]",
    "tick": "time between decisions of behaviours [s]",
    "duration": "longest simulated time [s]",
    "driving": "update of the driving force",
    "no_progress": "time without progress after which the run ends [s]",
    "spacing": "spacing of grid nodes [m]",
    "clearance": "distance kept from walls [m]",
    "stairs_up": "ratio of the reference speeds up stairs and on the flat",
    "stairs_down": "ratio of the reference speeds down stairs and on the flat",
    "comfort": "weight of stairs on comfortable routes",
    "order": "order of fast marching",
}


def model_section(
    case: CaseTable, versions: Mapping[str, str], plugins: Sequence[str], seed: str, command: str
) -> Section:
    """Return the section on the model."""
    return section(
        "model",
        f"{APPENDIX}model, parameters and versions",
        case=case,
        seed=seed,
        parameters={key: told(value) for key, value in case.model_parameters.items()},
        forces={name: told(values) for name, values in case.forces.items() if values is not False},
        simulation={_named(key): told(value) for key, value in case.simulation.items() if key != "seed"},
        directions={_named(key): told(value) for key, value in case.directions.items()},
        versions=versions,
        plugins=plugins,
        command=command,
    )


def _named(key: str) -> str:
    """Return a key of the case with what it is."""
    return f"{WORDS[key]} ({key})" if key in WORDS else key


def case_section(case: Mapping[str, Any]) -> Section:
    """Return the appendix with the whole case, which is attached to the page, and printed if it is short."""
    text = case_text(case)
    data = text.encode("utf-8")
    return section(
        "case",
        f"{APPENDIX}the case",
        text=text,
        lines=text.count("\n"),
        is_printed=text.count("\n") <= MOST_LINES,
        file=base64.b64encode(data).decode(),
        digest=hashlib.sha256(data).hexdigest(),
    )
