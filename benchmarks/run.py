"""Run the benchmarks, print the figures side by side, and hold them against the limits.

    python benchmarks/run.py             # every benchmark, fails if a limit is broken
    python benchmarks/run.py gravity     # only those whose name contains "gravity"
    python benchmarks/run.py --no-check  # print only
    python benchmarks/run.py --long      # with what takes minutes

A benchmark is a module ``bench_*.py`` beside this file with a function ``figures()`` that returns
a mapping from figure name to number. The limits stand in ``limits.toml``: ``at_least`` for a ratio
against what a user would otherwise pick, ``at_most`` for a time. Ratios are taken within one run,
so they hold on a noisy or slower machine; the limits on absolute times are generous. A limit with
``long = true`` is one on what only ``--long`` measures, one with ``peer = "package"`` one beside a
package that need not be installed.

How many faults the tests of a module notice is measured by another script, ``mutation.py``, with
its table ``mutation.toml``.
"""

from __future__ import annotations

import argparse
import os
import sys
import tomllib
from collections.abc import Mapping
from importlib.util import find_spec, module_from_spec, spec_from_file_location
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")
LONG = "HILLSPHERE_BENCHMARK_LONG"
"""Set in the environment for the benchmarks to see."""
HERE = Path(__file__).resolve().parent


def load(path: Path) -> Mapping[str, float]:
    """Run one benchmark module and return its figures."""
    spec = spec_from_file_location(path.stem, path)
    if spec is None or spec.loader is None:
        raise ImportError(f"{path} cannot be loaded")
    module = module_from_spec(spec)
    sys.modules[path.stem] = module
    spec.loader.exec_module(module)
    found: Mapping[str, float] = module.figures()
    return found


def verdict(value: float, limit: Mapping[str, float]) -> str | None:
    """Return what is wrong with a figure, or None."""
    if "at_least" in limit and not value >= limit["at_least"]:
        return f"below the limit of {limit['at_least']:g}"
    if "at_most" in limit and not value <= limit["at_most"]:
        return f"above the limit of {limit['at_most']:g}"
    return None


def main() -> int:
    """Run, print, compare; return the exit code."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("name", nargs="?", default="", help="part of a benchmark's name")
    parser.add_argument("--no-check", action="store_true", help="print only")
    parser.add_argument("--long", action="store_true", help="measure what takes minutes too")
    options = parser.parse_args()
    if options.long:
        os.environ[LONG] = "1"
    limits = tomllib.loads((HERE / "limits.toml").read_text())
    modules = [p for p in sorted(HERE.glob("bench_*.py")) if options.name in p.stem]
    if not modules:
        print(f"no benchmark is called {options.name!r}", file=sys.stderr)
        return 2
    failures = 0
    for path in modules:
        topic = path.stem.removeprefix("bench_")
        print(f"\n{topic}")
        found = load(path)
        for name, value in found.items():
            limit = limits.get(topic, {}).get(name, {})
            fault = verdict(value, limit)
            failures += fault is not None
            bound = ", ".join(
                f"{k.replace('_', ' ')} {v:g}" for k, v in limit.items() if k.startswith("at_")
            )
            mark = f"  FAILED: {fault}" if fault else (f"  ({bound})" if bound else "")
            print(f"  {name:<52} {value:>12.4g}{mark}")
        wanted = {
            k
            for k, v in limits.get(topic, {}).items()
            if (options.long or not v.get("long")) and ("peer" not in v or find_spec(v["peer"]))
        }
        for name in sorted(wanted - set(found)):
            failures += 1
            print(f"  {name:<52} {'missing':>12}  FAILED: it has a limit but was not measured")
    if failures:
        print(f"\n{failures} figure(s) break their limits", file=sys.stderr)
    return 1 if failures and not options.no_check else 0


if __name__ == "__main__":
    raise SystemExit(main())
