"""The memory by which threads take turns."""

from typing import Annotated

import numpy as np
from numpy.typing import NDArray

from evac.jit import Floats, Longs, Struct
from evac.jit.layout import Array

Counts = Annotated[NDArray[np.int64], Array("int64", (None, 8))]


class Team(Struct):
    """Threads that share the phases of a step, see `evac.physics.threads.team`.

    Rows are 64 bytes apart, the size of a line of the caches.
    """

    threads: int
    rest: int  # address of the system's function that sleeps
    turn: Longs  # (8 threads,) word of a phase: of thread 0 that to be done, of the others the last one done
    begun: Longs  # (8 blocks,) word of the last phase in which a thread has begun with a block
    made: Longs  # (8 blocks,) word of the last phase that was made on a block
    found: Counts  # (threads, 8) what each has found, see `evac.physics.threads.pieces`
    fastest: Floats  # (8 threads,) [m/s]
