"""Cases: case.toml and overrides, validated by a schema."""

from evac.scenario.case import Case as Case
from evac.scenario.loading import case_from as case_from
from evac.scenario.loading import load_case as load_case
