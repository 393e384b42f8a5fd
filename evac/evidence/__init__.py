"""Evidence: `evac evidence` measures what the pages of docs/evidence/ tell, and writes them."""

#: Kinds of evidence: each is computed by ``run(evidence)`` of ``page`` in the package of its name.
KINDS = ("accuracy", "stability", "lean", "table3", "scaling", "validation", "certainty")
