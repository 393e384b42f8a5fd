"""Pictures of plans that lie under storeys while one draws: kept beside the file, with where they are."""

import base64
import json
import math
import threading
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

from evac.base.errors import ScenarioError
from evac.folder.files import content_of
from evac.folder.textfiles import write_json

#: Ending of the name of the file with the pictures.
PICTURES = ".pictures"
#: First bytes of the formats that are shown, which browsers draw without executing anything.
SIGNS = (b"\x89PNG\r\n\x1a\n", b"\xff\xd8\xff")
MOST_BYTES = 20_000_000


class Pictures:
    """The pictures of the storeys of a file: of each, its content, its lower left corner and its width [m]."""

    def __init__(self, file: Path) -> None:
        self.file, self._lock = file.with_name(file.name + PICTURES), threading.Lock()

    def all(self) -> dict[str, Any]:
        """Return the pictures by storey; none if the file is not valid."""
        with suppress(OSError, ValueError, AttributeError, ScenarioError, LookupError, TypeError):
            return {storey: _checked(row) for storey, row in json.loads(content_of(self.file)).items()}
        return {}

    def put(self, storey: str, given: Mapping[str, Any] | None) -> dict[str, Any]:
        """Keep the picture of a storey, or only where it is if its ``data`` is not given; None takes it away.

        Raises
        ------
        EvacError
            It is neither PNG nor JPEG, or too large, or it is nowhere; or the file cannot be written.
        """
        with self._lock:
            rows = self.all()
            if given is None:
                rows.pop(storey, None)
            else:
                rows[storey] = _checked({**rows.get(storey, {}), **given})
            if rows:
                write_json(self.file, rows, "the pictures")
            else:
                self.file.unlink(missing_ok=True)
        return {"storeys": list(rows)}


def _checked(row: Mapping[str, Any]) -> dict[str, Any]:
    data, at, width = str(row["data"]), [float(value) for value in row["at"]], float(row["width"])
    content = base64.b64decode(data, validate=True)
    if not content.startswith(SIGNS) or len(content) > MOST_BYTES:
        raise ScenarioError(f"this is no PNG or JPEG of at most {MOST_BYTES // 1_000_000} MB; save the picture as one")
    if len(at) != 2 or not all(map(math.isfinite, [*at, width])) or width <= 0.0:
        raise ScenarioError("a picture needs a place and a width above 0 m")
    return {"data": data, "at": at, "width": width}
