"""The page of `evac edit` beside a script or a notebook that goes on."""

import html
import tempfile
import threading
from pathlib import Path
from typing import Self

from evac.building.plan.plan import PLAN, Plan
from evac.building.plan.plantable import plan_of, read_table
from evac.case.case import Case
from evac.editor.server import Server
from evac.editor.session import Session


class Page:
    """A served page; notebooks show it in a frame where the browser runs on this machine. A context that ends it."""

    def __init__(self, session: Session) -> None:
        self._server = Server(session, is_framed=True)
        threading.Thread(target=self._server.serve_forever, daemon=True).start()

    @property
    def address(self) -> str:
        """Address of the page, for a browser on this machine; another one after "Save as"."""
        return self._server.address

    @property
    def file(self) -> Path:
        """The plan file, or the case that holds the plan."""
        assert self._server.session is not None
        return self._server.session.file

    @property
    def plan(self) -> Plan:
        """The plan as it was saved last.

        Raises
        ------
        BuildingError
            The plan in the file is not valid.
        """
        table = read_table(self.file)
        is_case = not self.file.name.lower().endswith(PLAN)
        return plan_of(table["building"]["plan"] if is_case else table, self.file, self.file.parent)

    def close(self) -> None:
        """End the page; what is not saved is kept in a journal beside the file."""
        self._server.shutdown()
        self._server.server_close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def __repr__(self) -> str:
        return f"<evac edit {self.file}: {self.address}>"

    def _repr_html_(self) -> str:
        at = html.escape(self.address)
        style = "width: 100%; height: 46rem; border: 1px solid #888"
        frame = f'<iframe src="{at}" title="evac edit" style="{style}"></iframe>'
        return f'<p><a href="{at}" target="_blank">{html.escape(str(self.file))}</a></p>{frame}'


def edit(source: Plan | Case | str | Path, result: str | Path | None = None) -> Page:
    """Serve a page on which a plan is drawn and its case run, as `evac edit` does, and return at once.

    Parameters
    ----------
    source : Plan, Case, str or Path
        A case whose building is a plan, its folder, a plan file, or a plan, which is written to a temporary folder.
    result : str or Path, optional
        Result folder of runs of the case; by default that of `evac run`.

    Returns
    -------
    Page
        Its address; `Page.plan` is the plan as it was saved last.

    Raises
    ------
    EvacError
        The source is not valid, or its building is not a plan.

    Examples
    --------
    >>> page = evac.edit("house")  # doctest: +SKIP
    >>> page.plan.building().exits, page.close()  # doctest: +SKIP
    """
    if isinstance(source, Plan):
        file = Path(tempfile.mkdtemp()) / f"plan{PLAN}"
        source.write(file)
        source = file
    place, plugins = (source.source, source.loaded_files) if isinstance(source, Case) else (Path(source), ())
    return Page(Session(place, None if result is None else Path(result), plugins))
