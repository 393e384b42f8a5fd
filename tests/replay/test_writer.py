"""The file: what it holds, without a browser."""

import base64
import re
import zlib

import numpy as np
import pytest

from evac.base.errors import ResultError
from evac.replay.writer import account_of_run, packed, replay_trajectory
from evac.trajectory.trajectory import read_trajectory


def test_the_page_asks_nothing_of_a_network_and_shows_titles_as_they_are(descent):
    path = descent().path
    trajectory = read_trajectory(path)
    trajectory.header["title"] = "<b>Two & two</b>"
    replay_trajectory(trajectory, path.with_name("replay.html"))
    text = path.with_name("replay.html").read_text()
    assert "<title>&lt;b&gt;Two &amp; two&lt;/b&gt;</title>" in text
    assert "default-src 'none'" in text
    scripts = zlib.decompress(base64.b64decode(re.search(r'id="data-scripts">([^<]*)<', text)[1])).decode()
    for place in (text, scripts):
        assert not re.search(r"https?://|\bfetch\(|XMLHttpRequest|@import|url\(", place)


def test_states_are_chosen_by_time(descent, monkeypatch):
    path = descent(frames=9).path  # every 0.5 s to 4 s
    trajectory = read_trajectory(path)
    assert replay_trajectory(trajectory, path.with_name("all.html")) == 9
    assert replay_trajectory(trajectory, path.with_name("few.html"), every=1.0) == 5
    # Nearest to 0, 0.8, ... 3.2 s are 0, 1, 1.5, 2.5 and 3 s.
    times = np.frombuffer(zlib.decompress(packed(trajectory, every=0.8).streams()["times"]))
    assert times.tolist() == [0.0, 1.0, 1.5, 2.5, 3.0, 4.0]
    assert replay_trajectory(trajectory, path.with_name("few.html"), every=100.0) == 2
    monkeypatch.setattr("evac.replay.writer.MOST_STATES", sum(len(trajectory[k]["person"]) for k in range(9)) // 2)
    assert replay_trajectory(trajectory, path.with_name("large.html")) == 4  # 0, 1.5, 3 and 4 s


def test_fast_compression_makes_pages_hardly_larger(written):
    """Streams in which sequences repeat, such as the waiting times in a queue, are compressed with all effort."""
    random, frames, people = np.random.default_rng(1), 200, 60
    way = 0.5 * random.uniform(0.8, 1.4, people) + 0.02 * random.normal(size=(frames, people))
    way[:, ::3] = 0.0
    x = np.cumsum(way, axis=0)
    y = np.arange(people) / 10.0 + 0.02 * np.cumsum(random.normal(size=(frames, people)) * (way > 0.0), axis=0)
    streams = packed(written(np.stack([x, y], axis=2), interval=0.5)).streams()
    data = {name: zlib.decompress(stream) for name, stream in streams.items()}
    least = {name: len(zlib.compress(values, 9)) for name, values in data.items()}
    assert len(data["steps"]) >= 2 * frames * people
    assert sum(map(len, streams.values())) <= 1.03 * sum(least.values())
    for name in ("events", "waited"):
        assert len(streams[name]) <= least[name] < 0.5 * len(data[name])


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("summary.json", '{"seed": 99, "people": 4}'),
        ("summary.json", "no json"),
        ("summary.json", "{}"),
        ("summary.json", '{"seed": 99, "people": "four"}'),
    ],
)
def test_tables_of_another_run_are_refused_by_name(descent, name, text):
    path = descent().path
    path.with_name(name).write_text(text)
    with pytest.raises(ResultError, match=name):
        replay_trajectory(read_trajectory(path), path.with_name("replay.html"))


@pytest.mark.parametrize("ended", ["failed", "interrupted", "no progress"])
def test_a_run_that_did_not_end_by_itself_has_a_banner_with_who_is_inside(make_results, ended):
    banner = account_of_run(make_results(ended=ended)).banner
    said = f"This run {ended} at t = 20.00 s, with 3 of 5 people inside."
    assert banner == ("" if ended == "no progress" else said)
