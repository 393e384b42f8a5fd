"""Importers, which read building files: the base class of importer plugins."""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar

from evac.base.errors import BuildingError
from evac.base.parameters import Configurable
from evac.building.surface.surfacemesh import SurfaceMesh

if TYPE_CHECKING:
    from evac.building.plan.plan import Plan


class Importer(Configurable, ABC):
    """Base class of importers: reads files of one or more formats into a `Plan` or a `SurfaceMesh`.

    An importer returns the content of the file: storeys and the stairs between them, or a surface with tags. The core
    builds the `Building` from it. An importer reports what it found, assumed, repaired and left out as findings with
    their places. Every assumption is a parameter, so that users can change it.
    """

    #: File name extensions that it reads, in lower case, with the dot.
    suffixes: ClassVar[tuple[str, ...]]

    def files(self, path: Path) -> Sequence[Path]:
        """Return the files that `read` reads: this one by default.

        An importer of files that name others returns these as well: a study goes on only where none has changed.

        Parameters
        ----------
        path : Path

        Raises
        ------
        ValueError, BuildingError
            As `read`.
        """
        return (path,)

    @abstractmethod
    def read(self, path: Path) -> "SurfaceMesh | Plan":
        """Read a file, which exists and is not empty.

        Parameters
        ----------
        path : Path

        Returns
        -------
        SurfaceMesh or Plan

        Raises
        ------
        ValueError
            The file is damaged. The message says what is wrong and where; the core adds the name of the file.
        BuildingError
            The content of the file does not form a building; names the file and the place.
        """


def optional_library(path: Path, module: str, extra: str) -> None:
    """Raise an error that says what to install if an optional library is missing."""
    if find_spec(module) is None:
        raise BuildingError(
            f"{path}: reading this file requires {module}, which is not installed: pip install 'evac[{extra}]'"
        )
