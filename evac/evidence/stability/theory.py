"""Theory: the step at which DEM becomes unstable, the error of a free walk, overlaps of each model."""

import numpy as np
from scipy.linalg import eigh
from scipy.optimize import brentq
from scipy.spatial import cKDTree

from evac.base.arrays import FloatArray
from evac.evidence.scenes import Scene

#: Bodies this far apart still count as touching [m].
TOUCHING = 1e-9


def touching_pairs(position: FloatArray, radius: FloatArray) -> tuple[np.ndarray, FloatArray, FloatArray]:
    """Return pairs (p, 2) of bodies that touch, their unit normals (p, 2) and gaps (p,) [m]."""
    pairs = cKDTree(position).query_pairs(2.0 * float(radius.max()) + TOUCHING, output_type="ndarray")
    away = position[pairs[:, 0]] - position[pairs[:, 1]]
    distance = np.hypot(away[:, 0], away[:, 1])
    gap = distance - radius[pairs].sum(axis=1)
    near = gap <= TOUCHING
    normal = away[near] / np.maximum(distance[near], TOUCHING)[:, None]
    return pairs[near], normal, gap[near]


def wall_gaps(scene: Scene, position: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the normals (n, w, 2) from each wall to each body, and the gaps (n, w) between their surfaces [m]."""
    walls = scene.building.walls
    start, along = walls[:, :2], walls[:, 2:] - walls[:, :2]
    share = np.einsum("nwk,wk->nw", position[:, None] - start, along) / (along**2).sum(axis=1)
    nearest = start + np.clip(share, 0.0, 1.0)[..., None] * along
    away = position[:, None] - nearest
    distance = np.hypot(away[..., 0], away[..., 1])
    return away / np.maximum(distance, TOUCHING)[..., None], distance - scene.crowd.radius[: len(position), None]


def greatest_frequency(scene: Scene, position: FloatArray, stiffness: float) -> float:
    """Return omega_max [1/s] of the springs between the bodies that touch, walls included.

    The square root of the greatest eigenvalue of M^-1/2 K M^-1/2, K the Hessian of the sum of k D^2 / 2 over the
    contacts: k (n n^T + D / d (1 - n n^T)) for a gap D <= 0 at a distance d of the centres.
    """
    crowd = scene.crowd
    n = len(position)
    hessian = np.zeros((n, 2, n, 2))
    pairs, normals, gaps = touching_pairs(position, crowd.radius)
    for (i, j), normal, gap in zip(pairs, normals, gaps, strict=True):
        distance = gap + crowd.radius[i] + crowd.radius[j]
        along = np.outer(normal, normal)
        block = stiffness * (along + min(gap, 0.0) / distance * (np.eye(2) - along))
        hessian[i, :, i] += block
        hessian[j, :, j] += block
        hessian[i, :, j] -= block
        hessian[j, :, i] -= block
    normal, gap = wall_gaps(scene, position)
    for i, w in zip(*np.nonzero(gap <= TOUCHING), strict=True):
        hessian[i, :, i] += stiffness * np.outer(normal[i, w], normal[i, w])
    root = np.repeat(1.0 / np.sqrt(crowd.mass), 2)
    matrix = root[:, None] * hessian.reshape(2 * n, 2 * n) * root
    return float(np.sqrt(eigh(matrix, eigvals_only=True, subset_by_index=[2 * n - 1, 2 * n - 1])[0]))


def spring_forces(scene: Scene, position: FloatArray, stiffness: float) -> FloatArray:
    """Return the contact forces (n, 2) of DEM [N], in numpy and apart from the engine."""
    radius = scene.crowd.radius
    i, j = np.triu_indices(len(position), 1)
    away = position[i] - position[j]
    distance = np.hypot(away[:, 0], away[:, 1])
    push = stiffness * np.maximum(radius[i] + radius[j] - distance, 0.0) / np.maximum(distance, TOUCHING)
    normal, gap = wall_gaps(scene, position)
    force = np.asarray((stiffness * np.maximum(-gap, 0.0)[..., None] * normal).sum(axis=1))
    np.add.at(force, i, push[:, None] * away)
    np.add.at(force, j, -push[:, None] * away)
    return np.asarray(force)


def uncut_speed(scene: Scene, stiffness: float, step: float, explicit: bool, steps: int) -> float:
    """Return the greatest speed [m/s] after `steps` plain steps of DEM (eq. 17) without limit of their length.

    Except for its velocities, the scene is in equilibrium with the driving forces.
    """
    crowd = scene.crowd
    kept = (1.0 - step / crowd.tau if explicit else np.exp(-step / crowd.tau))[:, None]
    balance = spring_forces(scene, crowd.position, stiffness)
    position, velocity = crowd.position.copy(), crowd.velocity.copy()
    for _ in range(steps):
        force = spring_forces(scene, position, stiffness) - balance
        velocity = kept * velocity + step * force / crowd.mass[:, None]
        position = position + step * velocity
        if not np.abs(velocity).max() < 1.0:
            return np.inf
    return float(np.abs(velocity).max())


def step_limit(frequency: float, tau: float, explicit: bool) -> float:
    """Return the step [s] beyond which a spring of that frequency [1/s] grows, driving included.

    One step multiplies the velocity by a = 1 - h / tau (explicit) or exp(-h / tau) before the spring acts. The
    characteristic polynomial z^2 - (1 + a - h^2 omega^2) z + a has its roots in the unit circle for
    h^2 omega^2 < 2 (1 + a), which for the explicit drive is h^2 omega^2 + 2 h / tau < 4.
    """

    def margin(h: float) -> float:
        kept = 1.0 - h / tau if explicit else np.exp(-h / tau)
        return float(2.0 * (1.0 + kept) - (h * frequency) ** 2)

    return float(brentq(margin, 0.0, 2.0 / frequency, xtol=1e-14))


def walk_lag(tau: float, step: float, duration: float, explicit: bool, midpoint: bool) -> float:
    """Return the greatest error [s], in times of the walking speed, of the steps of a walk from rest (eq. 33).

    u^n = v (1 - a^n) with a = 1 - h/tau (explicit) or exp(-h/tau), and x^n - x^(n-1) = h u^n, or h (u^n + u^(n-1)) / 2
    where a model moves by the mean velocity; against x(t) = v (t - tau (1 - exp(-t/tau))). Infinite where explicit
    steps grow, beyond h = 2 tau.
    """
    number = np.arange(1, round(duration / step) + 1)
    kept = 1.0 - step / tau if explicit else np.exp(-step / tau)
    if kept < -1.0:
        return float("inf")
    velocity = 1.0 - kept**number
    moved = 0.5 * (velocity + 1.0 - kept ** (number - 1)) if midpoint else velocity
    time = step * number
    return float(np.abs(step * np.cumsum(moved) - time - tau * np.expm1(-time / tau)).max())


def lag_limit(lag: float, tau: float, duration: float, explicit: bool, midpoint: bool) -> float:
    """Return the step [s] up to 1 s at which `walk_lag` reaches `lag` [s], NaN where it does not."""

    def beyond(logarithm: float) -> float:
        return walk_lag(tau, float(np.exp(logarithm)), duration, explicit, midpoint) - lag

    longest = np.log(2.0 * tau if explicit and tau < 0.5 else 1.0)
    shortest = np.log(1e-5) if tau > 1e-4 else np.log(0.1 * tau)
    if beyond(longest) < 0.0:
        return float("nan")
    return float(np.exp(brentq(beyond, shortest, longest, xtol=1e-4)))


def allowed_overlap(variant: str, scene: Scene, step: float, stiffness: float, tolerance: float) -> float:
    """Return the overlap [m] that a contact model's theory allows a crowd that starts without one.

    NSM1 its tolerance. NSM2 the path in a step at the greatest desired speed, h v: twice what one body closes on a
    wall by (h v / 2). DEM twice the whole crowd's load F / k, plus the whole crowd's impact v sqrt(m / k) on one
    spring.
    """
    crowd = scene.crowd
    speed = crowd.speed[:, 0]
    if variant.startswith("NSM1"):
        return tolerance
    if variant.startswith("NSM2"):
        return step * float(speed.max())
    load = float((crowd.mass * speed / crowd.tau).sum()) / stiffness
    return 2.0 * load + float(speed.max() * np.sqrt(crowd.mass.sum() / stiffness))
