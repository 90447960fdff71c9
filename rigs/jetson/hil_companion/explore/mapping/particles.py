"""The particles: poses, weights, and each particle's estimate of the GPS error.

Given a particle's pose, the slowly varying horizontal error of the GPS is linear and Gaussian, so each particle
estimates it in closed form (Rao-Blackwellisation, as for the maps). With b this shift, m and V its mean and variance,

    fix = p + b + noise      weight *= N(fix; p + m, V + s^2)      K = V / (V + s^2)      m += K (fix - p - m)

A lasting error of the fixes is thus estimated as a shift, and only their white noise affects the weights.
"""

from __future__ import annotations

import numpy as np

from hil_companion.navigation.rotation import wrapped

_DRIFT_M2_PS = 0.02**2  # growth of the shift's variance
_MAX_LOG_CHANGE = 8.0  # of a weight by one fix
_GATE = 6.0  # standard deviations


class Particles:
    """A set of particles. `start`: initial x, y, yaw of all particles."""

    def __init__(self, count: int, start: tuple[float, float, float], seed: int) -> None:
        self.pose = np.repeat(np.array([start], float), count, axis=0)
        self.log_weight = np.zeros(count)
        self.shift = np.zeros((count, 2))
        self.shift_variance = 0.0
        self._random = np.random.Generator(np.random.Philox(seed))

    def __len__(self) -> int:
        return len(self.pose)

    @property
    def weights(self) -> np.ndarray:
        """Return the weights, which sum to 1."""
        w = np.exp(self.log_weight - self.log_weight.max())
        return w / w.sum()

    @property
    def n_eff(self) -> float:
        """Return the effective number of particles, 1 / sum w^2."""
        w = self.weights
        return float(1.0 / (w * w).sum())

    @property
    def best(self) -> int:
        """Return the index of the particle with the largest weight; of equal ones the first."""
        return int(np.argmax(self.log_weight))

    def mean(self) -> np.ndarray:
        """Return the weighted mean of x, y, yaw."""
        about = self.pose[self.best]
        return np.asarray(about + self.weights @ self._offsets(about))

    def covariance(self) -> np.ndarray:
        """Return the weighted covariance (3, 3) of x, y, yaw."""
        off = self._offsets(self.mean())
        return np.asarray((off * self.weights[:, None]).T @ off)

    def _offsets(self, pose: np.ndarray) -> np.ndarray:
        """Return the difference (n, 3) of each particle's pose to a pose."""
        off = self.pose - pose
        off[:, 2] = wrapped(off[:, 2])
        return off

    def sample(self, mean: np.ndarray, spread: np.ndarray) -> None:
        """Sample each pose from its own Gaussian: means (n, 3), covariances (n, 3, 3)."""
        draws = self._random.standard_normal((len(self), 3))
        self.pose = mean + np.einsum("nij,nj->ni", np.linalg.cholesky(spread), draws)

    def weigh(self, log_likelihood: np.ndarray) -> None:
        """Multiply the weights by the likelihoods of an observation."""
        self.log_weight = self.log_weight + log_likelihood
        self.log_weight -= self.log_weight.max()

    def first_fix(self, variance: float) -> None:
        """Set the shift's variance to the noise of the first fix, which defines the start."""
        self.shift_variance = variance

    def add_fix(self, xy: np.ndarray, moved_since: np.ndarray, variance: float, dt_s: float) -> None:
        """Weigh by a GPS position and update the shifts. `moved_since`: the vehicle's motion since the fix (2,)."""
        self.shift_variance += dt_s * _DRIFT_M2_PS
        off = xy + moved_since - self.pose[:, :2] - self.shift
        total = self.shift_variance + variance
        if float((off * off).sum(axis=1).min()) > _GATE * _GATE * total:
            return  # an outlier for all particles
        self.weigh(np.maximum(-0.5 * (off * off).sum(axis=1) / total, -_MAX_LOG_CHANGE))
        gain = self.shift_variance / total
        self.shift = self.shift + gain * off
        self.shift_variance *= 1.0 - gain

    def resample(self) -> np.ndarray:
        """Resample by weight (systematic: one random number for all); return the ancestor of each particle."""
        n = len(self)
        comb = (np.arange(n) + self._random.random()) / n
        ancestors = np.minimum(np.searchsorted(np.cumsum(self.weights), comb), n - 1)
        self.pose, self.shift = self.pose[ancestors], self.shift[ancestors]
        self.log_weight = np.zeros(n)
        return np.asarray(ancestors)
