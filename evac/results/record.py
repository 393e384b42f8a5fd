"""What ``summary.json`` contains, as checked data: the numbers of a run that are not those of single people."""

from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field

from evac.base.change import Change
from evac.directions.routes import Route
from evac.folder.files import SUMMARY_NAME
from evac.folder.jsonfile import checked, read_json
from evac.people.places import PeopleAt

Count = Annotated[int, Field(ge=0)]
Amount = Annotated[float, Field(ge=0.0)]
Tables = dict[str, dict[str, Any] | Literal[False]]


class Record(BaseModel):
    """Checked data of a file; keys that are not known are left out."""

    model_config = ConfigDict(frozen=True, extra="ignore", allow_inf_nan=False)


class ExitUse(Record):
    """How an exit was used, see docs/summary.md."""

    people: Count
    last_out: Amount | None
    width: Amount
    flow: Amount | None
    flow_per_metre: Amount | None


class PortalUse(Record):
    """The levels that a portal connects, its width [m], and the number of passages in both directions."""

    levels: tuple[str, str]
    width: Amount
    passages: Count


class FlowUse(Record):
    """People and flow through a line in one direction, see docs/summary.md."""

    kind: str
    name: str
    direction: str
    width: Amount
    people: Count
    first: Amount | None
    last: Amount | None
    flow: Amount | None
    flow_per_metre: Amount | None


class PlaceUse(Record):
    """How a level or a stair was used."""

    people: Count
    greatest_number: Count
    last_left: Amount | None


class DoorRow(Record):
    """A door between rooms."""

    name: str
    level: str
    width: Amount


class StuckPlace(Record):
    """Where somebody was who no longer made progress."""

    person: Count
    level: str
    x: float
    y: float


class PlanRow(Record):
    """A part of the program that was needed or left out, and why."""

    part: str
    state: str
    why: str


class GroupTable(BaseModel):
    """A group of people of a case; distributions as the case has them."""

    model_config = ConfigDict(frozen=True, extra="allow")

    name: str
    number: int | None = None
    area: str | None = None
    level: str | None = None
    z: float | None = None
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
    aset: dict[str, Amount] = {}


class CaseTable(Record):
    """The parts of a case that are named one by one in reports and replays."""

    building: BuildingTable
    directions: dict[str, Any]
    people: list[GroupTable]
    contact: dict[str, Any]
    forces: Tables = {}
    behaviours: Tables = {}
    simulation: dict[str, Any]
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


class ContactReport(BaseModel):
    """Report of the contact model; of any other keys too."""

    model_config = ConfigDict(frozen=True, extra="allow", allow_inf_nan=False)

    model: str


class Summary(Record):
    """The summary of a run; docs/summary.md explains its keys."""

    title: str
    people: Count
    evacuated: Count
    last_out: Amount | None
    ended: str
    places: tuple[PeopleAt, ...] = ()
    entered_barred: dict[str, tuple[int, ...]] = {}
    notes: tuple[str, ...] = ()
    waiting_outside: Count = 0
    stuck: list[StuckPlace]
    warnings: tuple[str, ...]
    quality_warnings: tuple[str, ...]
    simulated_time: Amount
    steps: Count
    exits: dict[str, ExitUse]
    portals: dict[str, PortalUse]
    doors: list[DoorRow]
    flows: list[FlowUse] = []
    left_by_other_exits: Count
    levels: dict[str, PlaceUse]
    stairs: dict[str, PlaceUse]
    routes: tuple[Route, ...] = Field(min_length=1)
    contact: ContactReport
    wall_time: dict[str, Amount]
    plan: list[PlanRow]
    metrics: dict[str, Any]
    quickest: dict[str, Amount] | None = None
    conditions: dict[str, Any] | None = None
    changes: tuple[Annotated[Change, BeforeValidator(Change.from_row)], ...]
    resumed: list[dict[str, Any]]
    files: tuple[str, ...]
    plugin_files: tuple[str, ...]
    seed: Count
    source: str
    keeps_distance: list[str]
    plugins: tuple[str, ...]
    versions: dict[str, str]
    table: CaseTable = Field(alias="case")


def read_summary(folder: Path) -> tuple[Summary, dict[str, Any]]:
    """Return the checked content of ``summary.json`` in a result folder, and its case with every key."""
    data = read_json(folder / SUMMARY_NAME)
    return checked(Summary, data, folder / SUMMARY_NAME), data["case"]
