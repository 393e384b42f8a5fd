"""Sources of the conditions of the air: the quantities that they provide, and the base class of such plugins."""

import math
from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from evac.base.arrays import FloatArray, IntArray
from evac.base.errors import ScenarioError, usable_path
from evac.base.parameters import Configurable, did_you_mean

if TYPE_CHECKING:
    from evac.building.model.building import Building


@dataclass(frozen=True)
class Quantity:
    """A scalar of the air that sources provide."""

    unit: str
    clear: float  #: value of clear air, where no source applies
    least: float  #: least and greatest value
    most: float
    doc: str


def _ppm(doc: str) -> Quantity:
    return Quantity("ppm", 0.0, 0.0, 1e6, doc)


#: All quantities by name. Concentrations are those of volumes.
QUANTITIES = MappingProxyType(
    {
        "extinction": Quantity("1/m", 0.0, 0.0, 1e4, "extinction coefficient K of smoke"),
        "co": _ppm("carbon monoxide"),
        "co2": Quantity("%", 0.0, 0.0, 100.0, "carbon dioxide"),
        "o2": Quantity("%", 20.9, 0.0, 100.0, "oxygen"),
        "hcn": _ppm("hydrogen cyanide"),
        "no": _ppm("nitric oxide"),
        "no2": _ppm("nitrogen dioxide"),
        "hcl": _ppm("hydrogen chloride"),
        "hbr": _ppm("hydrogen bromide"),
        "hf": _ppm("hydrogen fluoride"),
        "so2": _ppm("sulphur dioxide"),
        "acrolein": _ppm("acrolein"),
        "formaldehyde": _ppm("formaldehyde"),
        "temperature": Quantity("C", 20.0, -273.15, 5000.0, "temperature of the air"),
        "radiation": Quantity("kW/m2", 0.0, 0.0, 1e4, "radiative flux onto a surface"),
        "layer": Quantity("m", 1e4, 0.0, 1e4, "height of the layer of smoke above the floor"),
    }
)

IRRITANTS = ("hcl", "hbr", "hf", "so2", "no2", "acrolein", "formaldehyde")  #: The irritant gases.


HEAD = 0.9  #: Height of the head, at which people breathe and see, over that of the body; 1.6 m for a body of 1.78 m.
HOTTEST_START = 150.0  #: Temperature that no fire begins with [C]; values in kelvin are above it.

#: A span between two times is a gap if it is this many times the median, of at least so many spans.
GAP, LEAST_SPANS = 10.0, 3

AT_ONCE = 1e-6  #: Times that differ by less are the same [s].


def gap_in(times: FloatArray) -> str:
    """Return where recorded times (f,) [s] have a gap, in words; empty without one."""
    spans = np.diff(times)
    if len(spans) < LEAST_SPANS or spans.max() <= GAP * np.median(spans):
        return ""
    k, usual = int(spans.argmax()), np.median(spans)
    return f"has no values between {times[k]:g} and {times[k + 1]:g} s, but otherwise every {usual:g} s"


@dataclass(frozen=True)
class SourceScene:
    """What a source may use."""

    building: "Building"
    folder: Path  #: the folder of the case
    settings: Any  #: the table ``[[conditions]]`` of the source
    heads: dict[str, float]  #: mean height of the heads of each group of people above the floor [m]
    needed: tuple[str, ...] = ()  #: the quantities that the case asks for
    #: the files that the values come from, those asked for with `file` and others that a source adds; a run whose files
    #: have changed is not resumed
    files: list[Path] = field(default_factory=list)

    def file(self, name: str) -> Path:
        """Return the path of a data file, relative to the folder of the case."""
        path = usable_path(self.folder / name, ScenarioError)
        if not path.is_file():
            raise ScenarioError(f"{path}: no such file; check the path")
        self.files.append(path)
        return path

    def levels(self) -> list[int]:
        """Return the indices of the levels that the table names, or those of its stairs or its area; all if none."""
        named, levels = self.settings.level, self.building.levels
        if self.settings.area is not None:
            area = self.building.area_named(self.settings.area)
            if area is None:
                hint = did_you_mean(self.settings.area, [area.name for area in self.building.areas])
                raise ScenarioError(f"area: there is no area {self.settings.area!r}; {hint}")
            return [area.level]
        if not named:
            return [level.index for level in levels]
        indices = []
        for name in (named,) if isinstance(named, str) else named:
            own = [part.level for part in self.building.parts_named(name)]
            if not own:
                known = [level.name for level in levels] + [*self.building.stairs, *self.building.shafts]
                raise ScenarioError(f"level: there is no level or stair {name!r}; {did_you_mean(name, known)}")
            indices += own
        return indices


class ConditionSource(Configurable, ABC):
    """Provides quantities of the air at places and times: the base class of such plugins."""

    #: Keys of `[[conditions]]` that it uses, besides ``source``, ``start`` and ``hold``.
    keys: ClassVar[tuple[str, ...]] = ()

    last: float = math.inf  #: time after which there are no values [s]; inf if there are always values
    #: time after which values no longer change [s], or None if that is `last`. Until then, a run does not end because
    #: nobody makes progress.
    changes_until: float | None = None

    @abstractmethod
    def open(self, scene: SourceScene) -> Sequence[str]:
        """Read what is needed before the run, and return the names of the quantities that it provides.

        Parameters
        ----------
        scene : SourceScene
        """

    @abstractmethod
    def at(
        self, quantities: Sequence[str], time: float, level: IntArray, position: FloatArray, height: FloatArray
    ) -> FloatArray:
        """Return the values (q, n) of quantities at places, NaN where the source does not apply.

        Values that are known at some times only are linear in between.

        Parameters
        ----------
        quantities : sequence of str
            Some of those that `open` returned.
        time : float
            Time of the source [s], at most `last`.
        level : (n,) int32
        position : (n, 2) float64 [m]
        height : (n,) float64 [m]
            Height z of each place, that of a head.
        """

    def findings(self) -> Sequence[str]:
        """Return what should be known about the data before a run, such as what they cover, one line each."""
        return ()

    def deck(self, scene: SourceScene) -> Sequence[str]:
        """Return lines for the input of the program that computes the data, as ``evac conditions deck`` prints them."""
        return ()
