"""The case of a result: its parts that reports and replays name, and how it is loaded again."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from pydantic import BaseModel, ConfigDict

from evac.base.errors import ResultError

if TYPE_CHECKING:
    from evac.case.case import Case

Tables = dict[str, dict[str, Any] | Literal[False]]


class Record(BaseModel):
    """Checked data of a file; keys that are not known are left out."""

    model_config = ConfigDict(frozen=True, extra="ignore", allow_inf_nan=False)


class GroupTable(BaseModel):
    """A group of people of a case; distributions as the case has them."""

    model_config = ConfigDict(frozen=True, extra="allow")

    name: str
    number: int | None = None
    area: str | None = None
    level: str | None = None
    z: float | None = None
    use: str | None = None
    positions: list[list[float]] | None = None
    arrive: dict[str, Any] | None = None
    leave: bool = True
    exits: list[str] = []
    assembly: list[str] = []
    strategy: str = ""
    behaviours: dict[str, Any] = {}

    @property
    def size(self) -> int:
        """Number of people."""
        return len(self.positions) if self.positions is not None else self.number or 0


class BuildingTable(Record):
    """The keys of the building that are named in reports."""

    mesh: str | None = None
    closed: list[str] = []


class ReportTable(Record):
    """What a case says for its report."""

    project: str = ""
    author: str = ""
    date: str = ""


class CaseTable(Record):
    """The parts of a case that are named one by one in reports and replays."""

    building: BuildingTable
    people: list[GroupTable]
    contact: dict[str, Any]
    forces: Tables = {}
    behaviours: Tables = {}
    simulation: dict[str, Any]
    conditions: list[dict[str, Any]] = []
    report: ReportTable = ReportTable()

    @property
    def model(self) -> str:
        """Name of the contact model."""
        return str(self.contact.get("model", ""))

    @property
    def model_parameters(self) -> dict[str, Any]:
        """Parameters of the contact model in use."""
        parameters = self.contact.get(self.model, {})
        return parameters if isinstance(parameters, dict) else {}


def recorded_case(
    folder: Path, table: Mapping[str, Any], source: str, used: Sequence[str], plugin_files: Sequence[Path]
) -> "Case":
    """Return the case of a result; its plugin files must be given, because the folder may be a stranger's."""
    from evac.case.loading import case_from

    named = [(Path(source).parent / name).resolve() for name in table.get("plugins", {}).get("files", [])]
    if missing := [str(path) for path in dict.fromkeys((*named, *map(Path, used))) if path not in plugin_files]:
        raise ResultError(f"{folder}: its case needs the plugin {', '.join(missing)}; give it (plugin_files=)")
    return case_from(table, Path(source), plugin_files=plugin_files, is_recorded=True)


def with_infinity(value: Any) -> Any:
    """Return a case from JSON with the infinities that are null there."""
    if isinstance(value, dict):
        return {key: with_infinity(item) for key, item in value.items()}
    if isinstance(value, list):
        return [with_infinity(item) for item in value]
    return float("inf") if value is None else value
