"""A result folder, the files of a study, and a reader of pages."""

import shutil
from html.parser import HTMLParser
from pathlib import Path

import pytest

import evac
from evac.case.loading import load_case
from evac.report.pages import points

#: What a page must not turn into markup.
HOSTILE = "<script>alert('1')</script> & \"co\""

#: Elements without an end.
VOID = {"meta", "img", "wbr"}


class Page(HTMLParser):
    """A parsed page: tags, attributes, text, the tables and whether all elements are closed."""

    def __init__(self, text):
        super().__init__()
        self.tags, self.attributes, self.open, self.tables = [], [], [], []
        self.text = ""
        self.feed(text)
        self.close()
        assert not self.open

    def handle_starttag(self, tag, attributes):
        self.tags.append(tag)
        self.attributes += [(tag, name, value) for name, value in attributes]
        if tag not in VOID:
            self.open.append(tag)
        if tag == "table":
            self.tables.append({"caption": "", "rows": []})
        if tag == "tr":
            self.tables[-1]["rows"].append([])
        if tag in ("td", "th"):
            self.tables[-1]["rows"][-1].append("")

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        self.text += data
        if "caption" in self.open:
            self.tables[-1]["caption"] += data
        elif {"td", "th"} & set(self.open):
            self.tables[-1]["rows"][-1][-1] += data

    def of(self, name):
        """Return the values of an attribute."""
        return [value for _, key, value in self.attributes if key == name]

    def table(self, words):
        """Return the rows, the head among them, of the table whose caption holds some words."""
        (found,) = [table["rows"] for table in self.tables if words in table["caption"]]
        return found

    def lacks(self, *sections):
        """Return whether the checklist says that the points which exactly these sections have are not provided."""
        rows = {row[1]: row[2] for row in self.table("Numbers of sections")[1:]}
        (lacking,) = {rows[point.words] == "not provided" for point in points() if point.sections == [*sections]}
        return lacking

    def fact(self, name):
        """Return the value beside a name."""
        (found,) = [row[1] for table in self.tables for row in table["rows"] if row[:1] == [name]]
        return found


@pytest.fixture(scope="session")
def finished(tmp_path_factory):
    """Result folder of the square room with two groups, one of which has a hostile name."""
    people = [
        {"name": "early", "number": 8, "area": "room"},
        {"name": "late", "number": 6, "area": "room", "behaviours": {"response_time": {"time": 2.0}}},
    ]
    case = load_case(
        "square_room",
        {"title": HOSTILE, "people": people, "behaviours.response_time": {"time": 0.0}, "output.animation": False},
    )
    folder = tmp_path_factory.mktemp("finished") / "result"
    evac.run(case, folder)
    return folder


@pytest.fixture
def result(finished, tmp_path):
    """A copy of it to change."""
    return Path(shutil.copytree(finished, tmp_path / "result"))


CASE = {"people.people.number": 5, "output.picture": False, "output.animation": False, "output.replay": False}


@pytest.fixture(scope="session")
def repeated(tmp_path_factory):
    """Result folder of 20 runs of the square room with few people."""
    return evac.repeat(load_case("square_room", CASE), 20, folder=tmp_path_factory.mktemp("study") / "study", workers=1)


@pytest.fixture
def study(repeated, tmp_path):
    """A copy of it to change."""
    return Path(shutil.copytree(repeated.folder, tmp_path / "study"))
