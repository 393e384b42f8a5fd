"""Kernels of the step loop, the contact problem and its solvers, base classes of contact models and forces."""
