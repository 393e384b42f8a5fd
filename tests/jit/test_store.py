"""Files of compiled kernels: whole or not there, whatever happens to them."""

import os
import stat
from pathlib import Path

import pytest

from evac.base.errors import CacheWarning
from evac.jit import store as stores
from evac.jit.store import Store, cache_root

NAME, DIGEST, CODE = "evac.some.kernel", "0123456789abcdef0123", b"machine code" * 20


@pytest.fixture
def store(tmp_path, monkeypatch):
    monkeypatch.setattr(stores, "_warned", set())
    store = Store(tmp_path / "kernels")
    store.write(NAME, DIGEST, CODE)
    return store


def test_what_is_written_is_read(store):
    assert store.read(NAME, DIGEST) == CODE
    assert store.read(NAME, DIGEST[::-1]) is None
    assert store.read("evac.some.other", DIGEST) is None
    assert [path.name for path in store.folder.iterdir()] == [f"{NAME}-{DIGEST}.kernel"]


def _with_flipped_bit(place):
    def damage(content):
        content = bytearray(content)
        content[place] ^= 4
        return bytes(content)

    return damage


DAMAGES = {
    "empty": lambda content: b"",
    "garbage": lambda content: os.urandom(300),
    "cut short": lambda content: content[:-1],
    "only a header": lambda content: content[:20],
    "something behind": lambda content: content + b"\0",
    "bit of the code": _with_flipped_bit(-1),
    "bit of the checksum": _with_flipped_bit(20),
    "first bit": _with_flipped_bit(0),
}


@pytest.mark.parametrize("damage", DAMAGES.values(), ids=DAMAGES)
def test_a_damaged_file_is_removed_with_one_warning(store, damage):
    content = damage(store.path(NAME, DIGEST).read_bytes())
    names = [NAME, "evac.some.other"]
    for name in names:
        store.path(name, DIGEST).write_bytes(content)
    with pytest.warns(CacheWarning, match=NAME) as warned:
        assert [store.read(name, DIGEST) for name in names] == [None, None]
    assert len(warned) == 1
    assert store.entries() == []
    store.write(NAME, DIGEST, CODE)
    assert store.read(NAME, DIGEST) == CODE


def test_a_file_under_the_name_of_another_kernel_is_not_read(store):
    other = DIGEST[::-1]
    store.path(NAME, DIGEST).rename(store.path(NAME, other))
    with pytest.warns(CacheWarning):
        assert store.read(NAME, other) is None


def test_all_kernels_are_cleared_and_nothing_else(store):
    (store.folder / "tmp1.part").touch()
    (store.folder / "mine.txt").touch()
    store.clear()
    assert [path.name for path in store.folder.iterdir()] == ["mine.txt"]


def test_the_folder_is_chosen_by_the_environment(monkeypatch, tmp_path):
    for name in ("EVAC_CACHE_DIR", "XDG_CACHE_HOME", "LOCALAPPDATA"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv("HOME", str(tmp_path))
    monkeypatch.setenv("USERPROFILE", str(tmp_path))
    assert cache_root() == tmp_path / ".cache" / "evac"
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "xdg"))
    assert cache_root() == tmp_path / "xdg" / "evac"
    monkeypatch.setenv("EVAC_CACHE_DIR", "here")
    assert cache_root() == Path.cwd() / "here"


needs_modes = pytest.mark.skipif(not hasattr(os, "geteuid"), reason="needs owners and modes of files")


@needs_modes
def test_the_folder_and_its_files_are_for_their_owner_alone(store):
    before = os.umask(0)
    try:
        other = Store(store.folder.parent / "other")
        other.write(NAME, DIGEST, CODE)
    finally:
        os.umask(before)
    assert stat.S_IMODE(other.folder.stat().st_mode) == 0o700
    assert stat.S_IMODE(other.path(NAME, DIGEST).stat().st_mode) == 0o600


@needs_modes
@pytest.mark.parametrize("mode", [0o770, 0o702, 0o1777])
def test_nothing_is_loaded_from_or_kept_in_a_folder_that_others_may_write_to(store, mode):
    store.folder.chmod(mode)
    assert store.read(NAME, DIGEST) is None
    with pytest.raises(PermissionError, match="chmod"):
        store.write(NAME, DIGEST[::-1], CODE)
    store.folder.chmod(0o755)
    assert store.read(NAME, DIGEST) == CODE


@needs_modes
def test_a_file_that_others_may_write_to_is_compiled_again(store):
    store.path(NAME, DIGEST).chmod(0o620)
    with pytest.warns(CacheWarning, match="620"):
        assert store.read(NAME, DIGEST) is None
    assert store.entries() == []


@needs_modes
@pytest.mark.parametrize("what", ["folder", "file"])
def test_what_belongs_to_another_user_is_not_loaded(store, monkeypatch, what):
    mine = os.geteuid()
    path = store.folder if what == "folder" else store.path(NAME, DIGEST)
    real = Path.stat

    def stat_of(self, **options):
        found = list(real(self, **options))
        found[stat.ST_UID] = mine + 7 if self == path else mine
        return os.stat_result(found)

    monkeypatch.setattr(Path, "stat", stat_of)
    if what == "folder":
        assert store.read(NAME, DIGEST) is None
        with pytest.raises(PermissionError, match="another user"):
            store.write(NAME, DIGEST, CODE)
    else:
        with pytest.warns(CacheWarning, match="another user"):
            assert store.read(NAME, DIGEST) is None


def test_a_home_relative_to_the_current_folder_is_none(monkeypatch):
    for name in ("EVAC_CACHE_DIR", "LOCALAPPDATA"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv("XDG_CACHE_HOME", "somewhere")
    monkeypatch.setenv("HOME", "elsewhere")
    monkeypatch.setenv("USERPROFILE", "elsewhere")
    assert cache_root() is None
