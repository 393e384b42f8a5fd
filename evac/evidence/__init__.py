"""Evidence: `evac evidence` recomputes every table, plot and page of docs/evidence/ from scratch."""

#: Kinds of evidence: each is computed by ``run(evidence)`` of ``page`` in the package of its name.
KINDS = ("accuracy", "stability", "lean", "table3", "scaling", "validation")
