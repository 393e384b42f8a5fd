"""``python -m evac``, and the program ``evac``."""

import sys


def program() -> int:
    """Be the process of a command and return its exit status; Ctrl-C may come even while modules are imported."""
    try:
        from evac.cli import program

        return program()
    except KeyboardInterrupt:
        print("evac: interrupted", file=sys.stderr)
        return 130


if __name__ == "__main__":
    sys.exit(program())
