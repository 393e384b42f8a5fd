"""What a study is: written to its folder at the start, so that only the same study goes on there."""

import hashlib
import json
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from evac.assembly import ground_key, providers
from evac.errors import ResultError, naming
from evac.output.files import STUDY_NAME, writing
from evac.output.results import plain, versions
from evac.study.points import Point, Seeds

if TYPE_CHECKING:
    from evac.scenario.case import Case


def identity_of(points: Sequence[Point], seeds: Seeds, digests: Sequence[str]) -> dict[str, Any]:
    """Return what makes a study the same study: case, building, parameters, plugins, seeds, versions.

    How many runs it has, when it stops and who makes the runs is no part of it.
    """
    case = points[0].case
    return {
        "case": plain(_settings(case)),
        "parameters": [plain(point.parameters) for point in points],
        "points": list(digests),
        "plugins": sorted({name for point in points for name in _plugins(point.case)}),
        "first_seed": seeds.first,
        "repetitions": seeds.repetitions,
        "versions": plain(versions()),
    }


def digest_of(case: "Case", key: str) -> str:
    """Return a digest of all that the runs of a point depend on but the seeds, its building among it."""
    parts = [_settings(case), _plugins(case), key]
    return hashlib.sha256(json.dumps(plain(parts), sort_keys=True).encode()).hexdigest()


def key_of(case: "Case") -> str:
    """Return the key of the ground of a point."""
    with naming(case.source):
        return ground_key(case)


def write_identity(folder: Path, identity: Mapping[str, Any]) -> None:
    """Write study.json."""
    with writing("the study", folder):
        (folder / STUDY_NAME).write_text(json.dumps(identity, indent=2) + "\n", encoding="utf-8")


def check_identity(folder: Path, identity: Mapping[str, Any]) -> None:
    """Refuse to go on with another study.

    Raises
    ------
    ResultError
        There is no study in the folder, or another one; the message names what has changed.
    """
    path = folder / STUDY_NAME
    try:
        found = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise ResultError(f"{path}: cannot be read: {error}; begin the study anew, without --resume") from error
    changes = list(_changes(found, json.loads(json.dumps(identity))))
    if not changes:
        return
    of_points = [change for change in changes if change.startswith("points.")]
    told = [change for change in changes if change not in of_points] or ["the file of the building has changed"]
    shown = "\n".join(f"  {line}" for line in told[:10])
    more = f"\n  and {len(told) - 10} more" if len(told) > 10 else ""
    raise ResultError(
        f"{folder}: holds the runs of another study, so that it cannot go on:\n{shown}{more}\nundo this, or choose "
        "another folder (--out)"
    )


def _settings(case: "Case") -> dict[str, Any]:
    """Return the case but for its seeds, which the study sets."""
    table = case.to_dict()
    for name in ("seed", "population_seed"):
        table["simulation"].pop(name, None)
    return table


def _plugins(case: "Case") -> list[str]:
    return providers(case)


def _changes(found: Any, wanted: Any, key: str = "") -> Iterator[str]:
    """Yield a line for each value that differs, by its dotted key."""
    if isinstance(found, dict) and isinstance(wanted, dict):
        for name in dict.fromkeys([*found, *wanted]):
            yield from _changes(found.get(name), wanted.get(name), f"{key}.{name}" if key else name)
    elif isinstance(found, list) and isinstance(wanted, list) and len(found) == len(wanted):
        for k, (one, other) in enumerate(zip(found, wanted, strict=True)):
            yield from _changes(one, other, f"{key}.{k}")
    elif found != wanted:
        yield f"{key} was {_short(found)} and is {_short(wanted)}"


def _short(value: Any) -> str:
    text = json.dumps(value)
    return text if len(text) <= 80 else f"{text[:77]}..."
