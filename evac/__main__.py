"""``python -m evac``."""

import sys

from evac.cli import program

if __name__ == "__main__":
    sys.exit(program())
