"""Changes of a scene during a run: plain records, which are applied by the scene and recorded in the trajectory."""

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

    def as_row(self) -> dict[str, Any]:
        """Return the change as a dictionary that can be written as JSON."""
        return {"time": self.time, "kind": self.kind, "what": self.what, "values": dict(self.values)}
