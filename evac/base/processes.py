"""Worker processes that import modules as this process does, but not its main script."""

import json
import os
import subprocess
import sys
from collections.abc import Iterable
from contextlib import suppress

# Ctrl-C reaches all processes; the one that started the others handles it.
_BOOTSTRAP = (
    "import json, signal, sys; signal.signal(signal.SIGINT, signal.SIG_IGN);"
    " sys.path[:] = json.loads(sys.argv[1]); from {module} import serve; serve()"
)


def start_worker(module: str, is_quiet: bool = True) -> subprocess.Popen[bytes]:
    """Start a process that calls the function ``serve()`` of a module, with pipes to its standard input and output.

    Parameters
    ----------
    module : str
    is_quiet : bool
        Whether its standard error is discarded; else it is that of this process, if that is open.

    Raises
    ------
    OSError
        The process cannot be started.
    """
    if not sys.executable or getattr(sys, "frozen", False):
        raise OSError("this program is not started by an interpreter of Python")
    folders = json.dumps([os.path.abspath(folder) for folder in sys.path])
    return subprocess.Popen(
        [sys.executable, "-P", "-c", _BOOTSTRAP.format(module=module), folders],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL if is_quiet or not _is_open(2) else None,
    )


def _is_open(descriptor: int) -> bool:
    """Return whether a file descriptor is open."""
    try:
        os.fstat(descriptor)
    except OSError:
        return False
    return True


def kill_workers(workers: Iterable[subprocess.Popen[bytes]]) -> None:
    """End processes at once; threads that read from them find the end of the stream."""
    for worker in workers:
        worker.kill()
    for worker in workers:
        worker.wait()


def close_pipes(workers: Iterable[subprocess.Popen[bytes]]) -> None:
    """Close the pipes to processes that have ended."""
    for worker in workers:
        for pipe in (worker.stdin, worker.stdout):
            with suppress(OSError):
                pipe.close()  # type: ignore[union-attr]
