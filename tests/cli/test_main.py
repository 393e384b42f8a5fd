"""The parser, errors, and what is imported."""

import os
import platform
import subprocess
import sys
from importlib.metadata import version
from unittest.mock import Mock

import pytest

from evac.base.errors import SimulationError
from evac.cli.main import COMMANDS, main
from evac.cli.screen import PACKAGES


def test_help_names_every_command(capsys):
    with pytest.raises(SystemExit, match="0"):
        main(["--help"])
    out = capsys.readouterr().out
    assert all(f"    {name}" in out for name in COMMANDS)


def test_the_version_names_what_a_report_of_a_fault_needs(capsys):
    with pytest.raises(SystemExit, match="0"):
        main(["--version"])
    own, packages, python, system = capsys.readouterr().out.splitlines()
    assert own == f"evac {version('evac')}"
    assert packages.split(", ") == [f"{name} {version(name)}" for name in PACKAGES]
    assert python.startswith(f"Python {platform.python_version()}")
    assert system == platform.platform()


def test_wrong_words_give_status_2(capsys):
    for words in ([], ["fly"], ["export", "r", "--to"], ["run", "square_room", "--seed", "x"]):
        with pytest.raises(SystemExit, match="2"):
            main(words)
    assert "usage" in capsys.readouterr().err


def test_status_of_errors(monkeypatch, capsys):
    monkeypatch.setattr("evac.cli.cases.execute_list", Mock(side_effect=SimulationError("no step")))
    assert main(["list"]) == 2
    assert capsys.readouterr().err == "evac: no step\n"


#: A command that Ctrl-C ends, with a note, and another Ctrl-C while the first one goes up.
TWICE = """
import sys
import evac.cli.cases
from evac.cli import program

def interrupted(arguments):
    error = KeyboardInterrupt()
    error.add_note("without egress.png")
    try:
        raise error
    finally:
        raise KeyboardInterrupt

evac.cli.cases.execute_list = interrupted
sys.argv = ["evac", "list"]
sys.exit(program())
"""


def test_a_second_ctrl_c_does_not_silence_the_first():
    process = subprocess.run([sys.executable, "-c", TWICE], capture_output=True, text=True)
    assert (process.returncode, process.stderr) == (130, "evac: interrupted\nwithout egress.png\n")


#: What draws, writes and converts, and parts of scipy that a quarter of a second is too much for.
DRAWING = ("matplotlib", "PIL", "pyvista", "vtkmodules", "imageio", "jinja2")
SCIENCE = (
    "scipy.ndimage",
    "scipy.sparse",
    "scipy.spatial",
    "scipy.special",
    "scipy.stats",
    "scipy.optimize",
    "pandas",
    "networkx",
    "pyarrow.compute",
)
PROCESSES = ("multiprocessing", "concurrent.futures.process", "asyncio")
EVERYTHING = (*DRAWING, *SCIENCE, *PROCESSES, "scipy", "skfmm", "shapely", "meshio", "numba")

PARTS = "evac.simulation.lifts", "evac.directions.march.waves"

BARE = ["--set", "output.picture=false", "output.animation=false", "simulation.duration=1"]


#: Commands, which one process makes one after the other, and what none up to each imports.
IMPORTING = (
    (None, (*EVERYTHING, "numpy", "pydantic", "rich", "pluggy")),
    (["list"], (*EVERYTHING, "numpy", "pydantic")),
    (["check", "square.obj"], (*DRAWING, *SCIENCE, *PROCESSES, "meshio", "numba")),
    (["check", "square_room"], (*DRAWING, *SCIENCE, *PROCESSES, "numba")),
    (["run", "square_room", *BARE], (*DRAWING, *SCIENCE, *PROCESSES, "numba", *PARTS)),
    (["run", "square_room", "--set", "simulation.duration=1"], (*SCIENCE, *PROCESSES, "pyvista", "vtkmodules")),
)
IMPORT = """
import sys
import evac
for words, absent in {commands}:
    if words:
        from evac.cli import main
        main(words)
    print("imported:", words, *(set(absent) & set(sys.modules)))
"""


def test_nothing_is_imported_that_a_command_does_not_use(tmp_path):
    (tmp_path / "square.obj").write_text("v 0 0 0\nv 4 0 0\nv 4 4 0\nv 0 4 0\ng floor:a\nf 1 2 3 4\ng exit:b\nl 1 2\n")
    words = [sys.executable, "-c", IMPORT.format(commands=IMPORTING)]
    runs = (subprocess.run(words, cwd=tmp_path, capture_output=True, text=True, check=True) for _ in range(2))
    wanted = [f"imported: {words}" for words, _ in IMPORTING]
    told = ([line for line in run.stdout.splitlines() if line.startswith("imported:")] for run in runs)
    assert any(lines == wanted for lines in told)  # the first one may compile kernels


LONG = "x" * 300


@pytest.mark.skipif(os.name == "nt", reason="links and removed folders of POSIX")
@pytest.mark.parametrize(
    "words",
    [
        *(("check", LONG), ("run", "square_room", "--out", "x" * 250), ("new", LONG), ("map", LONG)),
        *(("run", "square_room", "--out", "loop"), ("resume", "loop"), ("map", "loop"), ("report", "loop")),
        ("run", "square_room", "--plugin", "loop"),
    ],
)
def test_long_names_and_links_to_themselves_are_refused_in_one_line(evac, tmp_path, words, capsys):
    (tmp_path / "loop").symlink_to("loop")
    assert (
        evac(*words, *(("--set", "simulation.duration=0.1", "output.picture=false") if words[0] == "run" else ())) == 2
    )
    (line,) = [one for one in capsys.readouterr().err.splitlines() if one.startswith("evac: ")]
    assert words[-1] in line
    assert "internal" not in line
    assert not list(tmp_path.glob("evac-crash*"))


def test_settings_of_matplotlib_in_the_current_folder_neither_steer_nor_break_pictures(tmp_path):
    (tmp_path / "matplotlibrc").write_bytes(b"font.size: 40\nsavefig.dpi: 20000\n# \xff\xfe\n")
    words = ["check", "square_room", "--picture"]
    command = [sys.executable, "-m", "evac", *words, "levels.png"]
    subprocess.run(command, cwd=tmp_path, capture_output=True, check=True, timeout=120)
    assert main([*words, str(tmp_path / "here.png")]) == 0
    assert (tmp_path / "levels.png").read_bytes() == (tmp_path / "here.png").read_bytes()
