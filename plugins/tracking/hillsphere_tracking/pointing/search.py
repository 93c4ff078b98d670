r"""Where to look after a loss: a spiral on the sky about the prediction, sized by its covariance.

The error of a prediction lies within an ellipse on the sky, mostly long and thin along the track.
It is searched along the curve that winds around the segment between the ellipse's inner centres:
out along the major axis, then around at a distance that grows evenly by one pitch per circuit. All
neighbouring tracks are one pitch apart, so nothing is searched twice and nothing left out; for a
round covariance it is Archimedes' spiral, and for one narrower than the beam just a line.

References
----------
.. [1] B. O. Koopman (1957), The Theory of Search III: The Optimum Distribution of Searching Effort,
   Operations Research 5(5), 613-626 (where to search first when the target is Gaussian).
"""

from __future__ import annotations

from dataclasses import dataclass
from math import ceil, cos, inf, isfinite, pi, sin, sqrt

import numpy as np

from hillsphere.errors import InputError
from hillsphere.interfaces import Array
from hillsphere_tracking.pointing.mounts import Mount

__all__ = ["Search", "plan_search", "search_now", "search_speed"]

_FINENESS = 40.0
"""Points of the path per beam radius."""
_OUTGROWN = 1.5
"""Growth of the error in any direction from which a search is planned anew: it covers no more than
the 2σ of what it then is. A smaller factor would begin again and again, and never come to the end
of the ellipse."""
_LEAST_LEVEL = 0.1
"""Least cosine of the secondary angle: nearer to its keyhole no mount searches on circles."""


@dataclass(frozen=True, eq=False)
class Search:
    """A search path about the prediction.

    Parameters
    ----------
    begin_s : float
        When it begins.
    path_rad : ndarray, shape (2, M)
        Arcs towards growing azimuth and towards the zenith, from the prediction, M ≥ 1; it begins
        at the prediction itself.
    along_rad : ndarray, shape (M,)
        Length of the path so far.
    speed_rad_s : float
        Along the path.
    beam_rad, dwell_s : float
        Radius within which the signal is found, and how long it must be there.
    covariance_rad2 : ndarray, shape (2, 2)
        For which it was planned.
    sigmas : float
        Size of its ellipse.
    """

    begin_s: float
    path_rad: Array
    along_rad: Array
    speed_rad_s: float
    beam_rad: float
    dwell_s: float
    covariance_rad2: Array
    sigmas: float

    @property
    def duration_s(self) -> float:
        """How long one search takes; 0 if the beam covers all from the prediction."""
        return float(self.along_rad[-1]) / self.speed_rad_s

    def at(self, times_s: Array, turned_rad: Array | float = 0.0) -> tuple[Array, Array]:
        """Return where to look, beside the prediction.

        At its end the search runs back the same way, and so on; before its beginning it is at the
        prediction.

        Parameters
        ----------
        times_s : ndarray, shape (N,)
            When.
        turned_rad : ndarray, shape (N,), or float
            By how much right and up have turned on the sky since the search was planned, as
            `sky.parallel_transport` tells: the path keeps its place on the sky.

        Returns
        -------
        right_rad, up_rad : ndarray, shape (N,)
            Arcs towards growing azimuth and towards the zenith.
        """
        gone = np.maximum(np.asarray(times_s, dtype=float) - self.begin_s, 0.0) * self.speed_rad_s
        length = float(self.along_rad[-1])
        if length == 0.0:
            return np.zeros_like(gone), np.zeros_like(gone)
        place = length - np.abs(np.remainder(gone, 2.0 * length) - length)
        right = np.interp(place, self.along_rad, self.path_rad[0])
        up = np.interp(place, self.along_rad, self.path_rad[1])
        c, s = np.cos(turned_rad), np.sin(turned_rad)
        return c * right - s * up, s * right + c * up


def plan_search(
    covariance_rad2: Array,
    beam_rad: float,
    speed_rad_s: float,
    *,
    begin_s: float = 0.0,
    dwell_s: float = 0.0,
    sigmas: float = 3.0,
    overlap: float = 1.0 - sqrt(0.5),
) -> Search:
    """Return a search that passes within the beam of every point of an error ellipse.

    Tracks are 2b(1 − overlap) apart. A point half-way between two of them stays in the beam along a
    chord; the speed is held down until that takes `dwell_s`. (On the outside of a bend the chord is
    a little shorter: some 0.2 % of the errors may slip through.) The default overlap makes area per
    time largest when it is the dwell that limits the speed.

    Parameters
    ----------
    covariance_rad2 : ndarray, shape (2, 2)
        Of the prediction's error on the sky, rad²: cross-elevation and elevation, as a tracker's
        ``predict`` gives it.
    beam_rad : float
        b, radius within which the signal is found: the lock angle.
    speed_rad_s : float
        Largest speed on the sky that the mount allows; in the bends of the path, of about half a
        beam's width, it should not ask more than its acceleration.
    begin_s : float
        When the search begins.
    dwell_s : float
        How long the receiver needs to find the signal.
    sigmas : float
        Size of the ellipse.
    overlap : float
        Fraction of the beam's width that neighbouring tracks share, in (0, 1).

    Returns
    -------
    Search
        The path.

    Raises
    ------
    InputError
        If a number is out of its range, or the covariance is not one.
    """
    for what, number in (("beam", beam_rad), ("speed", speed_rad_s), ("sigmas", sigmas)):
        if not (isfinite(number) and number > 0.0):
            raise InputError(f"a search needs a {what} that is > 0 and finite, got {number}")
    if not (0.0 < overlap < 1.0 and isfinite(dwell_s) and dwell_s >= 0.0):
        raise InputError(
            f"a search needs an overlap in (0, 1) and a dwell ≥ 0 s, got {overlap} and {dwell_s}"
        )
    minor, major, along = _ellipse(covariance_rad2)
    pitch = 2.0 * beam_rad * (1.0 - overlap)
    path = _spiral(sigmas * (major - minor), sigmas * minor, pitch, beam_rad / _FINENESS)
    # major axis along the first coordinate, so far
    turned = np.array([[along[0], -along[1]], [along[1], along[0]]]) @ path
    lengths = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(turned, axis=1)))])
    chord = 2.0 * sqrt(beam_rad**2 - 0.25 * pitch**2)
    speed = min(speed_rad_s, chord / dwell_s) if dwell_s > 0.0 else speed_rad_s
    covariance = np.asarray(covariance_rad2, dtype=float)
    return Search(begin_s, turned, lengths, speed, beam_rad, dwell_s, covariance, sigmas)


def search_now(
    search: Search | None,
    covariance_rad2: Array,
    beam_rad: float,
    speed_rad_s: float,
    now_s: float,
    *,
    within_s: float = inf,
    dwell_s: float = 0.0,
    sigmas: float = 3.0,
    turned_rad: float = 0.0,
) -> Search | None:
    """Return the search for a signal that is lost, as its covariance changes.

    An ellipse within the beam needs none. A search under way goes on until the error has outgrown
    it by half in some direction; errors far within the beam do not count there. Then one begins
    anew, from the prediction; of an ellipse that is too large for the time left its likelier, inner
    part is searched.

    Parameters
    ----------
    search : Search or None
        That under way.
    covariance_rad2, beam_rad, speed_rad_s, dwell_s, sigmas
        As for `plan_search`.
    now_s : float
        When a new one begins.
    within_s : float
        About how long it may take.
    turned_rad : float
        See `Search.at`: of the search under way.

    Returns
    -------
    Search or None
        None if the beam at the prediction covers the ellipse.

    Raises
    ------
    InputError
        As for `plan_search`.
    """
    minor, major, _ = _ellipse(covariance_rad2)
    if sigmas * major <= beam_rad:
        return None
    if search is not None:
        least = (beam_rad / sigmas) ** 2 * np.eye(2)
        c, s = cos(turned_rad), sin(turned_rad)
        turn = np.array([[c, -s], [s, c]])
        planned = turn @ search.covariance_rad2 @ turn.T
        root = np.linalg.inv(np.linalg.cholesky(planned + least))
        growth = np.linalg.eigvalsh(root @ (covariance_rad2 + least) @ root.T)[-1]
        if growth <= _OUTGROWN**2:
            return search
    speed = speed_rad_s if dwell_s == 0.0 else min(speed_rad_s, sqrt(2.0) * beam_rad / dwell_s)
    if isfinite(within_s):
        length = speed * max(within_s, 1.0)
        sigmas *= min(_part(sigmas * minor, sigmas * major, sqrt(2.0) * beam_rad, length), 1.0)
    return plan_search(
        covariance_rad2, beam_rad, speed_rad_s, begin_s=now_s, dwell_s=dwell_s, sigmas=sigmas
    )


def _part(minor: float, major: float, pitch: float, length: float) -> float:
    """Return to what part an ellipse shrinks whose search is to have a length, about."""
    # square: its area over the distance of tracks; linear: out along its axis, and the last circuit
    half = major - minor
    square = (pi * minor + 4.0 * half) * minor / pitch
    linear = 3.0 * half + pi * minor
    return 2.0 * length / (linear + sqrt(linear**2 + 4.0 * square * length))


def search_speed(mount: Mount, secondary_rad: float, beam_rad: float) -> float:
    """Return the speed on the sky at which a mount can search, rad/s.

    Half of what its axes can do is left for following the satellite. The primary axis moves the
    beam by the cosine of the secondary angle only; the tightest bends of a search have a radius of
    some half a beam.

    Parameters
    ----------
    mount : Mount
        With rates and accelerations.
    secondary_rad : float
        About where the secondary axis stands.
    beam_rad : float
        Radius of the beam.

    Returns
    -------
    float
        Speed > 0.
    """
    level = max(abs(cos(secondary_rad)), _LEAST_LEVEL)
    rate = min(level * mount.primary.rate_rad_s, mount.secondary.rate_rad_s)
    acceleration = min(
        level * mount.primary.acceleration_rad_s2, mount.secondary.acceleration_rad_s2
    )
    return 0.5 * min(rate, sqrt(acceleration * 0.5 * beam_rad))


def _ellipse(covariance: Array) -> tuple[float, float, Array]:
    """Return both standard deviations and the major axis's direction."""
    matrix = np.asarray(covariance, dtype=float)
    if matrix.shape != (2, 2) or not np.isfinite(matrix).all():
        raise InputError(f"a search needs a finite covariance (2, 2), got {matrix.tolist()}")
    values, vectors = np.linalg.eigh(0.5 * (matrix + matrix.T))
    if values[0] < -1e-9 * max(values[1], 0.0) or not np.allclose(matrix, matrix.T, rtol=1e-6):
        raise InputError(f"a search needs a symmetric, positive covariance, got {matrix.tolist()}")
    minor, major = np.sqrt(np.maximum(values, 0.0))
    return float(minor), float(major), vectors[:, 1]


def _spiral(half: float, radius: float, pitch: float, fine: float) -> Array:
    """Return the path (2, M) around a segment ±half that leaves nothing within radius of it."""
    # A point is found from half a pitch away: so much of the outermost distance can be left out.
    outermost = max(radius - 0.5 * pitch, 0.0)
    if half + radius <= 0.5 * pitch:
        return np.zeros((2, 1))
    if outermost == 0.0:
        # A line is enough. Its end covers all that lies beyond it, up to ±radius aside.
        reach = half + radius - sqrt(0.25 * pitch**2 - radius**2)
        count = max(ceil(reach / fine), 1)
        out = np.linspace(0.0, reach, count + 1)
        across = np.linspace(reach, -reach, 2 * count + 1)[1:]
        return np.vstack([np.concatenate([out, across]), np.zeros(3 * count + 1)])
    circuits = outermost / pitch
    # One circuit: along the upper side, round the left end, along the lower, round the right end.
    straight, bend = 2.0 * half, pi * max(0.5 * outermost, 0.5 * pitch)
    shares = np.cumsum([0.0, straight, bend, straight, bend])
    shares /= shares[-1]
    per_circuit = ceil((2.0 * straight + 2.0 * pi * (outermost + pitch)) / fine)
    turn = np.linspace(0.0, circuits + 1.0, ceil(per_circuit * (circuits + 1.0)) + 1)
    phase = np.remainder(turn, 1.0)
    foot = np.interp(phase, shares, [half, -half, -half, half, half])
    normal = np.interp(phase, shares, [0.5 * pi, 0.5 * pi, 1.5 * pi, 1.5 * pi, 2.5 * pi])
    distance = np.minimum(pitch * turn, outermost)  # the last circuit closes at the outermost
    winding = np.array([foot + distance * np.cos(normal), distance * np.sin(normal)])
    out = np.linspace(0.0, half, ceil(half / fine) + 1)[:-1] if half > 0.0 else np.zeros(0)
    return np.concatenate([np.vstack([out, np.zeros(out.size)]), winding], axis=1)
