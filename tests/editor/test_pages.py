"""The page beside a script: its address, and the plan as it was saved."""

import http.client
import json

import pytest

import evac


def test_a_plan_of_a_script_is_served_and_read_back():
    plan = evac.Plan()
    plan.storey("ground", [[0, 0], [9, 0], [9, 6], [0, 6]])
    plan.exit("door", "ground", [[0, 2], [0, 3]])
    with evac.edit(plan) as page:
        assert page.address in page._repr_html_()
        assert page.plan.building().exits[0].width == pytest.approx(1.0)
        text = page.file.read_text().replace("[0, 3]", "[0, 4]").replace("[0.0, 3.0]", "[0.0, 4.0]")
        page.file.write_text(text)
        assert page.plan.building().exits[0].width == pytest.approx(2.0)


def test_the_page_of_a_case_may_be_in_a_frame_of_a_notebook_on_this_machine(house, tmp_path):
    with evac.edit(evac.load(house), tmp_path / "result") as page:
        assert page.file == house / "house.plan.toml"
        host, _, rest = page.address.removeprefix("http://").partition("/")
        connection = http.client.HTTPConnection(host, timeout=30)
        connection.request("GET", f"/{rest}", headers={"Sec-Fetch-Site": "same-site", "Sec-Fetch-Dest": "iframe"})
        answer = connection.getresponse()
        assert answer.status == 200
        assert "frame-ancestors http://127.0.0.1:*" in answer.headers["Content-Security-Policy"]
        answer.read()
        connection.request("GET", f"/{rest}document", headers={"Sec-Fetch-Site": "same-site"})
        answer = connection.getresponse()
        assert answer.status == 403
        assert "origin" in json.loads(answer.read())["error"]
