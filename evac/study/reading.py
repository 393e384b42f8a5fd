"""Opening a study again from its folder: `evac.read_study`."""

from collections.abc import Iterable
from functools import cache, partial
from pathlib import Path

from evac.base.errors import ResultError, in_one_line
from evac.folder.files import STUDY_NAME
from evac.results.reading import recorded_case
from evac.study.identity import read_identity
from evac.study.points import Point, Seeds
from evac.study.stopping import Rule
from evac.study.study import Study


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
        bases = [
            cache(partial(recorded_case, place, one["table"], one["source"], one["plugin_files"], files))
            for one in definition["cases"]
        ]
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
