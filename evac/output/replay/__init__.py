"""The replay: a run as one page that opens from disk in any browser and needs nothing else."""
