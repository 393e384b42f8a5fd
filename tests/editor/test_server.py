"""The server answers its own page, and nobody else."""

import http.client
import json
import math
import subprocess
import sys
from base64 import b64encode
from pathlib import Path
from types import SimpleNamespace
from urllib.parse import urlsplit

import pytest

from evac.cli.main import main
from evac.editor import Server, Session


def ask(server, path="", method="GET", body=None, **headers):
    """Return the status, the headers and the content of an answer; None takes a header away."""
    connection = http.client.HTTPConnection("127.0.0.1", server.server_port, timeout=30)
    given = {"Host": server.host, "Origin": f"http://{server.host}", "Content-Type": "application/json"}
    given |= {name.replace("_", "-"): value for name, value in headers.items()}
    connection.putrequest(method, f"/{server.token}/{path}" if not path.startswith("/") else path, skip_host=True)
    for name, value in given.items():
        if value is not None:
            connection.putheader(name, value)
    content = None if body is None else json.dumps(body).encode()
    if content is not None:
        connection.putheader("Content-Length", str(len(content)))
    connection.endheaders(content)
    answer = connection.getresponse()
    found = answer.status, dict(answer.getheaders()), answer.read()
    connection.close()
    return found


@pytest.fixture
def server(house, serve):
    return serve(house)


def document(server):
    return json.loads(ask(server, "document")[2])


def test_the_page_gets_the_plan_and_its_files(server):
    found = document(server)
    assert found["file"] == "house.plan.toml"
    assert [row["name"] for row in found["table"]["rooms"]] == ["hall", "shop", "gallery"]
    for name, kind in (("", "html"), ("page.js", "javascript"), ("page.css", "css")):
        status, headers, content = ask(server, name)
        assert status == 200
        assert kind in headers["Content-Type"]
        assert "default-src 'none'" in headers["Content-Security-Policy"]
        assert ask(server, name, "HEAD")[1]["Content-Length"] == str(len(content))
    assert len(ask(server, "page.js")[2]) < 400_000


@pytest.mark.parametrize(
    ("status", "headers"),
    [
        (421, {"Host": "evil.example"}),
        (421, {"Host": "localhost"}),
        (421, {"Host": "127.0.0.1"}),
        (421, {"Host": None}),
        (403, {"Origin": "http://evil.example"}),
        (403, {"Origin": "null"}),
        (403, {"Origin": "http://127.0.0.1:1"}),
        (403, {"Sec_Fetch_Site": "cross-site"}),
        (403, {"Sec_Fetch_Site": "same-site", "Sec_Fetch_Dest": "script"}),
    ],
)
def test_other_hosts_and_origins_are_refused(server, status, headers):
    for name, method, body in (("", "GET", None), ("document", "GET", None), ("save", "POST", {})):
        assert ask(server, name, method, body, **headers)[0] == status


def test_a_post_needs_the_origin_and_json(server, house):
    before = (house / "house.plan.toml").read_bytes()
    body = {"table": {"storeys": []}, "digest": document(server)["digest"]}
    assert ask(server, "save", "POST", body, Origin=None)[0] == 403
    assert ask(server, "save", "POST", body, Content_Type="text/plain")[0] == 415
    assert ask(server, "save", "POST", None)[0] == 413
    assert ask(server, "save", "POST", {"table": 1})[0] == 400
    assert ask(server, "save", "POST", [])[0] == 400
    assert (house / "house.plan.toml").read_bytes() == before


@pytest.mark.parametrize(
    "name", ["../document", "%2e%2e/case.toml", "case.toml", "house.plan.toml", "..", "run", "result", "main.js"]
)
def test_nothing_else_is_served(server, name):
    assert ask(server, name)[0] == 404
    assert ask(server, f"/{name}")[0] == 404


def test_files_of_a_result_are_served_without_rights(house, serve, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    server, result = serve(house), tmp_path / "house-result"
    assert ask(server, "result/replay.html")[0] == 404
    assert main(["run", str(house), "--set", "simulation.duration=1"]) == 3
    status, headers, content = ask(server, "result/replay.html")
    assert (status, content) == (200, (result / "replay.html").read_bytes())
    assert headers["Content-Security-Policy"].startswith("sandbox allow-scripts allow-downloads; default-src 'none'")
    (result / "report.html").write_text("not of evac")
    for name in ("summary.json", "report.html", "../house/case.toml", ""):
        assert ask(server, f"result/{name}")[0] == 404


def test_pictures_are_kept_beside_the_file_if_they_are_pictures(server, house):
    def put(data, at=(0, 1), width=2.0, storey="../x"):
        picture = {"data": b64encode(data).decode(), "at": at, "width": width}
        status, _, content = ask(server, "picture", "POST", {"storey": storey, "picture": picture})
        told.append(content.decode())
        return status

    told = []
    assert put(b"<svg onload='alert()'/>") == put(b"%PDF") == 422
    assert all("PNG or JPEG of at most 20 MB" in text for text in told)
    assert put(b"\xff\xd8\xff", at=(0, math.inf)) == put(b"\xff\xd8\xff", width=0) == 422
    assert put(b"\xff\xd8\xff", at="near") == 400
    assert ask(server, "picture", "POST", {"storey": "a", "picture": {"at": [0, 0], "width": 1}})[0] == 400
    before = {path.name for path in house.iterdir()}
    assert put(b"\xff\xd8\xff and more") == 200
    assert {path.name for path in house.iterdir()} - before == {"house.plan.toml.pictures"}
    assert list(json.loads(ask(server, "pictures")[2])) == ["../x"]
    (house / "house.plan.toml.pictures").write_text('{"a": {"data": "PHN2Zz4=", "at": [0, 0], "width": 1}, "b": 3}')
    assert json.loads(ask(server, "pictures")[2]) == {}


def test_the_token_is_needed_and_is_another_at_each_start(server, house, serve):
    again = serve(house)
    assert again.token != server.token
    for path in ("/", "/document", "/x/document", f"/{server.token[:-1]}/document", f"/{server.token}/document"):
        assert ask(again, path)[0] == 404
    assert ask(again, "document")[0] == 200
    body = {"table": document(server)["table"] | {"doors": []}, "digest": document(again)["digest"]}
    before = (house / "house.plan.toml").read_bytes()
    assert ask(again, f"/{server.token}/save", "POST", body)[0] == 404  # of a page that is left from before
    assert (house / "house.plan.toml").read_bytes() == before


def test_work_that_is_not_saved_outlives_a_server_that_is_killed(house, serve):
    words = [sys.executable, "-m", "evac", "edit", str(house), "--no-browser"]
    with subprocess.Popen(words, stdout=subprocess.PIPE, text=True) as process:
        address = urlsplit(next(line for line in process.stdout if line.startswith("address")).split()[1])
        killed = SimpleNamespace(server_port=address.port, host=address.netloc, token=address.path.strip("/"))
        table = document(killed)["table"] | {"doors": []}
        assert ask(killed, "check", "POST", {"page": "a", "revision": 1, "table": table})[0] == 200
        process.kill()
    assert document(serve(house))["unsaved"] == {"table": table, "of_this_file": True}


def test_nothing_is_edited_before_it_was_chosen(serve, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    server = serve(None)
    assert document(server) == {"begin": True}
    for name in ("forms", "events", "result/replay.html"):
        assert ask(server, name)[0] == 404
    assert ask(server, "save", "POST", {"table": {}, "digest": ""})[0] == 404
    for folder in ("..", "", "a/../b", str(tmp_path.parent / "c")):
        assert ask(server, "begin", "POST", {"folder": folder, "what": "empty"})[0] == 422
    assert ask(server, "begin", "POST", {"folder": "d", "what": "empty"}, Origin=None)[0] == 403
    assert [*tmp_path.iterdir()] == []
    assert ask(server, "begin", "POST", {"folder": "d", "what": "empty"})[0] == 200
    assert document(server)["file"] == "building.plan.toml"
    assert ask(server, "begin", "POST", {"folder": "e", "what": "empty"})[0] == 404


def test_a_copy_stays_in_the_current_folder_and_has_the_files_of_the_case(house, serve, tmp_path, monkeypatch):
    (house / "more").mkdir()
    (house / "more/ways.py").write_text("")
    (house / "private.txt").write_text("not named in the case")
    with (house / "case.toml").open("a") as file:
        file.write('[plugins]\nfiles = ["more/ways.py"]\n')
    (tmp_path / "here").mkdir()
    (tmp_path / "here/out").symlink_to(tmp_path)
    monkeypatch.chdir(tmp_path / "here")
    server = serve(house)
    table, first = document(server)["table"], server.token
    for folder in ("..", "../copy", "out/copy", str(tmp_path / "copy"), ""):
        assert ask(server, "copy", "POST", {"folder": folder, "table": table})[0] == 422
    assert ask(server, "copy", "POST", {"folder": "a", "table": table}, Origin=None)[0] == 403
    assert [path.name for path in (tmp_path / "here").iterdir()] == ["out"]
    status, _, content = ask(server, "copy", "POST", {"folder": "a", "table": table})
    assert (status, json.loads(content)["address"]) == (200, server.address)
    assert ask(server, f"/{first}/document")[0] == 404  # of a page that shows the first case
    copies = {path.relative_to("a").as_posix(): path.read_bytes() for path in Path("a").rglob("*") if path.is_file()}
    assert copies == {name: (house / name).read_bytes() for name in ("case.toml", "house.plan.toml", "more/ways.py")}
    text = (house / "case.toml").read_text().replace("more/ways.py", "../ways.py")
    (house.parent / "ways.py").write_text("")
    (house / "case.toml").write_text(text)
    server = serve(house)
    assert ask(server, "copy", "POST", {"folder": "b", "table": document(server)["table"]})[0] == 422
    assert not Path("b").exists()


def test_it_ends_when_no_page_is_open(house):
    with Server(Session(house), idle=0.1) as server:
        server.serve(is_shown=False)
    assert server.session.is_over.is_set()
