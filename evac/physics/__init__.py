"""Physics: kernels of the step loop, the contact problem, and base classes of contact models, solvers and forces."""
