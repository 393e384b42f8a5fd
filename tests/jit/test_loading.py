"""From entries to machine code: what is compiled, where, and what happens if it cannot be kept."""

import os
import re
import subprocess
import sys
import textwrap
import time
from importlib.metadata import requires
from pathlib import Path

import numpy as np
import pytest

from evac.base.errors import CacheWarning, EvacError
from evac.contract.registry import _module_of
from evac.jit import loading, store
from evac.jit.kernels import entries_of
from evac.jit.loading import Compilation, addresses_of, compile_tasks, divide, host
from evac.jit.store import digest_of

SOURCE = """
    from evac.jit import Floats, inner, kernel

    OFFSET = {offset}

    @inner
    def shifted(x):
        return x + OFFSET

    @kernel
    def total(numbers: Floats) -> float:
        found = 0.0
        for k in range(len(numbers)):
            found += shifted(numbers[k])
        return found

    @kernel
    def difference(a: float, b: float) -> float:
        return shifted(a) - b

    @kernel
    def product(a: float, b: float) -> float:
        return shifted(a) * b
"""


@pytest.fixture(autouse=True)
def own_cache(monkeypatch, tmp_path):
    """Every test has an empty cache, and warnings that nobody has seen."""
    monkeypatch.setenv("EVAC_CACHE_DIR", str(tmp_path / "cache"))
    monkeypatch.setattr(store, "_warned", set())
    return tmp_path / "cache" / "kernels"


@pytest.fixture
def plugin(tmp_path):
    """Return the module of a plugin's file that differs from those of all other tests."""
    plugin.number += 1
    path = tmp_path / "mine.py"
    path.write_text(textwrap.dedent(SOURCE.format(offset=1000.0 * os.getpid() + plugin.number)), encoding="utf-8")
    module = _module_of(path, path.read_bytes())
    yield module
    del sys.modules[module.__name__]


plugin.number = 0


@pytest.mark.parametrize("settings", ["opt: [1,", "disable_jit: 1"])
def test_settings_of_numba_in_the_current_folder_neither_steer_nor_break_compilation(tmp_path, own_cache, settings):
    (tmp_path / ".numba_config.yaml").write_text(settings)
    (tmp_path / "mine.py").write_text(textwrap.dedent(SOURCE.format(offset=3.0)), encoding="utf-8")
    script = "import mine; print(mine.product(2.0, 5.0)); import numba; print(numba.config.DISABLE_JIT)"
    words = [sys.executable, "-c", script]
    done = subprocess.run(words, cwd=tmp_path, capture_output=True, text=True, timeout=120, check=True)
    assert done.stdout.split() == ["25.0", "0"]
    assert len(list(own_cache.glob("*"))) >= 1


def test_versions_of_numba_that_are_not_tried_are_refused_with_the_command_that_installs_one(plugin, monkeypatch):
    least, above = (".".join(map(str, numbers)) for numbers in loading.NUMBA)
    (required,) = (one for one in requires("evac") if one.startswith("numba"))
    assert required == f"numba<{above},>={least}"
    for other in (above + ".0rc1", "0.61.2"):
        monkeypatch.setattr(loading, "version", lambda _, other=other: other)
        with pytest.raises(EvacError, match=re.escape(f'pip install "numba>={least},<{above}"')):
            addresses_of(entries_of(plugin), None)


@pytest.fixture
def processes(started, monkeypatch):
    """Let starting a process seem free, so that one is used beside this one; return those that are started."""
    monkeypatch.setattr(loading, "_START", 0)
    monkeypatch.setattr(loading, "cores", lambda: 2)
    return started


def _check(module):
    offset = module.OFFSET
    assert module.total(np.array([1.0, 2.0])) == 3.0 + 2 * offset
    assert module.difference(5.0, 3.0) == 5.0 + offset - 3.0


def _forget(module):
    """Let nothing be loaded, as at the start of a process."""
    for entry in entries_of(module):
        entry._address, entry._call = 0, None
    loading._addresses.clear()


def test_kernels_are_compiled_in_processes_that_end(plugin, processes, own_cache):
    told = []
    addresses_of(entries_of(plugin), lambda done, kernels: told.append((done, kernels)))
    assert len(processes) == 1
    assert all(process.exitcode is not None for process in processes)
    assert len(list(own_cache.iterdir())) == 3
    assert [told[0], told[-1]] == [(0, 3), (3, 3)]
    assert sorted(told) == told
    _check(plugin)


def test_kernels_that_are_the_same_are_compiled_once(tmp_path, processes, own_cache):
    path = tmp_path / "alike.py"
    path.write_text(
        textwrap.dedent(
            f"""
            from evac.jit import pair_force

            def made(factor):
                @pair_force
                def force(gap, nx, ny, vx, vy, ex, ey, parameters):
                    return factor * nx, {os.getpid()} * ny

                return force

            soft, hard, other = made(1.0), made(1.0), made(2.0)
            """
        ),
        encoding="utf-8",
    )
    module = _module_of(path, path.read_bytes())
    addresses_of([module.soft, module.hard, module.other])
    del sys.modules[module.__name__]
    assert len(list(own_cache.iterdir())) == 2 * len(processes) == 2
    assert module.soft.address == module.hard.address != module.other.address


def test_what_is_on_disk_is_not_compiled(plugin, own_cache):
    addresses_of(entries_of(plugin))
    loaded = sorted(own_cache.iterdir())
    _forget(plugin)
    addresses_of(entries_of(plugin), lambda done, kernels: pytest.fail("compiles"))
    assert sorted(own_cache.iterdir()) == loaded
    _check(plugin)


def test_the_machine_code_does_not_depend_on_where_it_is_compiled(plugin, processes):
    tasks = [Compilation(entry, digest_of(entry, f"{host()}")) for entry in entries_of(plugin)]
    elsewhere = dict(compile_tasks(tasks, None))
    assert len(processes) == 1
    here = {task: loading._compile_here(task, None)[0] for task in reversed(tasks)}
    assert elsewhere == here


@pytest.mark.parametrize("interrupted_at", ["told", "loaded"])
def test_ctrl_c_leaves_no_processes(plugin, processes, monkeypatch, interrupted_at):
    def interrupt(*arguments):
        raise KeyboardInterrupt

    if interrupted_at == "loaded":
        monkeypatch.setattr(loading, "_load", interrupt)
    with pytest.raises(KeyboardInterrupt):
        addresses_of(entries_of(plugin), lambda done, kernels: interrupt() if done else None)
    assert len(processes) == 1
    assert all(process.exitcode is not None for process in processes)


@pytest.mark.skipif(not hasattr(os, "geteuid"), reason="needs owners and modes of files")
def test_where_others_may_write_kernels_are_neither_loaded_nor_kept(plugin, processes, own_cache):
    own_cache.mkdir(parents=True)
    own_cache.chmod(0o777)
    with pytest.warns(CacheWarning, match=f"{own_cache}.*chmod") as warned:
        addresses_of(entries_of(plugin))
    assert len(warned) == 1
    assert list(own_cache.iterdir()) == []
    _check(plugin)


def test_a_damaged_kernel_is_compiled_again(plugin, own_cache):
    addresses_of([plugin.difference])
    (path,) = own_cache.iterdir()
    whole = path.read_bytes()
    path.write_bytes(whole[: len(whole) // 2])
    _forget(plugin)
    with pytest.warns(CacheWarning, match=path.name):
        addresses_of([plugin.difference])
    assert path.read_bytes() == whole
    _check(plugin)


def test_kernels_are_divided_by_what_they_take(plugin, monkeypatch):
    tasks = [Compilation(entry, entry.label) for entry in entries_of(plugin)]
    assert [set(share) for share in divide(tasks, 1)] == [set(tasks)]
    assert len(divide(tasks, 4)) == 1  # to start a process takes longer
    monkeypatch.setattr(loading, "_START", 0)
    total, *small = sorted(tasks, key=_size, reverse=True)
    shares = divide(tasks, 2)
    assert sorted(map(set, shares), key=len) == [{total}, set(small)]


def _size(task):
    return len(task.entry.function.__code__.co_code)


COMPILING = """
import signal
import sys
import time
from pathlib import Path
from evac.jit import loading
from evac.jit.kernels import entries_of
from evac.jit.loading import addresses_of
from evac.contract.registry import _module_of

def main(path, how):
    def tell(done, kernels):
        if how:
            print(done, kernels, flush=True)
        if how == "stay" and done:
            time.sleep(60)

    signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell lets background jobs ignore it
    loading._START, loading.cores = 0, lambda: 2
    module = _module_of(path, path.read_bytes())
    addresses_of(entries_of(module), tell)
    print(module.difference(5.0, 3.0) - module.OFFSET)

if __name__ == "__main__":
    main(Path(sys.argv[1]), sys.argv[2] if len(sys.argv) > 2 else "")
"""


@pytest.fixture
def compiling(plugin, tmp_path):
    """Return what starts a process that compiles the plugin's kernels.

    With "say" it prints how far it is; with "stay" it does, and goes no further once a kernel is finished.
    """
    script = tmp_path / "compiling.py"
    script.write_text(COMPILING)

    def start(*arguments):
        command = [sys.executable, str(script), plugin.__file__, *arguments]
        return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)

    return start


def test_two_first_runs_at_once(compiling, own_cache):
    for process in [compiling(), compiling()]:
        out, err = process.communicate(timeout=120)
        assert (out, err) == ("2.0\n", "")
    assert sorted(path.suffix for path in own_cache.iterdir()) == [".kernel"] * 3


@pytest.mark.skipif(os.name == "nt", reason="signals")
def test_a_killed_first_run_keeps_what_was_compiled(compiling, own_cache):
    first = compiling("stay")
    assert first.stdout is not None
    while first.stdout.readline().split()[0] == "0":
        pass
    first.kill()
    first.communicate(timeout=60)
    assert first.returncode != 0
    kept = len(list(own_cache.glob("*.kernel")))
    assert kept >= 1
    second = compiling("say")
    out, _ = second.communicate(timeout=120)
    assert out.splitlines()[-1] == "2.0"
    finished = len(list(own_cache.glob("*.kernel")))
    assert finished == 3
    told = [line for line in out.splitlines() if " " in line]
    assert all(line.split()[1] != "3" for line in told)  # less than everything is compiled again


@pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="needs /proc")
def test_processes_end_with_the_one_that_started_them(compiling):
    first = compiling("say")
    assert first.stdout is not None
    first.stdout.readline()
    children = Path(f"/proc/{first.pid}/task/{first.pid}/children")
    while len(started := children.read_text().split()) < 2:
        time.sleep(0.01)
    first.kill()
    first.communicate(timeout=60)
    while any(_is_compiling(pid) for pid in started):
        time.sleep(0.01)


def _is_compiling(pid):
    try:
        return b"spawn_main" in Path(f"/proc/{pid}/cmdline").read_bytes()
    except OSError:
        return False
