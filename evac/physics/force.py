"""Forces besides contact: the base class of force plugins."""

from abc import ABC, abstractmethod
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from evac.parameters import Configurable


class Force(Configurable, ABC):
    """A force between two people, on one person, or both, evaluated in every sub-step.

    A subclass names compiled functions and turns its parameters into the float64 array that they read.
    """

    #: Force between two people closer than the cut-off, a function compiled by `evac.jit.pair_force`.
    pair: ClassVar[Any] = None

    #: Force on each person, a function compiled by `evac.jit.body_force`.
    body: ClassVar[Any] = None

    def packed(self) -> NDArray[np.float64]:
        """Return the parameters as the functions read them, (p,) float64; by default all declared numbers."""
        return np.array(list(self.values().values()), dtype=np.float64)

    @abstractmethod
    def cutoff(self) -> float:
        """Return the gap [m] from which on people do not feel each other, or a wall; 0 if they feel neither."""

    def is_needed(self) -> bool:
        """Return False if the force is zero everywhere, so that it can be left out."""
        return True
