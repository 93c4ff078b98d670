"""The one place where the compile layer is imported.

heyoka turns expressions into machine code through LLVM. Its on-disk cache of compiled code lives
in the framework's cache directory; heyoka reads the variable when it is imported, hence this
module. Plugins import `hillsphere.symbolic` and `hillsphere.dynamics`, never this.
"""

from __future__ import annotations

import os

from hillsphere.paths import cache_directory

os.environ.setdefault("HEYOKA_CACHE_DIR", str(cache_directory() / "compiled"))

import heyoka

__all__ = ["heyoka"]
