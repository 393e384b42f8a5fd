"""Importers: files of buildings to tagged surfaces. The base class of importer plugins."""

from abc import ABC, abstractmethod
from pathlib import Path
from typing import ClassVar

from evac.building.surfacemesh import SurfaceMesh
from evac.parameters import Configurable


class Importer(Configurable, ABC):
    """Reads the files of one format, or of some, to a `SurfaceMesh`.

    An importer says what stands in the file and interprets nothing: the core makes a building of it.
    """

    #: Endings of the file names that it reads, in lower case, with the dot.
    suffixes: ClassVar[tuple[str, ...]]

    @abstractmethod
    def read(self, path: Path) -> SurfaceMesh:
        """Read a file that is there and not empty.

        Parameters
        ----------
        path : Path

        Returns
        -------
        SurfaceMesh

        Raises
        ------
        ValueError
            The file is damaged. The text says what is wrong and where; the core adds the file's name.
        """
