"""``python -m evac``, and the program ``evac``."""

import sys


def program() -> int:
    """Run the command line and return its exit status; handles Ctrl-C even while modules are being imported."""
    try:
        from evac.cli import program

        return program()
    except KeyboardInterrupt:
        print("evac: interrupted", file=sys.stderr)
        return 130


if __name__ == "__main__":
    sys.exit(program())
