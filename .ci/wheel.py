"""Build a wheel with compiled kernels: a pure Python wheel, to which kernels compiled from the code in it are added.

Usage: ``python .ci/wheel.py SOURCE OUT``, with evac installed: SOURCE is the folder of the sources or a wheel of them.
"""

import base64
import hashlib
import json
import os
import shutil
import subprocess
import sys
import sysconfig
import tempfile
import zipfile
from pathlib import Path

from evac.base.errors import EvacError

#: Folder of the kernels in a wheel.
FOLDER = "evac/kernels"

#: Option with which this script is called to compile the kernels of an unpacked wheel.
INTO = "--into"


def build_wheel(source: Path, out: Path) -> Path:
    """Build a wheel for this version of Python and this system, with kernels for the generic processor.

    Parameters
    ----------
    source : Path
        Folder of evac's sources, or a wheel built from them.
    out : Path
        Folder for the wheel.

    Returns
    -------
    Path
        Path of the wheel.

    Raises
    ------
    EvacError
        The sources cannot be built, or a kernel cannot be compiled.
    """
    with tempfile.TemporaryDirectory() as temporary:
        place = Path(temporary)
        if source.is_dir():
            # From a copy, since setuptools leaves files in the sources, and adds files found there to the wheel.
            left_out = shutil.ignore_patterns(".git", "build", "*.egg-info", "__pycache__")
            sources = shutil.copytree(source, place / "sources", ignore=left_out)
            options = ["--quiet", "--no-deps", "--wheel-dir", str(place)]
            _run([sys.executable, "-m", "pip", "wheel", *options, str(sources)], "the sources cannot be built")
            source = next(place.glob("evac-*.whl"))
        code = place / "code"
        try:
            with zipfile.ZipFile(source) as archive:
                archive.extractall(code)
        except (OSError, zipfile.BadZipFile) as error:
            raise EvacError(f"{source}: neither a folder of sources nor a wheel ({error})") from error
        _run([sys.executable, "-P", __file__, INTO, str(code)], "the kernels cannot be compiled", code)
        return _pack(code, out)


def compile_into(code: str) -> None:
    """Compile all kernels of the imported evac for the generic processor into the folder of an unpacked wheel."""
    import evac
    from evac.base.display import Display
    from evac.cli.plugins import all_entries
    from evac.contract.registry import Registry
    from evac.jit.digest import digest_of, versions
    from evac.jit.loading import Compilation, compile_missing, generic
    from evac.jit.store import Store

    if not Path(evac.__file__).is_relative_to(code):
        raise EvacError(f"evac was imported from {evac.__file__}, not from the wheel; use a virtual environment")
    folder, processor = Path(code, FOLDER), generic()
    with Display() as display:
        Registry()
        entries = [entry for entry in all_entries() if entry.label.startswith(("evac.", "evac_plugins."))]
        tasks = [Compilation(entry, digest_of(entry, f"{processor}")) for entry in entries]
        compile_missing(tasks, processor, Store(folder), display.compiling)
    about = {"processor": processor.name, "triple": processor.triple, "versions": versions()}
    (folder / "about.json").write_text(json.dumps(about) + "\n", encoding="utf-8")


def _run(command: list[str], failure: str, code: Path | None = None) -> None:
    """Run a process with the folder `code` first on its import path; raise an EvacError if it fails."""
    environment = os.environ | ({"PYTHONPATH": str(code)} if code else {})
    done = subprocess.run(command, env=environment, stdout=subprocess.PIPE, text=True, check=False)
    if done.returncode:
        raise EvacError(f"{failure}: {done.stdout.strip() or 'see above'}")


def _pack(code: Path, out: Path) -> Path:
    """Write a wheel with the files in a folder, the tags of this Python and system, and a RECORD."""
    info = next(code.glob("*.dist-info"))
    platform = sysconfig.get_platform().replace("-", "_").replace(".", "_")
    tag = f"cp{sys.version_info.major}{sys.version_info.minor}-none-{platform}"
    lines = (info / "WHEEL").read_text(encoding="utf-8").splitlines()
    kept = [line for line in lines if line and not line.startswith(("Tag:", "Root-Is-Purelib:"))]
    (info / "WHEEL").write_text("\n".join([*kept, "Root-Is-Purelib: false", f"Tag: {tag}", ""]), encoding="utf-8")
    record = info / "RECORD"
    files = sorted(path for path in code.rglob("*") if path.is_file() and path != record)
    rows = [f"{path.relative_to(code).as_posix()},{_hash(path)},{path.stat().st_size}" for path in files]
    record.write_text("\n".join([*rows, f"{record.relative_to(code).as_posix()},,", ""]), encoding="utf-8")
    out.mkdir(parents=True, exist_ok=True)
    wheel = out / f"{info.name.removesuffix('.dist-info')}-{tag}.whl"
    with zipfile.ZipFile(wheel, "w", zipfile.ZIP_DEFLATED) as archive:
        for path in [*files, record]:
            # A fixed date, so that the same sources give the same wheel.
            entry = zipfile.ZipInfo(path.relative_to(code).as_posix(), (1980, 1, 1, 0, 0, 0))
            entry.external_attr, entry.compress_type = 0o644 << 16, zipfile.ZIP_DEFLATED
            archive.writestr(entry, path.read_bytes())
    return wheel


def _hash(path: Path) -> str:
    return "sha256=" + base64.urlsafe_b64encode(hashlib.sha256(path.read_bytes()).digest()).decode().rstrip("=")


if __name__ == "__main__":
    if sys.argv[1] == INTO:
        compile_into(sys.argv[2])
    else:
        print(build_wheel(Path(sys.argv[1]), Path(sys.argv[2])))
