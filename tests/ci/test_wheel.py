"""The wheel with compiled kernels that .ci/wheel.py builds."""

import base64
import csv
import hashlib
import importlib.util
import sys
import zipfile
from pathlib import Path

import pytest

from evac.base.errors import EvacError


@pytest.fixture(scope="module")
def wheels():
    """The script as a module."""
    spec = importlib.util.spec_from_file_location("wheels", Path(__file__).parents[2] / ".ci/wheel.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture
def pure_wheel(tmp_path):
    """A wheel of pure Python with two files."""
    path = tmp_path / "evac-9.9-py3-none-any.whl"
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("evac/__init__.py", "VERSION = 9\n")
        archive.writestr("evac-9.9.dist-info/WHEEL", "Wheel-Version: 1.0\nRoot-Is-Purelib: true\nTag: py3-none-any\n\n")
        archive.writestr("evac-9.9.dist-info/RECORD", "stale,,\n")
    return path


def test_a_wheel_with_kernels_tells_what_is_in_it_and_where_it_fits(wheels, pure_wheel, monkeypatch, tmp_path):
    def compile_kernels(command, failure, code):
        (code / "evac" / "kernels").mkdir()
        (code / "evac" / "kernels" / "a.kernel").write_bytes(b"code")

    monkeypatch.setattr(wheels, "_run", compile_kernels)
    wheel = wheels.build_wheel(pure_wheel, tmp_path / "out")
    python = f"cp{sys.version_info.major}{sys.version_info.minor}-none-"
    assert wheel.parent == tmp_path / "out"
    assert wheel.name.startswith(f"evac-9.9-{python}")
    with zipfile.ZipFile(wheel) as archive:
        about = archive.read("evac-9.9.dist-info/WHEEL").decode().splitlines()
        assert about.count("Root-Is-Purelib: false") == 1
        assert [line for line in about if line.startswith("Tag:")] == [f"Tag: {wheel.stem.partition('9.9-')[2]}"]
        rows = list(csv.reader(archive.read("evac-9.9.dist-info/RECORD").decode().splitlines()))
        assert [row[0] for row in rows] == archive.namelist()
        for name, digest, size in rows[:-1]:
            content = archive.read(name)
            expected = base64.urlsafe_b64encode(hashlib.sha256(content).digest()).decode().rstrip("=")
            assert (digest, int(size)) == (f"sha256={expected}", len(content))
        assert rows[-1] == ["evac-9.9.dist-info/RECORD", "", ""]
    again = wheels.build_wheel(pure_wheel, tmp_path / "again")
    assert again.read_bytes() == wheel.read_bytes()


def test_what_is_neither_sources_nor_a_wheel_is_refused(wheels, tmp_path):
    (tmp_path / "evac.whl").write_text("no archive")
    with pytest.raises(EvacError, match=r"evac\.whl"):
        wheels.build_wheel(tmp_path / "evac.whl", tmp_path)


def test_a_wheel_whose_kernels_cannot_be_compiled_is_not_made(wheels, pure_wheel, tmp_path):
    with zipfile.ZipFile(pure_wheel, "a") as archive:
        archive.writestr("evac/cli/__init__.py", "raise ImportError")
    with pytest.raises(EvacError, match="cannot be compiled"):
        wheels.build_wheel(pure_wheel, tmp_path / "out")
    assert not (tmp_path / "out").exists()
