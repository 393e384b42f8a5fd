"""Base class of forces other than contact forces: between two people, or on one person."""

from abc import ABC, abstractmethod
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from evac.base.parameters import Configurable


class Force(Configurable, ABC):
    """Base class of forces between two people, on one person, or both, which are evaluated in every sub-step.

    A subclass names compiled functions, and packs its parameters into the float64 array that they read.
    """

    #: Force between two people closer than the cut-off, a function compiled by `evac.jit.pair_force`.
    pair: ClassVar[Any] = None

    #: Force on each person, a function compiled by `evac.jit.body_force`.
    body: ClassVar[Any] = None

    def packed(self) -> NDArray[np.float64]:
        """Return the parameters (p,) float64 that the functions read; by default all declared numbers."""
        return np.array(list(self.values().values()), dtype=np.float64)

    @abstractmethod
    def cutoff(self) -> float:
        """Return the gap [m] beyond which people, or walls, have no influence; 0 if the force depends on neither."""

    def is_needed(self) -> bool:
        """Return False if the force is zero everywhere and can be omitted."""
        return True
