"""evac list, evac plugins, evac schema, evac explain."""

from evac.contract.registry import Registry


def test_list_names_every_case_that_is_registered(evac, capsys):
    assert evac("list") == 0
    out = capsys.readouterr().out
    rows = {line.split()[0]: line for line in out.splitlines() if line.strip()}
    registry = Registry()
    assert set(rows) >= set(registry.cases)
    assert str(registry.cases["square_room"].parent) in rows["folders"]
    assert "Twenty people leave a square room" in rows["square_room"]


def test_plugins_shows_everything_with_unit_and_default(evac, capsys):
    assert evac("plugins") == 0
    short = capsys.readouterr().out.splitlines()
    assert evac("plugins", "--verbose") == 0
    out = capsys.readouterr().out
    assert len(short) == sum(len(entry["provides"]) for entry in Registry().describe())
    for entry in Registry().describe():
        assert entry["plugin"] in out
        for item in entry["provides"]:
            assert f"{item['kind'].replace('_', ' ')} {item['name']}" in out
            assert all(f" {name} " in out for name in item["parameters"])
    assert any(line.split()[:3] == ["stiffness", "=", "1.2e+05"] for line in out.splitlines())


def test_plugins_describes_one_by_name(evac, capsys):
    assert evac("plugins", "nsm2") == 0
    out = capsys.readouterr().out
    assert "contact model nsm2" in out
    assert "normal_dissipation" in out
    assert "contact model dem" not in out
    assert evac("plugins", "nsm3") == 2
    assert "'nsm2'" in capsys.readouterr().err


def test_explain_says_what_is_left_out_and_why(evac, capsys):
    assert evac("explain", "square_room") == 0
    out = capsys.readouterr().out
    parts = {
        line.split("  ")[0].strip(): line.split() for line in out.splitlines() if " in " in line or " out " in line
    }
    assert "out" in parts["portals"]
    assert "0 portals, 1 level" in out
    assert "in" in parts["fields: fastest"]
    assert evac("explain", "square_room", "--set", "people.people.strategy=shortest") == 0
    assert "fields: fastest" in capsys.readouterr().out
