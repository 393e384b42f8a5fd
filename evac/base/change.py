"""Changes of a scene during a run: plain records, which are applied by the scene and recorded in the trajectory."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any


@dataclass(frozen=True)
class Change:
    """One change of a scene.

    Attributes
    ----------
    time : float
        Time [s] at which it takes effect: the beginning of a tick.
    kind : str
        ``open`` or ``close`` for exits, portals and stairs.
    what : str
        Name of what changes.
    values : mapping of str to number, str or bool
        What the kind of change needs besides; empty for ``open`` and ``close``.
    """

    time: float
    kind: str
    what: str
    values: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        object.__setattr__(self, "time", float(self.time))
        if not math.isfinite(self.time):
            raise ValueError(f"time of the change {self.kind!r} of {self.what!r}: {self.time} is not a finite number")

    def __str__(self) -> str:
        done = {"open": "opened", "close": "closed"}.get(self.kind, self.kind)
        return f"{self.what!r} {done} at {self.time:g} s"

    def as_row(self) -> dict[str, Any]:
        """Return the change as a dictionary that can be written as JSON."""
        return {"time": self.time, "kind": self.kind, "what": self.what, "values": dict(self.values)}

    @classmethod
    def from_row(cls, row: Any) -> "Change":
        """Return the change that `as_row` has written.

        Raises
        ------
        ValueError
            The row is not such a dictionary.
        """
        match row:
            case {"time": float(time), "kind": str(kind), "what": str(what), "values": dict(values)}:
                return cls(time, kind, what, values)
        raise ValueError(f"{row!r:.100} is not a change")
