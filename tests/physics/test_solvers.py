"""Contact solvers against a quadratic program solved by other means, and the residual against its definition."""

import numpy as np
import pytest
from scipy.optimize import nnls

from evac.jit import Floats, kernel
from evac.physics import state as structs
from evac.physics.contact.rows import AX, BX, INELASTIC, law, row_energy
from evac_plugins.solver_gradient import constraint_norm
from tests.physics.contact_problems import do_pack, find_residual, make_problem_state, ring, run_solver
from tests.physics.scenes import SOLVERS

DISSIPATION = [0.0, 10.0, 1e3, 1e5]


@kernel
def find_norm(rows: structs.Problem) -> float:
    return constraint_norm(rows)


@kernel
def find_slopes(rows: structs.Problem, x: float, slopes: Floats, laws: Floats) -> None:
    for r in range(rows.size):
        slopes[r] = (row_energy(rows, r, x + 1e-4) - row_energy(rows, r, x - 1e-4)) / 2e-4
        i, j = rows.body[r], rows.other[r]
        for k in range(2):  # a row is a unit vector: these have the velocity minus the slope along it
            rows.velocity[i, k] = -slopes[r] * rows.data[r, AX + k]
            rows.velocity[j, k] = -slopes[r] * rows.data[r, BX + k]
        laws[r] = x + law(rows, r, x, rows.rigid == 1)


class Problem:
    """A random contact problem among n bodies and walls, as arrays and as matrices."""

    def __init__(self, seed, n=6, pairs=7, walls=3, biased=True):
        random = np.random.default_rng(seed)
        c = pairs + walls
        self.mass = random.uniform(50.0, 100.0, n)
        body = np.empty(c, np.int32)
        other = np.full(c, -1, np.int32)
        for k in range(pairs):
            body[k], other[k] = np.sort(random.choice(n, 2, replace=False))
        body[pairs:] = random.choice(n, walls, replace=False)
        angle = random.uniform(0.0, 2.0 * np.pi, c)
        self.normal = np.column_stack([np.cos(angle), np.sin(angle)])
        self.free = random.normal(0.0, 1.5, (n, 2))
        self.gradient = np.zeros((c, 2 * n))  # rows of G: w = G v
        for k in range(c):
            self.gradient[k, 2 * body[k] : 2 * body[k] + 2] = self.normal[k]
            if other[k] >= 0:
                self.gradient[k, 2 * other[k] : 2 * other[k] + 2] = -self.normal[k]
        self.inverse = np.repeat(1.0 / self.mass, 2)
        self.delassus = self.gradient * self.inverse @ self.gradient.T
        self.omega = np.diag(self.delassus).copy()
        self.bias = random.uniform(0.0, 0.5, c) if biased else np.zeros(c)
        self.velocity_before = self.gradient @ random.normal(0.0, 1.5, 2 * n)
        self.state = make_problem_state(1.0 / self.mass, c)
        self.contacts = self.state.contacts
        for name, values in (
            ("body", body), ("other", other), ("normal", self.normal), ("omega", self.omega),
            ("bias", self.bias), ("velocity_before", self.velocity_before),
        ):  # fmt: skip
            getattr(self.contacts, name)[:] = values

    def solve(self, solver, dissipation=0.0, tolerance=1e-11, limit=400000):
        velocity = np.zeros_like(self.free)
        compliance = 2.0 / dissipation if dissipation else INELASTIC
        iterations, found = run_solver(solver, self.state, self.free, velocity, compliance, 0.0, tolerance, limit)
        assert found <= tolerance
        assert iterations > 0
        return velocity, self.contacts.percussion.copy()

    def slide(self, tangential_before):
        """Let every contact slide: the tangential law acts, with these tangential velocities before the step."""
        self.tangents = np.zeros_like(self.gradient)
        self.tangents[:, ::2], self.tangents[:, 1::2] = -self.gradient[:, 1::2], self.gradient[:, ::2]
        self.tangential_before = tangential_before
        self.contacts.sticky[:] = 1
        self.contacts.slide_before[:] = tangential_before

    def reference(self, dissipation=0.0, tangential=0.0):
        """Return the velocities as the point nearest to the free ones under the constraints.

        NSM1, and NSM2 with K_N = 0: min 1/2 |v - V|_M^2 with G v + b >= 0. With K_N > 0 the pseudopotential
        K_N/4 max(0, -(w+ + w-))^2 is added, with a slack for the maximum, with K_T > 0 another, K_T/4 (w_T+ + w_T-)^2,
        which changes the metric and the point. Scaled to a least-distance problem, min |x| with E x >= f, it is
        solved by non-negative least squares (Lawson and Hanson, 1974, chapter 23).
        """
        metric, pull = np.diag(1.0 / self.inverse), self.free.ravel() / self.inverse
        if tangential > 0.0:
            metric = metric + 0.5 * tangential * self.tangents.T @ self.tangents
            pull = pull - 0.5 * tangential * self.tangents.T @ self.tangential_before
        nearest_free = np.linalg.solve(metric, pull)
        lower = np.linalg.inv(np.linalg.cholesky(metric))
        root = self.gradient @ lower.T
        free = self.gradient @ nearest_free
        left, right = root, -free - self.bias
        if dissipation > 0.0:
            c = len(free)
            left = np.block([[root, np.zeros((c, c))], [root, np.sqrt(2.0 / dissipation) * np.eye(c)]])
            right = np.concatenate([-free - self.bias, -free - self.velocity_before])
        target = np.append(np.zeros(left.shape[1]), 1.0)
        system = np.vstack([left.T, right])
        share, _ = nnls(system, target, maxiter=10000)
        rest = system @ share - target
        nearest = -rest[: root.shape[1]] / rest[-1]
        return (nearest_free + lower.T @ nearest).reshape(-1, 2)

    def law(self, velocity, percussion, dissipation):
        """Return the residual max omega |P - P_local| by its definition."""
        after = self.gradient @ velocity.ravel()
        alone = after - self.omega * percussion
        local = np.maximum(0.0, -(alone + self.bias) / self.omega)
        if dissipation > 0.0:
            local = np.maximum(local, -(alone + self.velocity_before) / (self.omega + 2.0 / dissipation))
        return np.max(self.omega * np.abs(percussion - local))


@pytest.mark.parametrize("solver", SOLVERS)
@pytest.mark.parametrize("seed", range(6))
def test_nsm1_problem_is_the_projection(solver, seed):
    problem = Problem(seed)
    velocity, percussion = problem.solve(solver)
    np.testing.assert_allclose(velocity, problem.reference(), rtol=0, atol=1e-8)
    gap = problem.gradient @ velocity.ravel() + problem.bias
    assert (percussion >= 0.0).all()
    assert gap.min() >= -1e-9
    assert np.abs(percussion * gap).max() <= 1e-7  # N s times m/s


@pytest.mark.parametrize("solver", SOLVERS)
@pytest.mark.parametrize("dissipation", DISSIPATION)
@pytest.mark.parametrize("seed", range(4))
def test_nsm2_problem_is_the_minimum_of_its_pseudopotential(solver, dissipation, seed):
    problem = Problem(seed, biased=False)
    velocity, percussion = problem.solve(solver, dissipation)
    np.testing.assert_allclose(velocity, problem.reference(dissipation), rtol=0, atol=1e-7)
    after = problem.gradient @ velocity.ravel()
    spring = dissipation * np.maximum(0.0, -(after + problem.velocity_before) / 2.0)
    reaction = percussion - spring
    scale = 1.0 + dissipation
    assert after.min() >= -1e-9
    assert reaction.min() >= -1e-9 * scale
    assert np.abs(reaction * after).max() <= 1e-8 * scale


@pytest.mark.parametrize("solver", SOLVERS)
@pytest.mark.parametrize("dissipation", DISSIPATION)
def test_gaps_and_dissipation_together_are_the_minimum_too(solver, dissipation):
    for seed in range(4):
        problem = Problem(seed)
        velocity, _ = problem.solve(solver, dissipation)
        np.testing.assert_allclose(velocity, problem.reference(dissipation), rtol=0, atol=1e-7)


@pytest.mark.parametrize("solver", [name for name in SOLVERS if name != "uzawa"])  # its step knows no tangential rows
@pytest.mark.parametrize("tangential", [50.0, 1e3])
@pytest.mark.parametrize("dissipation", [0.0, 1e3])
def test_sliding_contacts_are_the_minimum_too(solver, tangential, dissipation):
    for seed in range(3):
        problem = Problem(seed, biased=False)
        problem.slide(np.random.default_rng(seed + 10).normal(0.0, 1.5, len(problem.omega)))
        velocity = np.zeros_like(problem.free)
        compliance = 2.0 / dissipation if dissipation else INELASTIC
        _, found = run_solver(solver, problem.state, problem.free, velocity, compliance, tangential, 1e-11, 400000)
        assert found <= 1e-11
        assert find_residual(problem.state, velocity, compliance, tangential) <= 1.001e-11
        np.testing.assert_allclose(velocity, problem.reference(dissipation, tangential), rtol=0, atol=1e-7)


@pytest.mark.parametrize("solver", SOLVERS)
@pytest.mark.parametrize("limit", [5, 17, 70])
def test_velocities_belong_to_the_percussions_wherever_a_solve_ends(solver, limit):
    state, free = ring(40)
    contacts, velocity = state.contacts, np.zeros_like(free)
    _, found = run_solver(solver, state, free, velocity, 2e-3, 0.0, 1e-14, limit)
    expected = free.copy()
    for body, other, normal, percussion in zip(
        contacts.body, contacts.other, contacts.normal, contacts.percussion, strict=True
    ):
        expected[body] += percussion * normal / 80.0
        expected[other] -= percussion * normal / 80.0
    np.testing.assert_allclose(velocity, expected, rtol=0, atol=1e-11)
    assert found == pytest.approx(find_residual(state, velocity, 2e-3, 0.0), rel=1e-6, abs=1e-12)


@pytest.mark.parametrize("solver", SOLVERS)
@pytest.mark.parametrize("dissipation", [0.0, 1e3])
def test_a_solve_forgets_what_another_one_left(solver, dissipation):
    fresh, used = Problem(3), Problem(3)
    for array in used.state.problem.values().values():
        if isinstance(array, np.ndarray):
            array[...] = np.nan if array.dtype == np.float64 else 1
    for one, other in zip(fresh.solve(solver, dissipation), used.solve(solver, dissipation), strict=True):
        np.testing.assert_array_equal(one, other)


@pytest.mark.parametrize("solver", SOLVERS)
def test_numbers_that_are_none_are_no_solution(solver):
    problem = Problem(0)
    problem.free[0, 0] = np.nan
    velocity = np.zeros_like(problem.free)
    _, found = run_solver(solver, problem.state, problem.free, velocity, INELASTIC, 0.0, 1e-6, 50)
    assert np.isinf(found)


@pytest.mark.parametrize("dissipation", [0.0, 1e3])
@pytest.mark.parametrize("x", [0.5, 30.0])
def test_the_energy_of_a_row_falls_as_the_law_says(dissipation, x):
    """Minus its slope is the velocity at which the law leaves x as it is."""
    problem = Problem(3)
    compliance = 2.0 / dissipation if dissipation else INELASTIC
    slopes, laws = np.zeros_like(problem.omega), np.zeros_like(problem.omega)
    do_pack(problem.state, problem.free, compliance, 0.0)
    find_slopes(problem.state.problem, x, slopes, laws)
    np.testing.assert_allclose(laws, x, rtol=0, atol=1e-6)


@pytest.mark.parametrize("solver", SOLVERS)
def test_velocity_is_the_free_one_and_the_percussions(solver):
    problem = Problem(11)
    velocity, percussion = problem.solve(solver, 1e3)
    expected = problem.free + (problem.inverse * (problem.gradient.T @ percussion)).reshape(-1, 2)
    np.testing.assert_allclose(velocity, expected, rtol=0, atol=1e-11)


@pytest.mark.parametrize("dissipation", DISSIPATION)
def test_residual_is_its_definition(dissipation):
    for seed in range(5):
        problem = Problem(seed)
        problem.contacts.percussion[:] = np.random.default_rng(seed).exponential(40.0, len(problem.omega))
        velocity = problem.free + 0.1
        compliance = 2.0 / dissipation if dissipation else INELASTIC
        found = find_residual(problem.state, velocity, compliance, 0.0)
        assert found == pytest.approx(problem.law(velocity, problem.contacts.percussion, dissipation), rel=1e-12)
        assert found > 0.1


@pytest.mark.parametrize("solver", SOLVERS)
def test_a_warm_start_from_the_answer_needs_no_iteration(solver):
    problem = Problem(2)
    first, _ = problem.solve(solver, 1e3, tolerance=1e-10)
    velocity = np.zeros_like(first)
    iterations, _ = run_solver(solver, problem.state, problem.free, velocity, 2e-3, 0.0, 1e-9, 100)
    assert iterations == 0
    np.testing.assert_allclose(velocity, first, rtol=0, atol=1e-9)


@pytest.mark.parametrize("solver", SOLVERS)
def test_what_did_not_converge_says_so(solver):
    problem = Problem(3)
    velocity = np.zeros_like(problem.free)
    iterations, found = run_solver(solver, problem.state, problem.free, velocity, INELASTIC, 0.0, 1e-14, 1)
    assert iterations == 1
    assert found > 1e-14
    assert found == pytest.approx(problem.law(velocity, problem.contacts.percussion, 0.0), rel=1e-9)


@pytest.mark.parametrize("seed", [2, 3])
def test_overlaps_are_parted_to_rounding(seed):
    """From rest the energy starts at zero, where no rise is small beside it."""
    state, free = ring(60, seed)
    state.contacts.bias[:] = -np.random.default_rng(2).uniform(0.0, 0.1, len(state.contacts.bias))
    velocity = np.zeros_like(free)
    iterations, found = run_solver("accelerated_sweeps", state, 0.0 * free, velocity, INELASTIC, 0.0, 1e-11, 3000)
    assert found <= 1e-11
    assert iterations < 1000


def test_uzawa_bound_is_the_greatest_eigenvalue():
    for seed in range(10):
        problem = Problem(seed)
        do_pack(problem.state, problem.free, INELASTIC, 0.0)
        found = find_norm(problem.state.problem)
        exact = np.linalg.eigvalsh(problem.gradient @ problem.gradient.T)[-1]
        assert 0.97 * exact <= found <= exact * (1 + 1e-12)  # rho is 0.95 of the bound, so below it


def test_tangential_law():
    """One contact that slides: K_T Y_T opposes, with Y_T the mean of the sliding velocity before and after."""
    problem = Problem(1, n=2, pairs=1, walls=0, biased=False)
    contacts = problem.contacts
    tangent = np.array([-problem.normal[0, 1], problem.normal[0, 0]])
    first, second = contacts.body[0], contacts.other[0]
    before = 0.8
    contacts.sticky[0], contacts.slide_before[0] = 1, before
    velocity = np.zeros((2, 2))
    run_solver("gauss_seidel", problem.state, problem.free, velocity, INELASTIC, 300.0, 1e-12, 1000)
    after = tangent @ (velocity[first] - velocity[second])
    assert contacts.friction[0] == pytest.approx(-300.0 * (before + after) / 2.0, rel=1e-9)
    free = tangent @ (problem.free[first] - problem.free[second])
    assert after == pytest.approx(free + problem.omega[0] * contacts.friction[0], rel=1e-9)
