"""The shipped case: its files are those that its script writes, and smoke closes one of its two stairs."""

import subprocess
import sys
from pathlib import Path

import evac
from evac.cli.main import main
from evac.simulation.simulation import Simulation

FOLDER = Path(__file__).parents[2] / "buildings/office_fire"


def test_the_slices_are_those_that_the_script_writes(tmp_path):
    script = tmp_path / "write_slices.py"
    script.write_bytes((FOLDER / "write_slices.py").read_bytes())
    subprocess.run([sys.executable, str(script)], check=True)
    written = {path.name: path.read_bytes() for path in tmp_path.iterdir() if path.suffix in (".smv", ".sf")}
    assert len(written) == 21
    assert written == {name: (FOLDER / name).read_bytes() for name in written}


def test_the_deck_has_the_lines_that_the_command_prints(capsys):
    assert main(["conditions", "deck", "office_fire"]) == 0
    assert capsys.readouterr().out in (FOLDER / "office_fire.fds").read_text()


def test_smoke_closes_one_of_two_stairs_and_everybody_takes_the_other():
    case = evac.load("office_fire", {"directions.spacing": 0.2})
    results = Simulation(case).run()
    used = {name: use["people"] for name, use in results.exits.items()}
    assert used == {"east door": 85, "west door": 0}
    assert results.stairs["west"]["people"] < 10  # who turn back on it
    assert results.conditions["findings"] == []
    assert results.exit_status == 0
