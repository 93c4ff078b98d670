"""A program that calls the command line again and again, each time in a process with limits.

Each line on its standard input is a request in JSON; a line on the standard output says how the
process ended. The process is forked from this one, which has imported what the command line
imports: that saves two seconds of each run. It ends as any other does, by the interpreter's own
shutdown. Whatever it leaves behind becomes a child of this program, which counts it and ends it.
"""

from __future__ import annotations

import ctypes
import json
import os
import resource
import select
import signal
import sys
import time
from contextlib import suppress
from pathlib import Path
from typing import Any

import hillsphere.runs.pipeline
from hillsphere.show.drawing import Drawing

PR_SET_CHILD_SUBREAPER = 36
"""Of prctl(2): orphans of our descendants become our children."""

ORPHANS_S = 3.0
"""Time that what a run has started may take to end after it: idle workers end by themselves once
their channel is closed."""

PATIENCE_S = 30.0
"""A process that is still there so long after the signal is killed."""


def serve(request: dict[str, Any]) -> dict[str, Any] | None:
    """Run the command line as a request says; ``None`` in the process that does.

    Parameters
    ----------
    request : mapping
        ``arguments``; ``directory``, where it runs; ``log``, the file of what it writes;
        ``seconds``, after which it is sent ``signal``; ``memory`` and ``files``, limits in bytes
        of its address space and of each file; ``processes``, a limit of their number; ``draws``,
        whether figures are drawn; ``environment``, variables.

    Returns
    -------
    mapping
        ``code``, negative for a signal; ``seconds`` that it lived; ``signalled``; ``after_s``, from
        the signal to its end; ``lost``, the command lines of processes that it left.
    """
    begin = time.monotonic()
    pid = os.fork()
    if not pid:
        _become(request)
        return None
    with suppress(PermissionError, ProcessLookupError):
        os.setpgid(pid, pid)
    ended = os.pidfd_open(pid)
    found: dict[str, Any] = {"signalled": False, "after_s": 0.0}
    if not select.select([ended], [], [], request.get("seconds", 60.0))[0]:
        found["signalled"], asked = True, time.monotonic()
        os.kill(pid, request.get("signal", signal.SIGTERM))
        if not select.select([ended], [], [], PATIENCE_S)[0]:
            os.kill(pid, signal.SIGKILL)
        select.select([ended], [], [])
        found["after_s"] = time.monotonic() - asked
    os.close(ended)
    _, status, usage = os.wait4(pid, 0)
    found["code"] = os.waitstatus_to_exitcode(status)
    found["seconds"] = time.monotonic() - begin
    found["cpu_s"] = usage.ru_utime + usage.ru_stime
    found["lost"] = _orphans(pid)
    return found


def _become(request: dict[str, Any]) -> None:
    """Make this process, which was just forked, the one that the request describes."""
    os.setpgid(0, 0)
    log = os.open(request["log"], os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o666)
    null = os.open(os.devnull, os.O_RDONLY)
    os.dup2(null, 0)
    os.dup2(log, 1)
    os.dup2(log, 2)
    os.chdir(request["directory"])
    os.environ.update(request.get("environment", {}))
    for limit, name in ((resource.RLIMIT_AS, "memory"), (resource.RLIMIT_FSIZE, "files")):
        if name in request:
            resource.setrlimit(limit, (request[name], request[name]))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    if "processes" in request:
        _limit_processes(request["processes"])
    if not request.get("draws", True):
        # Drawing takes most of the time of a short run.
        vars(hillsphere.runs.pipeline)["draw"] = lambda figure, *, png: Drawing(svg=b"")
    sys.argv = ["hillsphere", *request["arguments"]]


def _limit_processes(most: int) -> None:
    """Let this process and what it starts be no more than so many at a time.

    The system's limit per user does not hold for root, who gets a control group instead.
    """
    if os.geteuid() != 0:
        own = sum(place.stat().st_uid == os.geteuid() for place in Path("/proc").glob("[0-9]*"))
        resource.setrlimit(resource.RLIMIT_NPROC, (own + most, own + most))
        return
    group = control_group()
    assert group is not None
    (group / "pids.max").write_text(str(most))
    (group / "cgroup.procs").write_text(str(os.getpid()))


def control_group() -> Path | None:
    """Return a control group that limits processes, made for this program; None if none can be."""
    for root in ("/sys/fs/cgroup/pids", "/sys/fs/cgroup"):
        place = Path(root, "hillsphere-tests")
        with suppress(OSError):
            place.mkdir(exist_ok=True)
            if (place / "pids.max").exists():
                return place
    return None


def _orphans(group: int) -> list[str]:
    """Wait for what is left of a run; return the command lines of what had to be killed."""
    until = time.monotonic() + ORPHANS_S
    while time.monotonic() < until:
        try:
            if os.waitpid(-1, os.WNOHANG)[0] == 0:
                time.sleep(0.01)
        except ChildProcessError:
            return []
    lost = []
    while children := _children():
        with suppress(ProcessLookupError):  # at once, as they may go on to fork
            os.killpg(group, signal.SIGKILL)
        for child in children:
            with suppress(OSError):
                lost.append(Path(f"/proc/{child}/cmdline").read_text("utf-8").replace("\0", " "))
            with suppress(ProcessLookupError):
                os.kill(child, signal.SIGKILL)
            with suppress(ChildProcessError):
                os.waitpid(child, 0)
    return lost


def _children() -> list[int]:
    pid = os.getpid()
    return [int(n) for n in Path(f"/proc/{pid}/task/{pid}/children").read_text().split()]


def _import_what_runs_import() -> None:
    """Import the command line and every component, without compiling anything."""
    import matplotlib.backends.backend_agg
    import matplotlib.backends.backend_svg  # noqa: F401
    import scipy.stats  # noqa: F401

    import hillsphere.cli.commands
    import hillsphere.cli.running  # noqa: F401
    from hillsphere.plugins import default_registry

    for record in default_registry():
        if record.component.kind != "command":
            record.load_target()


def main() -> None:
    """Serve requests until the standard input ends."""
    ctypes.CDLL(None).prctl(PR_SET_CHILD_SUBREAPER, 1, 0, 0, 0)
    _import_what_runs_import()
    for line in sys.stdin:
        answer = serve(json.loads(line))
        if answer is None:
            from hillsphere.cli import main as hillsphere

            hillsphere()
        sys.stdout.write(json.dumps(answer) + "\n")
        sys.stdout.flush()


if __name__ == "__main__":
    main()
