"""Importers: files of buildings to tagged surfaces. The base class of importer plugins."""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar

from evac.building.surfacemesh import SurfaceMesh
from evac.errors import BuildingError
from evac.parameters import Configurable

if TYPE_CHECKING:
    from evac.building.plan import Plan


class Importer(Configurable, ABC):
    """Reads the files of one format, or of some, to a `Plan` or a `SurfaceMesh`.

    An importer says what stands in the file: storeys and what joins them, or a surface with tags. The core makes a
    building of it. What an importer found, assumed, repaired or left out, it adds as findings, with their places.
    What it assumes is a parameter of it, so that a user can say otherwise.
    """

    #: Endings of the file names that it reads, in lower case, with the dot.
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
        """Read a file that is there and not empty.

        Parameters
        ----------
        path : Path

        Returns
        -------
        SurfaceMesh or Plan

        Raises
        ------
        ValueError
            The file is damaged. The text says what is wrong and where; the core adds the file's name.
        BuildingError
            What is drawn in it does not make a building; names the file and the place.
        """


def optional_library(path: Path, module: str, extra: str) -> None:
    """Say what to install if a library is missing that only one importer needs.

    Parameters
    ----------
    path : Path
        The file that is to be read.
    module : str
        The library's name when it is imported.
    extra : str
        Of evac, with which the library is installed.

    Raises
    ------
    BuildingError
        It is not installed.
    """
    if find_spec(module) is None:
        raise BuildingError(
            f"{path}: to read it, {module} is needed, which is not installed: pip install 'evac[{extra}]'"
        )
