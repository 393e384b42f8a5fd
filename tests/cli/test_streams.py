"""Streams that never fail."""

import errno
import io
import os
import threading
import time

import pytest

from evac.cli.streams import guarded, notify


def lenient_stream(descriptor, encoding="utf-8"):
    text = io.TextIOWrapper(io.BufferedWriter(io.FileIO(descriptor, "w", closefd=False)), encoding)
    return guarded(text, 1), text


def test_a_reader_that_has_gone_stops_nobody():
    read, write = os.pipe()
    os.close(read)
    stream, _kept = lenient_stream(write)
    for _ in range(3):
        print("x" * 100_000, file=stream, flush=True)
    assert stream.failure.errno == errno.EPIPE
    stream.close()
    os.fstat(write)  # is still open
    os.close(write)


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="this system has no device that is always full")
def test_a_full_device_stops_nobody():
    with open("/dev/full", "wb", buffering=0) as full:
        stream, _ = lenient_stream(full.fileno())
        print("x", file=stream, flush=True)
        assert stream.failure.errno == errno.ENOSPC
        stream.close()


def test_a_pipe_that_does_not_block_is_waited_for():
    read, write = os.pipe()
    os.set_blocking(write, False)
    stream, _ = lenient_stream(write)
    found = bytearray()

    def drain():
        time.sleep(0.05)  # the pipe is full by then
        while data := os.read(read, 65536):
            found.extend(data)

    thread = threading.Thread(target=drain)
    thread.start()
    print("x" * 1_000_000, file=stream, flush=True)
    stream.close()
    os.close(write)
    thread.join()
    os.close(read)
    assert len(found) == 1_000_001


def test_letters_that_an_encoding_lacks_are_escapes(tmp_path):
    with (tmp_path / "out").open("wb", buffering=0) as file:
        stream, _ = lenient_stream(file.fileno(), "ascii")
        print("größer \udcff 東", file=stream, flush=True)
        stream.close()
    assert (tmp_path / "out").read_bytes() == rb"gr\xf6\xdfer \udcff \u6771" + b"\n"


def test_where_there_is_no_stream_there_is_one(tmp_path):
    with (tmp_path / "out").open("wb", buffering=0) as file:
        stream = guarded(None, file.fileno())
        print("x", file=stream, flush=True)
        stream.close()
    assert (tmp_path / "out").read_bytes() == b"x\n"


def test_a_replaced_stream_stays():
    replaced = io.StringIO()
    assert guarded(replaced, 1) is replaced


def test_a_handler_of_signals_may_say_something_without_a_stream(monkeypatch):
    for stream in (None, io.StringIO()):
        monkeypatch.setattr("sys.stderr", stream)
        notify("stopping")


def test_a_closed_descriptor_stops_nobody():
    read, write = os.pipe()
    stream, _ = lenient_stream(write)
    os.close(write)
    print("x", file=stream, flush=True)
    assert stream.failure.errno == errno.EBADF
    print("y", file=stream, flush=True)
    os.close(write)  # leads to the null device
    os.close(read)
