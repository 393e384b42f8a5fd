"""`evac edit`: a page on which a plan is drawn, judged and saved."""

from evac.editor.server import Server, edit
from evac.editor.session import Session

__all__ = ["Server", "Session", "edit"]
