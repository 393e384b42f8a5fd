"""Forces at a distance between two people: the base class of force plugins."""

from abc import ABC, abstractmethod
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from evac.parameters import Configurable


class Force(Configurable, ABC):
    """A pair force, evaluated in every sub-step for all pairs closer than its cut-off.

    A subclass names a function compiled with `evac.jit.pair_force` and turns its parameters into
    the float64 array that the function reads.
    """

    #: Function compiled by `evac.jit.pair_force`.
    pair: ClassVar[Any]

    def packed(self) -> NDArray[np.float64]:
        """Return the parameters as the pair function reads them, (p,) float64; by default all declared numbers."""
        return np.array(list(self.values().values()), dtype=np.float64)

    @abstractmethod
    def cutoff(self) -> float:
        """Return the gap [m] beyond which the force is left out."""

    def is_needed(self) -> bool:
        """Return False if the force is zero everywhere, so that it can be left out."""
        return True
