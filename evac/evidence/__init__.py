"""Evidence: `evac evidence` recomputes every table, plot and page of docs/evidence/ from scratch."""
