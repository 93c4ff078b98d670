"""The rotctld protocol: against Hamlib's own daemon, and against one that can be made to fail."""

from __future__ import annotations

import os
import shutil
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import pytest

from hillsphere_tracking.live.rotator import RotatorLink
from hillsphere_tracking.live.rotctl import (
    RotatorError,
    RotatorLostError,
    RotatorRefusedError,
    Rotctl,
)

HOST = "127.0.0.1"


def free_port() -> int:
    with socket.socket() as probe:
        probe.bind((HOST, 0))
        return int(probe.getsockname()[1])


def until(done: Callable[[], bool], within_s: float = 15.0) -> None:
    end = time.monotonic() + within_s
    while not done():
        assert time.monotonic() < end, f"it did not happen within {within_s} s"
        time.sleep(0.01)


@contextmanager
def rotctld(port: int) -> Iterator[subprocess.Popen[bytes]]:
    """Hamlib's daemon with its dummy rotator: 6°/s, azimuth −180…450°, elevation 0…90°."""
    program = shutil.which("rotctld")
    if program is None:
        if os.environ.get("HILLSPHERE_REQUIRE_ROTCTLD"):
            pytest.fail("rotctld is not installed: apt-get install libhamlib-utils")
        pytest.skip("rotctld is not installed (Debian package libhamlib-utils)")
    command = [program, "-m", "1", "-T", HOST, "-t", str(port)]
    with subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as process:
        try:
            until(lambda: answers(port))
            yield process
        finally:
            process.kill()


def answers(port: int) -> bool:
    try:
        with Rotctl(HOST, port):
            return True
    except RotatorLostError:
        return False


def keep_pointing(link: RotatorLink, done: Callable[[], bool]) -> None:
    """Send the same command again and again, as a tracker does."""

    def pointed() -> bool:
        link.point(5.0, 6.0)
        return done()

    until(pointed)


class FakeRotctld:
    """Answers as rotctld does, and fails when it is told to."""

    def __init__(self, port: int = 0) -> None:
        self.server = socket.create_server((HOST, port))
        self.port = int(self.server.getsockname()[1])
        self.position = (0.0, 0.0)
        self.commands: list[str] = []
        self.connections = 0
        self.answer: Callable[[str], str | None] | None = None
        """Takes the place of the usual answers; None: no answer at all."""
        self._open: list[socket.socket] = []
        threading.Thread(target=self._accept, daemon=True).start()

    def _accept(self) -> None:
        while True:
            try:
                connection, _ = self.server.accept()
            except OSError:
                return
            self.connections += 1
            self._open.append(connection)
            threading.Thread(target=self._serve, args=(connection,), daemon=True).start()

    def _serve(self, connection: socket.socket) -> None:
        try:
            with connection, connection.makefile("rw", newline="\n") as stream:
                for line in stream:
                    command = line.strip()
                    self.commands.append(command)
                    given = self.answer(command) if self.answer else self._usual(command)
                    if given is not None:
                        stream.write(given)
                        stream.flush()
        except (OSError, ValueError):
            return

    def _usual(self, command: str) -> str:
        word, *values = command.split()
        if word == "p":
            return "{:.2f}\n{:.2f}\n".format(*self.position)
        if word == "P":
            azimuth, elevation = (float(value) for value in values)
            if not (-180.0 <= azimuth <= 450.0 and 0.0 <= elevation <= 90.0):
                return "RPRT -1\n"
            self.position = azimuth, elevation
        return "RPRT 0\n"

    def hang_up(self) -> None:
        """Close all connections; new ones are taken."""
        while self._open:
            connection = self._open.pop()
            with suppress(OSError):
                connection.shutdown(socket.SHUT_RDWR)
            connection.close()

    def close(self) -> None:
        # close alone would leave it listening for as long as the thread waits in accept
        with suppress(OSError):
            self.server.shutdown(socket.SHUT_RDWR)
        self.server.close()
        self.hang_up()


@pytest.fixture
def fake() -> Iterator[FakeRotctld]:
    made = FakeRotctld()
    yield made
    made.close()


def test_hamlib_dummy_rotator() -> None:
    port = free_port()
    with rotctld(port), Rotctl(HOST, port) as client:
        client.set_position(12.5, 6.25)
        until(lambda: client.position() == (12.5, 6.25))
        with pytest.raises(RotatorRefusedError, match="RPRT -1, invalid parameter") as refused:
            client.set_position(500.0, 10.0)
        assert refused.value.code == -1
        client.set_position(-170.0, 0.0)
        client.stop()
        assert client.position()[0] > -60.0  # on the way there for half a minute


def test_hamlib_daemon_dies_and_comes_back() -> None:
    port = free_port()
    said: list[str] = []
    link = RotatorLink(lambda: Rotctl(HOST, port, 1.0), said.append)
    with rotctld(port):
        assert link.start() == (0.0, 0.0)
        link.point(1.0, 2.0)
        until(lambda: link.sent == 1)
    before = link.sent
    link.point(3.0, 4.0)
    until(lambda: any("trying again" in line for line in said))
    with rotctld(port):
        keep_pointing(link, lambda: link.sent > before)
        with Rotctl(HOST, port) as other:
            until(lambda: other.position() == (5.0, 6.0))
        assert link.end()
    assert "the rotator is connected again" in said


def test_a_pass_through_hamlib(tmp_path: Path) -> None:
    (tmp_path / "iss.tle").write_text(
        "1 25544U 98067A   19343.69339541  .00001764  00000-0  38792-4 0  9991\n"
        "2 25544  51.6439 211.2001 0007417  17.6667  85.6398 15.50103472202482\n"
    )
    (tmp_path / "m.csv").write_text("2019-12-09T23:05:04,354.67,5.08\n")
    port = free_port()
    command = [sys.executable, "-m", "hillsphere", "track", "m.csv", "--elements", "iss.tle"]
    command += ["--latitude", "-2.18", "--longitude", "-44.26", "--azimuth-limits", "-180", "450"]
    command += ["--replay", "--speed", "80", "--period", "0.5", "--rotator", f"{HOST}:{port}"]
    with rotctld(port):
        done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stderr
        assert "refused" not in done.stderr
        assert "connection" not in done.stderr
        with Rotctl(HOST, port) as client:
            # the pass goes from 355° by east to 126°; 6°/s is too slow for a replay, not for life
            azimuth, _ = client.position()
            assert azimuth != 0.0
            time.sleep(0.3)
            assert client.position()[0] == azimuth  # it was stopped


def test_hamlib_is_killed_during_a_pass(tmp_path: Path) -> None:
    """The daemon dies with its connection and comes back on the same port; the pass goes on."""
    (tmp_path / "iss.tle").write_text(
        "1 25544U 98067A   19343.69339541  .00001764  00000-0  38792-4 0  9991\n"
        "2 25544  51.6439 211.2001 0007417  17.6667  85.6398 15.50103472202482\n"
    )
    (tmp_path / "m.csv").write_text("2019-12-09T23:05:04,354.67,5.08\n")
    port = free_port()
    command = [sys.executable, "-m", "hillsphere", "track", "m.csv", "--elements", "iss.tle"]
    command += ["--latitude", "-2.18", "--longitude", "-44.26", "--azimuth-limits", "-180", "450"]
    command += ["--replay", "--speed", "150", "--period", "0.5", "--rotator", f"{HOST}:{port}"]
    told: list[str] = []

    def tells(process: subprocess.Popen[str], what: str) -> None:
        assert process.stderr is not None
        for line in process.stderr:
            told.append(line)
            if what in line:
                return
        pytest.fail(f"{what!r} was not told: {told}")

    with (
        rotctld(port) as daemon,
        subprocess.Popen(command, cwd=tmp_path, stderr=subprocess.PIPE, text=True) as process,
    ):
        tells(process, "the signal is there")
        daemon.kill()
        daemon.wait()
        tells(process, "trying again")
        tells(process, "NO SIGNAL")  # the tracker goes on meanwhile
        with rotctld(port):
            tells(process, "the rotator is connected again")
            with Rotctl(HOST, port) as client:
                until(lambda: client.position() != (0.0, 0.0))
                assert process.stderr is not None
                told.append(process.stderr.read())
                assert process.wait(30) == 0, told
                azimuth, _ = client.position()
                time.sleep(0.3)
                assert client.position()[0] == azimuth  # it was stopped
    assert "Traceback" not in "".join(told)


def test_what_is_sent(fake: FakeRotctld) -> None:
    with Rotctl(HOST, fake.port) as client:
        client.set_position(120.0, 35.5)
        assert client.position() == (120.0, 35.5)
        client.stop()
    assert fake.commands == ["P 120.0000 35.5000", "p", "S"]


@pytest.mark.parametrize(
    ("answer", "message"),
    [
        ("RPRT -6\n", "refused 'P 1.0000 2.0000': RPRT -6, input/output error"),
        ("RPRT -9\n", "RPRT -9, command rejected by the rotator"),
        ("RPRT -99\n", "RPRT -99, unknown code"),
    ],
)
def test_codes_are_named(fake: FakeRotctld, answer: str, message: str) -> None:
    fake.answer = lambda command: answer
    with Rotctl(HOST, fake.port) as client:
        with pytest.raises(RotatorRefusedError, match=message):
            client.set_position(1.0, 2.0)
        with pytest.raises(RotatorRefusedError, match="refused 'p'"):
            client.position()
        fake.answer = None
        client.set_position(1.0, 2.0)  # the connection is as good as before


@pytest.mark.parametrize(
    ("answer", "message"),
    [
        (None, "no answer in time"),
        ("RPRT", "no answer in time"),
        ("hello\n", "it answered 'P 1.0000 2.0000' with 'hello'"),
        ("x" * 1000, "something else than the answers"),
    ],
)
def test_no_answer_that_can_be_understood(
    fake: FakeRotctld, answer: str | None, message: str
) -> None:
    fake.answer = lambda command: answer
    with Rotctl(HOST, fake.port, 0.2) as client:
        with pytest.raises(RotatorLostError, match=message):
            client.set_position(1.0, 2.0)
        with pytest.raises(RotatorLostError):  # late answers must not be taken for others
            client.position()


def test_a_position_that_is_none(fake: FakeRotctld) -> None:
    fake.answer = lambda command: "nan\n1\n"
    with Rotctl(HOST, fake.port) as client, pytest.raises(RotatorLostError, match="'nan' and '1'"):
        client.position()


def test_nobody_there() -> None:
    port = free_port()
    with pytest.raises(RotatorLostError, match=f"no rotctld at {HOST}:{port}: Connection refused"):
        Rotctl(HOST, port)
    with pytest.raises(RotatorError):
        RotatorLink(lambda: Rotctl(HOST, port), pytest.fail).start()


def test_link_sends_the_newest_and_survives_a_lost_connection(fake: FakeRotctld) -> None:
    said: list[str] = []
    link = RotatorLink(lambda: Rotctl(HOST, fake.port, 1.0), said.append)
    fake.position = (7.0, 8.0)
    assert link.start() == (7.0, 8.0)
    for k in range(200):
        link.point(float(k), 1.0)
    until(lambda: fake.position == (199.0, 1.0))
    fake.hang_up()
    keep_pointing(link, lambda: fake.connections == 2 and fake.position == (5.0, 6.0))
    assert "trying again in 0.25 s" in said[0]
    assert said[1] == "the rotator is connected again"
    assert link.end()
    assert fake.commands[-1] == "S"


def test_link_tells_a_refusal_once(fake: FakeRotctld) -> None:
    said: list[str] = []
    link = RotatorLink(lambda: Rotctl(HOST, fake.port), said.append)
    link.start()
    for k in range(5):
        before = len(fake.commands)
        link.point(500.0 + k, 1.0)
        until(lambda before=before: len(fake.commands) > before)  # type: ignore[misc]
    assert link.end()
    assert len(said) == 1
    assert "RPRT -1" in said[0]


def test_link_waits_longer_and_longer_but_ends_at_once(fake: FakeRotctld) -> None:
    said: list[str] = []
    link = RotatorLink(lambda: Rotctl(HOST, fake.port, 0.2), said.append)
    link.start()
    fake.close()
    keep_pointing(link, lambda: len(said) >= 3)
    waits = [float(line.rpartition("in ")[2].split()[0]) for line in said]
    assert waits[:3] == [0.25, 0.5, 1.0]
    begun = time.monotonic()
    assert not link.end()
    assert time.monotonic() - begun < 3.0
    assert "was not stopped" in said[-1]
