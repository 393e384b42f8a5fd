"""Evidence: `evac evidence` measures the results on the pages of docs/evidence/ and writes the pages."""

#: Kinds of evidence: each is computed by ``run(evidence)`` of ``page`` in the package of its name.
KINDS = (
    "accuracy",
    "directions",
    "stability",
    "lean",
    "table3",
    "scaling",
    "validation",
    "certainty",
    "people",
    "comfort",
    "mobility",
    "lifts",
)
