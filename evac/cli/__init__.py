"""The command line: the only part of evac that prints and exits."""

from evac.cli.main import main as main
from evac.cli.main import program as program
