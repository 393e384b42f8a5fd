"""Cases: case.toml and overrides, validated by a schema."""

from evac.case.case import Case as Case
from evac.case.loading import case_from as case_from
from evac.case.loading import load_case as load_case
