"""The particles: poses, weights, and what each believes of the GPS.

A particle knows where it is, so what it does not know of the GPS (where its fixes are shifted to, in two axes) is
linear and Gaussian given that, and each keeps it in closed form: the Rao-Blackwell idea, as for the maps. With b the
shift, m and V its mean and variance,

    fix = p + b + noise      weight *= N(fix; p + m, V + s^2)      K = V / (V + s^2)      m += K (fix - p - m)

so a fix that is far off for long becomes a shift, and one whose noise is white pulls as it should.
"""

from __future__ import annotations

import numpy as np

from hil_companion.explore.rotation import wrapped

_DRIFT_M2_PS = 0.02**2  # of the shift's variance, per second
_MOST_LOG = 8.0  # of one fix
_GATE = 6.0  # standard deviations


class Particles:
    """`start`: x, y, yaw of all of them."""

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
        """They sum to 1."""
        w = np.exp(self.log_weight - self.log_weight.max())
        return w / w.sum()

    @property
    def n_eff(self) -> float:
        """How many particles really count."""
        w = self.weights
        return float(1.0 / (w * w).sum())

    @property
    def best(self) -> int:
        """The heaviest; of equals the first."""
        return int(np.argmax(self.log_weight))

    def mean(self) -> np.ndarray:
        """x, y, yaw."""
        about = self.pose[self.best]
        return np.asarray(about + self.weights @ self._off(about))

    def covariance(self) -> np.ndarray:
        """Of x, y, yaw."""
        off = self._off(self.mean())
        return np.asarray((off * self.weights[:, None]).T @ off)

    def _off(self, pose: np.ndarray) -> np.ndarray:
        """Of each from a pose."""
        off = self.pose - pose
        off[:, 2] = wrapped(off[:, 2])
        return off

    def scatter(self, mean: np.ndarray, spread: np.ndarray) -> None:
        """Draw each from its own Gaussian: means (n, 3), covariances (n, 3, 3)."""
        draws = self._random.standard_normal((len(self), 3))
        self.pose = mean + np.einsum("nij,nj->ni", np.linalg.cholesky(spread), draws)

    def weigh(self, log_likelihood: np.ndarray) -> None:
        """Add what an observation says."""
        self.log_weight = self.log_weight + log_likelihood
        self.log_weight -= self.log_weight.max()

    def first_fix(self, variance: float) -> None:
        """The first fix says where the receiver puts the start: the shift is not known better than its noise."""
        self.shift_variance = variance

    def fix(self, xy: np.ndarray, moved_since: np.ndarray, variance: float, dt_s: float) -> None:
        """A GPS position; `moved_since`: how far the vehicle has come since it was taken."""
        self.shift_variance += dt_s * _DRIFT_M2_PS
        off = xy + moved_since - self.pose[:, :2] - self.shift
        total = self.shift_variance + variance
        if float((off * off).sum(axis=1).min()) > _GATE * _GATE * total:
            return  # a jump that no particle can explain
        self.weigh(np.maximum(-0.5 * (off * off).sum(axis=1) / total, -_MOST_LOG))
        gain = self.shift_variance / total
        self.shift = self.shift + gain * off
        self.shift_variance *= 1.0 - gain

    def resample(self) -> np.ndarray:
        """Draw anew by weight, with one random number for all; who descends from whom."""
        n = len(self)
        comb = (np.arange(n) + self._random.random()) / n
        ancestors = np.minimum(np.searchsorted(np.cumsum(self.weights), comb), n - 1)
        self.pose, self.shift = self.pose[ancestors], self.shift[ancestors]
        self.log_weight = np.zeros(n)
        return np.asarray(ancestors)
