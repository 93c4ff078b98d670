"""How much work a task of a campaign has."""

from __future__ import annotations

__all__ = ["blocks_of_task", "files_of_task"]

GROUP_S = 1.0
"""Work that makes a task worth its hand-over and its checkpoint."""

MOST_BLOCKS = 64
"""Blocks of a task whose outcomes travel to the run, at most."""

MOST_BYTES = 1 << 26
"""Size of a task's histories at most; a single block may have more."""

MOST_RATE = 40.0
"""Tasks per second at most, so that of many workers none waits for the run. A task of dask costs
the process of the run and its scheduler 13 ms of CPU (docs/theory/large-campaigns.md): it is then
half busy."""

WHOLE_FILE_S = 4.0
"""Work of a file of a large campaign, up to which it is one task: so much is lost with a worker
or by an interruption."""

FEW_SLOTS = 64
"""Workers up to which the last files of a large campaign are divided, so that none is left alone
with one. With more, a file for each is a small part of the work."""

SMALL_FILE_S = 0.1
"""Work of a file that is not worth dividing at the end."""


def blocks_of_task(block_s: float, block_bytes: float, left: int, slots: int) -> int:
    """Return the number of blocks of a task whose outcomes travel to the run.

    Parameters
    ----------
    block_s : float
        Work of a block, s.
    block_bytes : float
        Size of its histories.
    left : int
        Blocks that are not handed out yet.
    slots : int
        Tasks that run at the same time.
    """
    worth = GROUP_S / max(block_s, GROUP_S / MOST_BLOCKS)
    worth = min(worth, MOST_BYTES / block_bytes)
    # Towards the end smaller ones, so that no worker is left alone with a large one.
    return max(1, min(int(worth), left // (2 * slots)))


def files_of_task(block_s: float, blocks_per_file: int, left: int, slots: int) -> int:
    """Return the number of whole files of a task; 0 if files are too long to be tasks.

    Parameters
    ----------
    block_s, left, slots
        As for `blocks_of_task`.
    blocks_per_file : int
        Blocks in a file.
    """
    file_s = block_s * blocks_per_file
    if file_s > max(WHOLE_FILE_S, slots / MOST_RATE):
        return 0
    most = left // (2 * slots * blocks_per_file)
    if not most and slots <= FEW_SLOTS and file_s > SMALL_FILE_S:
        return 0
    worth = max(GROUP_S, slots / MOST_RATE) / max(file_s, 1e-9)  # a clock may show no time
    return max(1, min(int(worth), most))
