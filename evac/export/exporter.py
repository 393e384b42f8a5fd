"""Export of recorded runs to formats of other programs, and the base class of exporter plugins."""

import re
from abc import ABC, abstractmethod
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

from evac.base.errors import ResultError, fault, plugin_code
from evac.base.parameters import Configurable
from evac.folder.files import EXPORT_FOLDER, draft_in, replacing, writing

if TYPE_CHECKING:
    from evac.trajectory.trajectory import Trajectory

#: Remedy for an exporter that has written to an array of the trajectory.
COPY = "copy the arrays of the trajectory before changing them"


class Exporter(Configurable, ABC):
    """Writes a recorded run in one format, for ``evac export RESULT --to NAME``."""

    #: Ending of the file, in lower case with the dot; empty if several files are written to a folder.
    suffix: ClassVar[str] = ""

    @abstractmethod
    def write(self, trajectory: "Trajectory", path: Path) -> Iterable[Path]:
        """Write the run.

        Parameters
        ----------
        trajectory : Trajectory
            Must not be modified. It may have no frame, for example if the run failed in its first step.
        path : Path
            File to write, or existing folder to write to if `suffix` is empty. Existing files are overwritten.

        Returns
        -------
        iterable of Path
            The files written that a user opens, without other files to which they refer.

        Raises
        ------
        ResultError
            The run contains nothing that can be written in this format.
        OSError
            A file cannot be written; the caller adds the path.
        """

    def place(self, trajectory: "Trajectory") -> Path:
        """Return the default path.

        By default ``export/trajectory.SUFFIX`` or ``export/NAME/`` in the result folder.
        """
        if not trajectory.path.parent.is_dir():
            raise ResultError(f"{trajectory.path}: there is no result folder for the export; give a path")
        folder = trajectory.path.parent / EXPORT_FOLDER
        return folder / f"trajectory{self.suffix}" if self.suffix else folder / self.name


def export(trajectory: "Trajectory", exporter: Exporter, path: Path | None = None) -> list[Path]:
    """Write a recorded run with an exporter."""
    place = exporter.place(trajectory) if path is None else path
    what = f"the {exporter.name} export"
    with plugin_code(f"{place}: exporter {exporter.name!r}", exporter, COPY):
        with writing(what, place):
            (place.parent if exporter.suffix else place).mkdir(parents=True, exist_ok=True)
        if exporter.suffix:
            with replacing(place, what) as new:
                new.unlink()  # so that it is noticed if the exporter writes no file
                written = _write(exporter, trajectory, new)
            return [place if path == new else path for path in written]
        with writing(what, place), draft_in(place) as made:
            written = _write(exporter, trajectory, made)
        return [place / path.relative_to(made) if path.is_relative_to(made) else path for path in written]


def _write(exporter: Exporter, trajectory: "Trajectory", place: Path) -> list[Path]:
    """Call an exporter, and return the files that it says it has written, which must exist."""
    written = exporter.write(trajectory, place)
    paths: list[Any] = list(written) if isinstance(written, Iterable) else [written]
    for path in paths or [None]:
        if not isinstance(path, Path) or not path.exists():
            wrong = f"write() returns {path!r}, which is no path of an existing file"
            remedy = "return the paths of the files that it has written and a user opens"
            raise fault(f"exporter {exporter.name!r}", wrong, remedy, type(exporter).write)
    return paths


def file_stems(names: Iterable[str]) -> list[str]:
    """Return a unique file name stem for each name; characters other than ``A-Za-z0-9._-`` become ``_``.

    >>> file_stems(["ground", "flight z=0.00..1.50", "Ground"])
    ['ground', 'flight_z_0.00..1.50', 'Ground_2']
    """
    stems: list[str] = []
    used: set[str] = set()
    for name in names:
        plain = re.sub(r"[^\w.-]+", "_", name, flags=re.ASCII).strip("._") or "unnamed"
        stem, number = plain, 1
        while stem.lower() in used:  # some file systems do not distinguish upper and lower case
            number += 1
            stem = f"{plain}_{number}"
        used.add(stem.lower())
        stems.append(stem)
    return stems
