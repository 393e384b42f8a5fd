"""The identity of a study and its definition, written to its folder at the start.

Only a study of the same identity can be resumed there; with the definition a study can be opened again.
"""

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

from evac.base.errors import ResultError, in_one_line, naming, usable_path
from evac.folder.digests import differences, digest_of_data
from evac.folder.files import STUDY_NAME, replacing
from evac.folder.jsonfile import plain
from evac.results.results import versions
from evac.simulation.assembly import providers
from evac.simulation.identity import ground_key
from evac.study.points import Point, Seeds
from evac.study.stopping import Rule

if TYPE_CHECKING:
    from evac.case.case import Case


def identity_of(points: Sequence[Point], seeds: Seeds, digests: Sequence[str]) -> dict[str, Any]:
    """Return what identifies a study: case, building, parameters, plugins, seeds, versions.

    The number of runs, the stopping rule and the executor are not included.
    """
    case = points[0].case
    return {
        "case": plain(_settings(case)),
        "parameters": [plain(point.parameters) for point in points],
        "points": list(digests),
        "plugins": sorted({name for point in points for name in providers(point.case)}),
        "first_seed": seeds.first,
        "repetitions": seeds.repetitions,
        "versions": plain(versions()),
    }


def digest_of(case: "Case", key: str) -> str:
    """Return a digest of everything that the runs of a point depend on except the seeds; includes the building."""
    return digest_of_data(plain([_settings(case), providers(case), key]))


def key_of(case: "Case") -> str:
    """Return the key of the ground of a point."""
    with naming(case.source):
        return ground_key(case)


def definition_of(points: Sequence[Point], rule: Rule) -> dict[str, Any]:
    """Return what opens a study again, in addition to its identity: its cases, and the rule for the number of runs."""
    bases = {id(point.base): point.base for point in points}
    numbers = {key: number for number, key in enumerate(bases)}
    cases = [base() if callable(base) else base for base in bases.values()]
    return {
        "rule": asdict(rule),
        "cases": [{"table": case.table, "source": str(case.source), "plugin_files": _files(case)} for case in cases],
        "case_of_point": [numbers[id(point.base)] for point in points],
    }


def _files(case: "Case") -> list[str]:
    """Return all plugin files of a case: those of its registry, and those that have not been run."""
    return [str(path) for path in dict.fromkeys((*case.registry.files(), *case.plugin_files))]


def write_identity(folder: Path, identity: Mapping[str, Any], definition: Mapping[str, Any]) -> None:
    """Write study.json, with a digest of its content."""
    content = json.loads(json.dumps({**identity, "definition": definition}, default=plain))
    text = json.dumps({**content, "digest": digest_of_data(content)}, indent=2)
    with replacing(folder / STUDY_NAME, "the study") as new:
        new.write_text(text + "\n", encoding="utf-8")


def read_identity(folder: Path) -> tuple[dict[str, Any], dict[str, Any]]:
    """Return the identity and the definition of a study."""
    path = usable_path(folder, ResultError) / STUDY_NAME
    if not path.is_file():
        raise ResultError(f"{path}: no such file; name a result folder of `evac repeat` or `evac sweep`")
    try:
        identity = json.loads(path.read_text(encoding="utf-8"))
        digest, definition = identity.pop("digest"), identity["definition"]
    except (OSError, ValueError, AttributeError, LookupError, TypeError, RecursionError) as error:
        raise ResultError(f"{path}: cannot be read: {in_one_line(error)}; start the study again") from error
    if digest != digest_of_data(identity):
        raise ResultError(f"{path}: damaged, its digest differs; start the study again")
    del identity["definition"]
    return identity, definition


def check_identity(folder: Path, identity: Mapping[str, Any]) -> None:
    """Check that a folder contains this study."""
    found, _ = read_identity(folder)
    changes = list(differences(found, json.loads(json.dumps(identity))))
    if not changes:
        return
    listed = [
        f"{'.'.join(key)} was {_short(old)} and is {_short(new)}" for key, old, new in changes if key[0] != "points"
    ] or ["the file of the building has changed"]
    shown = "\n".join(f"  {line}" for line in listed[:10])
    more = f"\n  and {len(listed) - 10} more" if len(listed) > 10 else ""
    raise ResultError(
        f"{folder}: contains the runs of another study, which cannot be resumed:\n{shown}{more}\nundo the changes, or "
        "choose another folder (--out)"
    )


def _settings(case: "Case") -> dict[str, Any]:
    """Return the settings of a case without its seeds, which the study sets."""
    table = case.to_dict()
    for name in ("seed", "population_seed"):
        table["simulation"].pop(name, None)
    return table


def _short(value: Any) -> str:
    text = json.dumps(value)
    return text if len(text) <= 80 else f"{text[:77]}..."
