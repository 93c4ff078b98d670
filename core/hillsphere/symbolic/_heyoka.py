"""The only module that imports the compile layer, heyoka.

heyoka compiles expressions to machine code through LLVM. Its cache on the disk lies in the
framework's cache directory, or in HEYOKA_CACHE_DIR. heyoka loads files from there without a check
of their owner. The directory is therefore checked before heyoka is imported, since heyoka reads the
variable at its import in every process. Plugins import `hillsphere.symbolic` and
`hillsphere.dynamics`, never this module.
"""

from __future__ import annotations

import logging
import os
import tempfile
from pathlib import Path

from hillsphere.base.paths import compiled_code_directory

os.environ["HEYOKA_CACHE_DIR"] = str(compiled_code_directory())

import heyoka

__all__ = ["heyoka"]


def _keep_compiled_code(directory: Path) -> None:
    """Use the directory for heyoka's cache, or switch it off with a warning if not writable."""
    try:
        directory.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=directory):
            pass
    except OSError as error:
        heyoka.llvm_state.set_diskcache_enabled(False)
        logging.getLogger("hillsphere").warning(
            "compiled code is not kept: %s cannot be written (%s); set HILLSPHERE_CACHE to a "
            "directory that can",
            directory,
            error.strerror or error,
        )


# A call on four lanes or more would share them among threads of heyoka's own, which wait busily for
# work too small to share. The parallelism here is that of whole pieces of work, in processes
# (`hillsphere.runs.workers`) or threads of the caller's.
heyoka.set_nthreads(1)

# heyoka's logger writes to stdout, which belongs to the results; its errors are raised anyway.
heyoka.set_logger_level_critical()
# heyoka may have been imported before this module, and have read another variable then.
heyoka.llvm_state.set_diskcache_path(os.environ["HEYOKA_CACHE_DIR"])
_keep_compiled_code(Path(os.environ["HEYOKA_CACHE_DIR"]))
