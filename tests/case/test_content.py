"""What no case can hold is refused before anything descends into it, in one line that says where."""

import pytest

from evac.base.errors import ScenarioError
from evac.case.loading import case_from, load_case
from evac.case.overrides import MOST_BYTES, MOST_NESTED


@pytest.fixture
def refusal(case_file, registry):
    """Return the message with which the case file is refused."""

    def load(*overrides):
        with pytest.raises(ScenarioError) as caught:
            load_case(case_file, overrides, registry=registry)
        return str(caught.value).replace(str(case_file), "case.toml")

    return load


def test_a_byte_order_mark_of_utf_8_is_allowed(case_file, registry):
    case_file.write_bytes(b"\xef\xbb\xbf" + case_file.read_bytes())
    assert load_case(case_file, registry=registry).simulation.seed == 3


@pytest.mark.parametrize("encoding", ["utf-16", "utf-16-le", "utf-32", "latin-1", "cp500"])
def test_other_encodings_are_refused(case_file, refusal, encoding):
    case_file.write_bytes(case_file.read_text().replace("Two", "Zwölf").encode(encoding))
    told = refusal()
    assert told.startswith("case.toml: ")
    assert "line 2 contains byte 0xf6" in told or encoding != "latin-1"


def test_a_file_too_large_is_not_read(case_file, refusal):
    case_file.write_text("# " + "x" * MOST_BYTES)
    assert "8 MB is more than a case can hold (8 MB)" in refusal()
    case_file.write_text("# " + "x" * (MOST_BYTES - 2))  # of the greatest size, it is read
    assert "more than a case can hold" not in refusal()


@pytest.mark.parametrize("depth", [MOST_NESTED + 1, 5_000])
def test_deep_nesting_is_refused(case_file, refusal, depth):
    text = case_file.read_text()
    case_file.write_text(f"x = {'[' * depth}{']' * depth}\n{text}")
    assert "deep" in refusal()
    case_file.write_text(f"{'.'.join('a' * depth)} = 1\n{text}")
    assert "case.toml: a.a.a: " in refusal()
    case_file.write_text(text)
    assert "title" in refusal(f"title={'[' * depth}{']' * depth}")
    assert "deep" in refusal(f"{'.'.join('b' * depth)}=1")


@pytest.mark.parametrize(
    ("override", "key"),
    [
        ("simulation.seed=9223372036854775808", "simulation.seed"),
        (f"people.pupils.mass=1{'0' * 400}", "people.pupils.mass"),
        (f"contact.soft.stiffness=1{'0' * 400}", "contact.soft.stiffness"),
        (r'people.pupils.name="a\u0000b"', "people.pupils.name"),
    ],
    ids=lambda given: given[:25],
)
def test_what_no_case_holds_is_refused_by_its_key(refusal, override, key):
    assert refusal(override).startswith(f"case.toml: {key}")


def test_of_many_faults_the_first_are_told(case_file, refusal):
    case_file.write_text(case_file.read_text() + "".join(f"unknown{k} = 1\n" for k in range(9_000)))
    lines = refusal().splitlines()
    assert len(lines) == 51
    assert "simulation.unknown0: " in lines[0]
    assert "more" in lines[-1]


def test_a_dictionary_that_contains_itself_is_refused(case_file, registry):
    table = {"title": "x"}
    table["people"] = [table]
    with pytest.raises(ScenarioError, match="deep"):
        case_from(table, case_file, registry=registry)


@pytest.mark.parametrize(
    ("line", "hint"),
    [
        ("area = open plan", 'area = "open plan"'),
        ("driving = explicit", 'driving = "explicit"'),
        ("tables = TRUE", "tables = true"),
        (r'mesh = "C:\Users\room.msh"', "single quotes"),
        (r'mesh = "C:\data\room.msh"', "single quotes"),
    ],
)
def test_a_line_that_is_no_toml_is_quoted_with_a_hint(case_file, refusal, line, hint):
    case_file.write_text(f"title = 'x'\n{line}\n")
    found = refusal()
    assert f": {line}; " in found
    assert hint in found


def test_a_long_value_is_not_told_in_full(refusal):
    assert len(refusal(f"importers.drawn=[{'0.5, ' * 50_000}]")) < 2_000
