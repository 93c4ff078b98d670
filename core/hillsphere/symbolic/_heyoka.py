"""The one place where the compile layer is imported.

heyoka turns expressions into machine code through LLVM. Its on-disk cache of compiled code lives
in the framework's cache directory, or where HEYOKA_CACHE_DIR says. heyoka loads what it finds there
whoever owns it, so that the directory is judged before heyoka is imported, which reads the variable
then, in every process. Plugins import `hillsphere.symbolic` and `hillsphere.dynamics`, never this.
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
    """Switch the on-disk cache off, with one warning, if its directory cannot be written."""
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
