import pytest

from evac.cli import main
from tests.attacks.streams import (
    PLUGIN_COMMAND,
    SITES,
    PluginCase,
    StreamCase,
    check_plugin,
    plugin_cases,
    run_plugin,
    run_stream,
    write_plugin,
)


@pytest.mark.parametrize(
    "case",
    [
        StreamCase("run out.toml --out r", 0, ">&- 2>&- <&-"),
        StreamCase("run stays.toml --out r", 3, "> /dev/full"),
        StreamCase("run out.toml --out r", 0, "| true", (("PYTHONIOENCODING", "ascii"),)),
        StreamCase("run none.toml --out r", 2, "2> /dev/full"),
        StreamCase("check out.toml", 0, "| head -1"),
        StreamCase("fly", 2, ">&- 2>&-"),
    ],
    ids=str,
)
def test_streams_change_no_status(case, tmp_path):
    run_stream(case, tmp_path)


@pytest.mark.parametrize("case", [*(PluginCase(site, "exit 0") for site in SITES), *plugin_cases(20, seed=1)], ids=str)
def test_a_plugin_that_raises_is_a_plugin_error(case, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    write_plugin(case, tmp_path)
    status = main(PLUGIN_COMMAND.split())
    check_plugin(case, tmp_path, status, capsys.readouterr().err)


def test_a_plugin_that_exits_in_a_process_of_its_own(tmp_path):
    run_plugin(PluginCase("import", "exit 0"), tmp_path)
