"""The command that shows a plan to draw on: evac edit."""

import argparse
from contextlib import suppress
from pathlib import Path

from evac.cli.inputs import declare_plugin
from evac.cli.screen import note, say, show_facts


def declare_edit(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of `evac edit`."""
    what = "a case.toml, a folder that contains one, or a plan file (.plan.toml)"
    what += "; without it, the page asks what to begin with, and makes a case in the current folder"
    parser.add_argument("case", metavar="CASE|PLAN", type=Path, nargs="?", help=what)
    parser.add_argument("--out", type=Path, metavar="DIR", help="result folder of runs (default: ./CASE-result)")
    declare_plugin(parser)
    parser.add_argument("--no-browser", action="store_true", help="print the address of the page, and open no browser")


def execute_edit(arguments: argparse.Namespace) -> int:
    """Draw a plan in the browser, storey by storey, choose its people, see what evac check says, and run it.

    The page is served on this machine alone, at an address that nobody else knows. Saving changes only the touched
    lines of the file; comments stay. What is not saved is kept in a journal beside the file (.unsaved), and found again
    when the plan is opened. Ends with Ctrl-C, or two minutes after the page was closed.
    """
    from evac.editor import Server, Session

    def tell(server: Server) -> None:
        plan = {} if server.session is None else {"plan": server.session.file}
        show_facts({**plan, "address": server.address})

    plugins = [*map(Path, arguments.plugins)]
    session = None if arguments.case is None else Session(arguments.case, arguments.out, plugins)
    with Server(session, told=tell) as server:
        tell(server)
        note("Ctrl-C ends; so does closing the page, after some time")
        with suppress(KeyboardInterrupt):
            server.serve(not arguments.no_browser)
    if server.session is not None and server.session.journal.exists():
        say(f"not saved, kept for the next time: {server.session.journal}")
    return 0
