"""The grid of each level: which of its nodes and edges people can walk on, and the nodes of portals and exits."""
