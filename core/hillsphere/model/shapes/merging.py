"""Vertices of a mesh that are listed more than once, made one."""

from __future__ import annotations

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from hillsphere.base.arrays import Array, Integers
from hillsphere.base.errors import InputError

__all__ = ["merge_vertices"]


def merge_vertices(
    vertices: Array, faces: Integers, tolerance: float
) -> tuple[Array, Integers, int, int]:
    """Make one vertex of those that coincide.

    Parameters
    ----------
    vertices : ndarray, shape (V, 3)
        Corners.
    faces : ndarray of int, shape (F, 3)
        Rows of `vertices`.
    tolerance : float
        Largest distance of two vertices that coincide, in the unit of `vertices`; 0 for equal ones.

    Returns
    -------
    vertices : ndarray, shape (W, 3)
        Of each group the first.
    faces : ndarray of int, shape (G, 3)
        Without those of which two corners have become one.
    merged : int
        V − W.
    collapsed : int
        F − G.

    Raises
    ------
    InputError
        If vertices form a chain, whose ends are farther from each other than the tolerance.
    """
    equal, first, group = np.unique(
        vertices + 0.0, axis=0, return_index=True, return_inverse=True
    )  # −0 + 0 is 0
    group = group.reshape(-1)
    if tolerance > 0.0:
        pairs = cKDTree(equal).query_pairs(tolerance, output_type="ndarray")
        links = coo_array((np.ones(len(pairs), dtype=bool), pairs.T), shape=(len(equal),) * 2)
        _, labels = connected_components(links, directed=False)
        group = labels[group]
        low, high = (np.full((labels.max() + 1, 3), sign * np.inf) for sign in (1, -1))
        np.minimum.at(low, labels, equal)
        np.maximum.at(high, labels, equal)
        # the diagonal of a box about points that are within the tolerance of each other
        chains = np.linalg.norm(high - low, axis=1) > np.sqrt(3.0) * tolerance
        if chains.any():
            raise InputError(
                f"vertices within {tolerance:g} of each other form chains, {int(chains.sum())} of "
                "them, whose ends are farther apart; give a smaller merge_tolerance"
            )
        first = np.full(labels.max() + 1, len(vertices))
        np.minimum.at(first, group, np.arange(len(vertices)))
    order = np.argsort(first)  # in the order of the file
    rank = np.empty(len(order), dtype=np.int64)
    rank[order] = np.arange(len(order))
    renamed = rank[group][faces]
    a, b, c = renamed.T
    sound = (a != b) & (b != c) & (c != a)
    return (
        vertices[first[order]],
        renamed[sound],
        len(vertices) - len(order),
        int((~sound).sum()),
    )
