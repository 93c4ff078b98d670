"""Random numbers that depend on the seed, the names and the case, not on the order of work."""

from __future__ import annotations

from hashlib import sha256

import numpy as np

from hillsphere.base.arrays import Array, Integers

__all__ = ["draws", "name_key"]


def name_key(name: str) -> int:
    """Return the first 8 bytes of the SHA-256 of a name as an integer, for use as a seed."""
    return int.from_bytes(sha256(name.encode("utf-8", "surrogatepass")).digest()[:8], "big")


def draws(seed: int, stage: str, cases: Integers, stream: str, shape: tuple[int, ...]) -> Array:
    """Draw standard normal numbers from a separate generator for each case.

    Parameters
    ----------
    seed : int
        Root seed of the mission, ≥ 0.
    stage : str
        Name of the stage.
    cases : ndarray of int, shape (N,)
        Numbers of the cases, ≥ 0.
    stream : str
        Name of the drawn quantity; streams of different names are independent.
    shape : tuple of int
        Shape of the numbers of one case.

    Returns
    -------
    ndarray, shape (*shape, N)
        From PCG64 seeded by ``SeedSequence(seed, spawn_key=(key of stage, case, key of stream))``:
        the numbers of a case depend on these only, not on the other cases.
    """
    place, what = name_key(stage), name_key(stream)
    out = np.empty((*shape, len(cases)))
    for j, case in enumerate(cases.tolist()):
        key = (place, int(case), what)
        generator = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=key))
        out[..., j] = generator.standard_normal(shape)
    return out
