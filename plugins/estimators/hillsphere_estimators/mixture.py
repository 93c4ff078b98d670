r"""Gaussian mixtures of N cases: moments, splitting, merging and modes.

The density of a case is :math:`\sum_j w_j N(\mu_j, S_j S_j^T)`. The components of all cases form
one list, each with the number of its case, so that cases may have different numbers of them and all
are still evaluated in one call of a model.

References
----------
.. [1] Runnalls (2007), Kullback-Leibler approach to Gaussian mixture reduction, IEEE Trans.
   Aerospace and Electronic Systems 43(3): merging that preserves the moments.
.. [2] Salmond (2009), Mixture reduction algorithms for point and extended object tracking in
   clutter, IEEE Trans. Aerospace and Electronic Systems 45(2): the clustering about the heaviest.
.. [3] DeMars, Bishop, Jah (2013), Entropy-based approach for uncertainty propagation of nonlinear
   dynamical systems, J. Guidance, Control, and Dynamics 36(4): splitting along one direction.
.. [4] Carreira-Perpiñán (2000), Mode-finding for mixtures of Gaussian distributions, IEEE Trans.
   Pattern Analysis and Machine Intelligence 22(11), fixed-point iteration.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

from hillsphere.estimation import Belief
from hillsphere.interfaces import Array, Integers
from hillsphere_estimators.roots import lower_root

__all__ = ["Mixture", "MixtureBelief", "Modes", "find_modes", "mixture_of"]

_HALF = 0.5
"""Standard deviation of the parts of a split component along its direction. Halving divides the
curvature across a part, which goes with its square, by four."""
_SPACING = 0.75
"""Distance of the parts, 1.5 of their standard deviations: a row of normal densities so spaced
differs from a smooth one by 2 exp(−2π²/1.5²), 3e-4 of its value (Poisson's sum formula)."""
_NODES = _SPACING * np.arange(-3.0, 4.0)
_PARTS = np.exp(-0.5 * _NODES**2 / (1.0 - _HALF**2))
_PARTS /= _PARTS.sum()
# scaled so that the variance of the whole is exactly that of the component
_NODES *= np.sqrt((1.0 - _HALF**2) / np.sum(_PARTS * _NODES**2))

_LEAST_WEIGHT = 1e-6
"""Weight, over the largest of the case, below which a component is dropped. Five standard
deviations from the mean of a normal density the density is 4e-6 of its largest value."""
_CLIMBS = 500
"""Steps of the search for a mode at most. It converges linearly, in some tens of steps unless
two modes are about to merge."""
_CLIMBED = 1e-4
"""Length of the last step of that search, in standard deviations."""


@dataclass(frozen=True)
class Mixture:
    """Gaussian mixtures of N cases.

    Parameters
    ----------
    owner : ndarray of int, shape (M,)
        Case of each component, in rising order; each of the N cases has at least one.
    weight : ndarray, shape (M,)
        Weights; those of a case add up to 1.
    x : ndarray, shape (n, M)
        Means, SI.
    root : ndarray, shape (M, n, n)
        Lower triangular roots of the covariances.
    """

    owner: Integers
    weight: Array
    x: Array
    root: Array

    @classmethod
    def of(cls, belief: Belief) -> Self:
        """Return one component for each case of a belief."""
        cases = len(belief.t_s)
        return cls(np.arange(cases), np.ones(cases), belief.x, belief.root)

    @property
    def cases(self) -> int:
        """Number of cases, N."""
        return int(self.owner[-1]) + 1 if len(self.owner) else 0

    @property
    def count(self) -> Integers:
        """Number of components of each case, (N,)."""
        return np.asarray(np.bincount(self.owner))

    def lanes(self, t_s: Array) -> Belief:
        """Return the components as M beliefs at the times t_s (N,) of their cases."""
        return Belief(self.x, self.root, t_s[self.owner])

    def take(self, which: NDArray[np.bool_] | Integers) -> Mixture:
        """Return some components, their weights normalised, in the order of the cases."""
        chosen = np.flatnonzero(which) if which.dtype == np.bool_ else which
        chosen = chosen[np.argsort(self.owner[chosen], kind="stable")]
        return Mixture(
            self.owner[chosen], self.weight[chosen], self.x[:, chosen], self.root[chosen]
        ).normalised()

    def normalised(self) -> Mixture:
        """Return the mixtures with weights that add up to 1."""
        total = np.bincount(self.owner, self.weight)
        # cases without components (a part of the cases) have no weight
        return Mixture(self.owner, self.weight / total[self.owner], self.x, self.root)

    def heaviest(self) -> Array:
        """Return the largest weight of each case, (N,)."""
        return np.asarray(np.maximum.reduceat(self.weight, self.starts()))

    def starts(self) -> Integers:
        """Return the first component of each case, (N,)."""
        return np.concatenate([[0], np.cumsum(self.count)[:-1]])

    def merge(self, group: Integers) -> Mixture:
        """Merge the components of equal group to one with their mean and covariance.

        Parameters
        ----------
        group : ndarray of int, shape (M,)
            Numbers 0, 1, … of the groups; a group belongs to one case.

        Returns
        -------
        Mixture
            One component for each group; overall mean and covariance do not change.
        """
        order = np.argsort(group, kind="stable")
        group, owner, weight = group[order], self.owner[order], self.weight[order]
        x, root = self.x[:, order], self.root[order]
        size = np.bincount(group)
        first = np.concatenate([[0], np.cumsum(size)[:-1]])
        total: Array = np.asarray(np.bincount(group, weight), dtype=float)
        share = weight / total[group]
        # about the first component of the group, so that close means keep their digits
        off = x - x[:, first[group]]
        mean = x[:, first] + np.add.reduceat(share * off, first, axis=1)
        made = root[first]
        n = len(x)
        for many in np.unique(size[size > 1]).tolist():
            own = np.flatnonzero(size == many)
            members = first[own][:, None] + np.arange(many)
            part = np.sqrt(share[members])
            spread = (x[:, members] - mean[:, own, None]).transpose(1, 2, 0)
            rows = np.concatenate(
                [np.swapaxes(root[members], 2, 3), spread[:, :, None]], axis=2
            ) * part[:, :, None, None]  # fmt: skip
            made[own] = lower_root(rows.reshape(len(own), many * (n + 1), n))
        again = np.argsort(owner[first], kind="stable")
        return Mixture(owner[first][again], total[again], mean[:, again], made[again])

    def moments(self, t_s: Array) -> Belief:
        """Return mean and covariance of each case at the times t_s (N,)."""
        whole = self.merge(self.owner)
        return Belief(whole.x, whole.root, t_s)

    def drop_light(self) -> Mixture:
        """Drop components of negligible weight."""
        # weights that are not numbers are kept: a case has at least one component
        keep = ~(self.weight < _LEAST_WEIGHT * self.heaviest()[self.owner])
        return self if keep.all() else self.take(keep)

    def merge_close(self, distance: float) -> Mixture:
        """Merge components with the heaviest one that is near them.

        Parameters
        ----------
        distance : float
            Distance of the means in standard deviations of the heavier component.
        """
        if len(self.owner) == self.cases:
            return self
        places, squares = self._distances()
        weight = np.where(places >= 0, self.weight[places], -1.0)
        group = np.full(places.shape, -1)
        free = places >= 0
        row = np.arange(len(places))
        made = 0
        while free.any():
            # each pass takes the heaviest free component of every case, with its neighbours
            open_ = np.asarray(free.any(axis=1))
            centre = np.argmax(np.where(free, weight, -1.0), axis=1)
            near: NDArray[np.bool_] = np.less_equal(squares[row, centre], distance**2)
            own: NDArray[np.bool_] = free & near & open_[:, None]
            own[row[open_], centre[open_]] = True
            group[own] = (made + np.cumsum(open_) - 1)[np.nonzero(own)[0]]
            made += int(open_.sum())
            free &= ~own
        flat = np.empty(len(self.owner), dtype=np.int64)
        flat[places[places >= 0]] = group[places >= 0]
        return self if made == len(self.owner) else self.merge(flat)

    def split(self, which: Integers, along: Array) -> Mixture:
        """Split components along directions into seven parts of half their width [3]_.

        Parameters
        ----------
        which : ndarray of int, shape (K,)
            Components.
        along : ndarray, shape (K, n)
            Unit vectors u in the coordinates z of x = μ + S z.

        Returns
        -------
        Mixture
            With the parts in place of the components; mean and covariance do not change.
        """
        keep = np.ones(len(self.owner), dtype=bool)
        keep[which] = False
        root, parts, n = self.root[which], len(_NODES), len(self.x)
        # S (1 − (1 − σ²) u uᵀ) Sᵀ has the root S (1 − (1 − σ) u uᵀ)
        line = (root @ along[:, :, None])[:, :, 0]
        small = root - (1.0 - _HALF) * line[:, :, None] * along[:, None]
        small = lower_root(np.swapaxes(small, 1, 2))
        x = self.x[:, which, None] + line.T[:, :, None] * _NODES
        weight = self.weight[which][:, None] * _PARTS
        made = Mixture(
            np.concatenate([self.owner[keep], np.repeat(self.owner[which], parts)]),
            np.concatenate([self.weight[keep], weight.ravel()]),
            np.concatenate([self.x[:, keep], x.reshape(n, -1)], axis=1),
            np.concatenate([self.root[keep], np.repeat(small, parts, axis=0)]),
        )
        return made.take(np.arange(len(made.owner)))

    def _distances(self) -> tuple[Integers, Array]:
        """Return the table of components (N, J), −1 where there is none, and their distances.

        The squares (N, J, J) are those of the k-th mean from the j-th in the latter's standard
        deviations.
        """
        count, first = self.count, self.starts()
        places = first[:, None] + np.arange(count.max())
        places = np.where(np.arange(count.max()) < count[:, None], places, -1)
        off = (
            self.x[:, places].transpose(1, 0, 2)[:, None]
            - self.x[:, places].transpose(1, 2, 0)[..., None]
        )
        white = np.linalg.solve(self.root[places], off)
        return places, np.asarray(np.sum(white**2, axis=2))


@dataclass(frozen=True)
class MixtureBelief(Belief):
    """A belief whose distribution is a Gaussian mixture.

    Mean and covariance are those of the whole mixture, so that every function of a `Belief` can use
    it. With several modes the mean may lie where the density is small: see `find_modes`.

    Parameters
    ----------
    x : ndarray, shape (n, N)
        Means of the mixtures, SI.
    root : ndarray, shape (N, n, n)
        Lower triangular square roots S of their covariances S Sᵀ.
    t_s : ndarray, shape (N,)
        Times, s.
    mixture : Mixture, optional
        The components; without them the belief is normal.
    unresolved : ndarray, shape (N,), optional
        Variance that curvature has added to the measurements of a component, on average, and in the
        worst update so far, in units of the noise's variance, where there were not enough
        components to split them further; 0 where there were.
    """

    mixture: Mixture | None = None
    unresolved: Array | None = None

    @classmethod
    def of_mixture(cls, mixture: Mixture, t_s: Array, unresolved: Array) -> Self:
        """Return the belief of mixtures of N cases at the times t_s (N,)."""
        whole = mixture.moments(t_s)
        return cls(whole.x, whole.root, t_s, mixture, unresolved)


def mixture_of(belief: Belief) -> tuple[Mixture, Array]:
    """Return the mixture of a belief, and what was left unresolved (N,).

    Parameters
    ----------
    belief : Belief
        A `MixtureBelief`; any other is a mixture of one component for each case.

    Returns
    -------
    mixture : Mixture
        The components.
    unresolved : ndarray, shape (N,)
        See `MixtureBelief`; zeros if it is none.
    """
    if not isinstance(belief, MixtureBelief) or belief.mixture is None:
        return Mixture.of(belief), np.zeros(len(belief.t_s))
    left = belief.unresolved
    return belief.mixture, np.zeros(len(belief.t_s)) if left is None else left


@dataclass(frozen=True)
class Modes:
    """Modes of mixtures of N cases, in each case the heaviest first.

    Parameters
    ----------
    owner : ndarray of int, shape (L,)
        Case of each mode, in rising order.
    weight : ndarray, shape (L,)
        Probability that the states belong to the mode; those of a case add up to 1.
    x : ndarray, shape (n, L)
        Means of the components that belong to the mode, SI.
    root : ndarray, shape (L, n, n)
        Lower triangular roots of their covariances.
    t_s : ndarray, shape (L,)
        Times, s.
    """

    owner: Integers
    weight: Array
    x: Array
    root: Array
    t_s: Array

    def heaviest(self) -> Belief:
        """Return mean and covariance (N) of the heaviest mode of each case."""
        first = np.flatnonzero(np.diff(self.owner, prepend=-1))
        return Belief(self.x[:, first], self.root[first], self.t_s[first])

    def ambiguous(self, probability: float = 0.999) -> NDArray[np.bool_]:
        """Return in which cases (N,) no mode has at least this probability."""
        first = np.flatnonzero(np.diff(self.owner, prepend=-1))
        return np.asarray(self.weight[first] < probability)


def find_modes(belief: Belief) -> Modes:
    r"""Return the modes of a belief with their weights.

    From each component's mean the fixed-point iteration

    .. math:: x \leftarrow \Big(\sum_j p_j P_j^{-1}\Big)^{-1} \sum_j p_j P_j^{-1} \mu_j, \quad
              p_j \propto w_j N(x; \mu_j, P_j)

    climbs to a maximum of the density [4]_. The components that reach the same one belong to it.

    Parameters
    ----------
    belief : Belief
        A `MixtureBelief`; any other belief has one mode in each case.

    Returns
    -------
    Modes
        Modes of all cases.
    """
    mixture, _ = mixture_of(belief)
    peak = _climb(mixture)
    # components that reach the same place form a mode
    placed = Mixture(mixture.owner, mixture.weight, peak, mixture.root)
    group = _same_place(placed)
    whole = mixture.merge(group)
    order = np.lexsort((-whole.weight, whole.owner))
    return Modes(
        whole.owner[order], whole.weight[order], whole.x[:, order], whole.root[order],
        belief.t_s[whole.owner[order]],
    )  # fmt: skip


def _climb(mixture: Mixture) -> Array:
    """Return the maximum of the density (n, M) that is reached from each component."""
    count, first = mixture.count, mixture.starts()
    x = mixture.x.copy()
    inverse = np.linalg.inv(mixture.root)
    known = np.swapaxes(inverse, 1, 2) @ inverse
    height = np.log(mixture.weight) + np.sum(np.log(np.diagonal(inverse, axis1=1, axis2=2)), axis=1)
    for case in np.flatnonzero(count > 1):
        own = slice(first[case], first[case] + count[case])
        mu, at = mixture.x[:, own].T, mixture.x[:, own].T.copy()
        moving = np.ones(len(at), dtype=bool)
        for _ in range(_CLIMBS):
            off = at[moving, None] - mu
            white = np.einsum("jab,ijb->ija", inverse[own], off)
            log = height[own] - 0.5 * np.sum(white**2, axis=2)
            p = np.exp(log - log.max(axis=1, keepdims=True))
            p /= p.sum(axis=1, keepdims=True)
            weighed = np.einsum("ij,jab->iab", p, known[own])
            # about the present place, so that large states keep their digits
            pull = -np.einsum("ij,jab,ijb->ia", p, known[own], off)
            step = np.linalg.solve(weighed, pull[:, :, None])[:, :, 0]
            at[moving] += step
            far = np.einsum("ia,iab,ib->i", step, weighed, step)
            moving[np.flatnonzero(moving)[far <= _CLIMBED**2]] = False
            if not moving.any():
                break
        x[:, own] = at.T
    return x


def _same_place(placed: Mixture) -> Integers:
    """Return the number of the place (M,) that components share, by half a standard deviation."""
    places, squares = placed._distances()
    group = np.full(len(placed.owner), -1)
    made = 0
    for table, own in zip(places, squares, strict=True):
        for j, place in enumerate(table.tolist()):
            if place < 0 or group[place] >= 0:
                continue
            near = (table >= 0) & (own[j] <= 0.25)
            near[j] = True
            members = table[near]
            group[members[group[members] < 0]] = made
            made += 1
    return group
