"""evac plugins --check, and plugins that interfere with the process they run in."""

import re
import subprocess
import sys
from pathlib import Path

import pytest

import evac as evac_package
from tests.conformance.mistakes import DO, WRITE
from tests.conformance.sound import BEHAVIOUR, EXPORTER

LATE = (
    BEHAVIOUR.replace(DO, "crowd.speed_factor[:] *= self.share if time > self.factor else 1.0")
    + """

@hookimpl
def evac_metrics(results):
    return {}
"""
)
PREPARE = """    def prepare(self, scene):
        self.share = float(scene.file("share.txt").read_text())
    def unused(self):
        return 1
    def state(self):
        return {}
    def act"""


def test_a_plugin_with_data_is_checked_in_its_case_which_says_what_ran_and_what_had_no_effect(evac, capsys):
    """The behaviour acts from a time on, by a share in a file of the case."""
    Path("late.py").write_text(LATE.replace("    def act", PREPARE).replace("maximum=1.0", "maximum=99.0"))
    square = evac_package.load("square_room", {"people.people.number": 4, "simulation.duration": 5.0})
    square.write("own.toml")
    Path("square_room.msh").write_bytes(square.mesh.read_bytes())
    Path("share.txt").write_text("0.25")
    Path("own.toml").write_text(Path("own.toml").read_text() + "\n[behaviours.tried]\nfactor = 99.0\n")
    assert evac("plugins", "--check", "late.py") == 2  # the shipped case has no such file
    assert "share.txt" in capsys.readouterr().err
    assert evac("plugins", "--check", "late.py", "--case", "own.toml") == 0
    said = capsys.readouterr().out
    assert re.search(r"^behaviour tried: prepare ran once$", said, re.MULTILINE)
    assert re.search(r"^behaviour tried: act ran \d+ times$", said, re.MULTILINE)
    assert re.search(r"^behaviour tried: unused never ran$", said, re.MULTILINE)
    assert "behaviour tried: had no effect" in said
    Path("own.toml").write_text(Path("own.toml").read_text().replace("factor = 99.0", "factor = 1.0"))
    assert evac("plugins", "--check", "late.py", "--case", "own.toml") == 0
    assert "no effect" not in capsys.readouterr().out
    assert evac("plugins", "--check", "late.py", "--case", "square_room") == 2


CLOSING = """
from evac import Change, hookimpl
evac_interface = 3


@hookimpl
def evac_prepare(simulation):
    simulation.scene.apply(Change(1.0, "close", "door"))
    simulation.scene.apply(Change(2.0, "open", "door"))
"""


def test_hooks_are_named_and_hide_no_class_of_their_file(evac, capsys):
    Path("closing.py").write_text(BEHAVIOUR + CLOSING)
    assert evac("plugins", "--check", "closing.py") == 0
    lines = capsys.readouterr().out.splitlines()
    assert [line.partition(":")[0] for line in lines] == ["behaviour tried", "hook evac_prepare"]
    Path("closing.py").write_text(BEHAVIOUR.replace(DO, "self.count = time") + CLOSING)
    assert evac("plugins", "--check", "closing.py") == 2


def test_a_run_says_what_a_hook_has_changed(evac, capsys):
    Path("closing.py").write_text(CLOSING)
    assert evac("run", "square_room", "--plugin", "closing.py", "--set", "output.replay=false") == 0
    assert re.search(r"^Changes: 'door' closed at 1 s; 'door' opened at 2 s *$", capsys.readouterr().out, re.MULTILINE)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (BEHAVIOUR.replace(DO, "self.count = time"), "tried: check_same_bits, .* state"),
        (EXPORTER.replace(WRITE, "        return [path]\n"), "tried: check_exports, .*which is no path"),
        (BEHAVIOUR.replace("crowd, time)", "crowd)"), r"plugin odd\.py: Slow defines act\(self, crowd\)"),
    ],
)
def test_a_failed_check_is_one_line_and_status_2(evac, text, words, capsys):
    Path("odd.py").write_text(text)
    assert evac("plugins", "--check", "odd.py") == 2
    said = capsys.readouterr()
    assert said.out == ""
    (line,) = said.err.splitlines()
    assert re.search(rf"^evac: {words}", line), line
    assert re.search(rf"\({Path('odd.py').resolve()}, line \d+\); ", line), line


#: What a plugin does to the process, and the status and the text of the only line that begins with "evac: ".
INTERFERES = {
    "sys.stderr = object()": (2, "replaces sys.stdout or sys.stderr", "restore it"),
    "sys.stdout.close()": (3, "people still inside", ""),
}


@pytest.mark.parametrize("code", INTERFERES)
def test_what_a_plugin_does_to_the_process_is_told_in_one_line(code, tmp_path):
    status, wrong, remedy = INTERFERES[code]
    (tmp_path / "odd.py").write_text(BEHAVIOUR.replace(DO, code).replace("import numpy as np", "import os, sys"))
    words = ["run", "square_room", "--plugin", "odd.py", "--out", "result", "--set", "behaviours.tried={}"]
    command = [sys.executable, "-P", "-m", "evac", *words, "simulation.duration=1", "output.replay=false"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == status, done.stderr
    (line,) = [line for line in done.stderr.splitlines() if line.startswith("evac: ") and "bodies in" not in line]
    assert wrong in line
    assert remedy in line
    assert "Traceback" not in done.stderr
    if status == 3:
        assert "results in" in done.stdout


def test_a_plugin_by_name_is_shown_alone_and_all_are_listed_with_their_files(evac, capsys):
    assert evac("plugins", "nsm2") == 0
    alone = capsys.readouterr().out
    assert "evac_plugins.contact_nsm2" in alone
    assert "contact_nsm1" not in alone
    assert evac("plugins", "--verbose") == 0
    listed = capsys.readouterr().out
    assert {"contact_nsm1", "contact_nsm2", "import_dxf"} <= set(re.findall(r"evac_plugins\.(\w+)", listed))
    assert evac("plugins") == 0
    lines = capsys.readouterr().out.splitlines()
    assert sum(line.startswith("contact model nsm2: ") for line in lines) == 1
    assert evac("plugins", "nsm3") == 2
    assert "did you mean 'nsm" in capsys.readouterr().err
