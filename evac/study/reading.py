"""Opening a study again from its folder: `evac.read_study`."""

from collections.abc import Callable, Iterable, Mapping
from functools import cache, partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from evac.base.errors import ResultError, in_one_line
from evac.folder.files import STUDY_NAME
from evac.study.identity import read_identity
from evac.study.points import Point, Seeds
from evac.study.stopping import Rule
from evac.study.study import Study

if TYPE_CHECKING:
    from evac.case.case import Case


def read_study(folder: str | Path, plugin_files: Iterable[str | Path] = ()) -> Study:
    """Open a study from its folder: a result of `evac.repeat` or `evac.sweep`, also of an interrupted or running one.

    Nothing is changed in the folder, and no code that it names is executed. The case is read only when it is needed,
    for `Study.case_of` and `Study.run_again`, from what the folder contains and the file of the building.

    Parameters
    ----------
    folder : str or Path
        Result folder, or the folder ``RESULT.running`` of a study that is not complete.
    plugin_files : iterable of path
        Plugin files of the case. They are executed when the case is needed; none is necessary to read the results.

    Returns
    -------
    Study

    Raises
    ------
    ResultError
        The folder contains no study, or a file is damaged.

    Examples
    --------
    >>> study = read_study("classroom-runs")  # doctest: +SKIP
    >>> study.statistics[0].mean  # doctest: +SKIP
    """
    place = Path(folder)
    identity, definition = read_identity(place)
    files = tuple(Path(path).resolve() for path in plugin_files)
    try:
        bases = [_base(place, content, files) for content in definition["cases"]]
        points = [
            Point(index, bases[number], parameters)
            for index, (number, parameters) in enumerate(
                zip(definition["case_of_point"], identity["parameters"], strict=True)
            )
        ]
        seeds = Seeds(identity["first_seed"], identity["repetitions"])
        rule = Rule(**definition["rule"])
        return Study(points, seeds, rule, place)
    except (LookupError, TypeError, ValueError, AttributeError) as error:
        raise ResultError(f"{place / STUDY_NAME}: not that of a study: {in_one_line(error)}") from error


def _base(folder: Path, content: Mapping[str, Any], plugin_files: tuple[Path, ...]) -> "Callable[[], Case]":
    return cache(partial(_case_of, folder, content, plugin_files))


def _case_of(folder: Path, content: Mapping[str, Any], plugin_files: tuple[Path, ...]) -> "Case":
    """Return the case of a study; plugin files that were used must be given, because the folder may be a stranger's."""
    from evac.case.loading import case_from

    source = Path(content["source"])
    named = [(source.parent / name).resolve() for name in content["table"].get("plugins", {}).get("files", [])]
    used = (*named, *map(Path, content["plugin_files"]))
    if missing := [str(path) for path in dict.fromkeys(used) if path not in plugin_files]:
        raise ResultError(
            f"{folder}: its runs need the plugin {', '.join(missing)}; give it to read_study (plugin_files=)"
        )
    return case_from(content["table"], source, plugin_files=plugin_files)
