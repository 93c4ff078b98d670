"""Checkpoint file of a µ synthesis, from which an interrupted one resumes."""

from __future__ import annotations

from collections.abc import Sequence
from hashlib import sha256
from pathlib import Path

import numpy as np

from hillsphere.errors import InputError, StageError
from hillsphere.lti import LtiSystem
from hillsphere.products.product_codec import load_product, save_product
from hillsphere_controllers.dk.search import State
from hillsphere_controllers.mu.blocks import BlockStructure

__all__ = ["CheckpointFile"]


class CheckpointFile:
    """A checkpoint: the state after the last step, in a file.

    Parameters
    ----------
    path : Path
        The file.
    systems : sequence of LtiSystem
        The plant, and the first controller if one is given.
    structure : BlockStructure
        Of Δ.
    options : tuple
        Numbers that the steps depend on.

    Attributes
    ----------
    key : str
        SHA-256 of all these.
    """

    def __init__(
        self,
        path: Path,
        systems: Sequence[LtiSystem],
        structure: BlockStructure,
        options: tuple[float, ...],
    ) -> None:
        self._path = path
        digest = sha256(repr((structure.blocks, options)).encode())
        for system in systems:
            for matrix in (system.a, system.b, system.c, system.d):
                digest.update(repr(matrix.shape).encode())
                digest.update(np.ascontiguousarray(matrix, dtype=float).tobytes())
        self.key = digest.hexdigest()

    def load(self) -> State | None:
        """Return the state, None if there is no file.

        Raises
        ------
        InputError
            If the file is damaged or of another synthesis.
        """
        if not self._path.exists():
            return None
        try:
            state = load_product(self._path)
        except InputError as error:
            raise InputError(f"{error}; remove {self._path} to start again") from error
        if not isinstance(state, State) or state.key != self.key:
            raise InputError(
                f"{self._path} holds the state of another synthesis; remove it, or name another "
                "checkpoint"
            )
        return state

    def keep(self, state: State) -> None:
        """Replace the file.

        Raises
        ------
        StageError
            If it cannot be written.
        """
        try:
            save_product(self._path, state)
        except OSError as error:
            raise StageError(
                f"{self._path} cannot be written: {error.strerror or error}; the previous "
                "step is stored: free the path and resume the run"
            ) from error
