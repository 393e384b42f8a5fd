"""Base class of forces at a distance between two people."""

from abc import ABC, abstractmethod
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from evac.parameters import Configurable


class Force(Configurable, ABC):
    """Base class of pair forces, which are evaluated in every sub-step for all pairs closer than their cut-off.

    A subclass names a function compiled with `evac.jit.pair_force`, and packs its parameters into
    the float64 array that the function reads.
    """

    #: Function compiled by `evac.jit.pair_force`.
    pair: ClassVar[Any]

    def packed(self) -> NDArray[np.float64]:
        """Return the parameters (p,) float64 that the pair function reads; by default all declared numbers."""
        return np.array(list(self.values().values()), dtype=np.float64)

    @abstractmethod
    def cutoff(self) -> float:
        """Return the gap [m] beyond which the force is neglected."""

    def is_needed(self) -> bool:
        """Return False if the force is zero everywhere and can be omitted."""
        return True
