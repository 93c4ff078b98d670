r"""Search after a loss of signal: a spiral about the prediction, sized by its covariance.

The error of a prediction lies in an ellipse on the sky, usually long and thin along the track. The
search path winds around a segment of the major axis, whose half-length is the difference of the
semi-axes: out along the major axis, then around the segment at a distance that grows by one pitch
per circuit. Neighbouring tracks are one pitch apart, so that the ellipse is covered once. A round
covariance gives Archimedes' spiral, a covariance narrower than the beam a line.

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
"""Points of the path per radius of the beam: the chords then deviate from the bends by less than a
thousandth of the beam. More cost memory and time in proportion."""
_OUTGROWN = 1.5
"""Growth of the error in any direction at which a search is planned again: the old 3σ path then
covers only 2σ. With a smaller factor the search would restart again and again, and never reach the
edge of the ellipse."""
_LEAST_LEVEL = 0.1
"""Least cosine of the secondary angle in the speed of a search. Nearer to the keyhole the primary
axis could not search at any useful speed, and a speed of zero would never end."""


@dataclass(frozen=True, eq=False)
class Search:
    """A search path about the prediction.

    Parameters
    ----------
    begin_s : float
        Time at which the search begins.
    path_rad : ndarray, shape (2, M)
        Arcs from the prediction towards growing azimuth and towards the zenith, M ≥ 1; the path
        begins at the prediction.
    along_rad : ndarray, shape (M,)
        Length of the path up to each point.
    speed_rad_s : float
        Speed along the path.
    beam_rad, dwell_s : float
        Radius of the beam, and time for which the signal must be in it to be found.
    covariance_rad2 : ndarray, shape (2, 2)
        Covariance for which the search was planned.
    sigmas : float
        Size of the ellipse in standard deviations.
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
        """Duration of one search; 0 if the beam at the prediction covers the ellipse."""
        return float(self.along_rad[-1]) / self.speed_rad_s

    def at(self, times_s: Array, turned_rad: Array | float = 0.0) -> tuple[Array, Array]:
        """Return the offsets of the beam from the prediction.

        Before its beginning the search is at the prediction. At the end of the path it runs back,
        and so on.

        Parameters
        ----------
        times_s : ndarray, shape (N,)
            Times.
        turned_rad : ndarray, shape (N,), or float
            Rotation of the axes "right" and "up" on the sky since the search was planned, from
            `sky.parallel_transport`; the path keeps its orientation on the sky.

        Returns
        -------
        right_rad, up_rad : ndarray, shape (N,)
            Arcs towards growing azimuth and towards the zenith.
        """
        # triangle wave along the path, back and forth
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
    """Plan a search whose beam covers every point of an error ellipse.

    Tracks are 2b(1 − overlap) apart. A point half-way between two tracks is in the beam along a
    chord; the speed is limited so that the beam needs `dwell_s` for the chord. On the outside of a
    bend the chord is slightly shorter, so that about 0.2 % of the errors may be missed. The default
    overlap maximises the searched area per time if the dwell limits the speed.

    Parameters
    ----------
    covariance_rad2 : ndarray, shape (2, 2)
        Covariance of the prediction's error on the sky (cross-elevation and elevation), rad², from
        a tracker's ``predict``.
    beam_rad : float
        Radius b of the beam (the lock angle).
    speed_rad_s : float
        Largest speed of the mount on the sky; its acceleration must suffice for bends with a radius
        of about half the beam.
    begin_s : float
        Time at which the search begins.
    dwell_s : float
        Time that the receiver needs to find the signal.
    sigmas : float
        Size of the ellipse in standard deviations.
    overlap : float
        Fraction of the beam's width that neighbouring tracks share, in (0, 1).

    Returns
    -------
    Search
        The path.

    Raises
    ------
    InputError
        If a number is out of range, or the matrix is not a covariance.
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
    # the spiral has its major axis along the first coordinate: rotate it onto the ellipse's
    turned = np.array([[along[0], -along[1]], [along[1], along[0]]]) @ path
    lengths = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(turned, axis=1)))])
    # chord of the beam at half a pitch from the track
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
    """Continue, restart or end the search for a lost signal as the covariance grows.

    No search is needed if the beam covers the ellipse. A running search continues until the error
    has grown by half in some direction (errors far inside the beam do not count). It then restarts
    from the prediction. If the ellipse is too large for the remaining time, a smaller one with the
    most probable errors is searched.

    Parameters
    ----------
    search : Search or None
        The running search.
    covariance_rad2, beam_rad, speed_rad_s, dwell_s, sigmas
        As for `plan_search`.
    now_s : float
        Present time, at which a new search begins.
    within_s : float
        Time that is left, about.
    turned_rad : float
        Rotation since the running search was planned, see `Search.at`.

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
        # Largest generalised eigenvalue of new against planned covariance. The beam's own size is
        # added to both, so that growth of an error far inside the beam does not count.
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
    """Return the factor by which an ellipse shrinks so that its search has about a given length."""
    # length(f) = square f² + linear f: area over pitch, plus the way out and the last circuit
    half = major - minor
    square = (pi * minor + 4.0 * half) * minor / pitch
    linear = 3.0 * half + pi * minor
    return 2.0 * length / (linear + sqrt(linear**2 + 4.0 * square * length))


def search_speed(mount: Mount, secondary_rad: float, beam_rad: float) -> float:
    """Return the speed on the sky at which a mount can search, rad/s.

    Half of the axes' capability is reserved for following the satellite. The primary axis moves the
    beam in proportion to the cosine of the secondary angle. The tightest bends of a search have a
    radius of about half the beam, which limits the speed by √(acceleration · radius).

    Parameters
    ----------
    mount : Mount
        The mount, with rates and accelerations of its axes.
    secondary_rad : float
        Approximate angle of the secondary axis.
    beam_rad : float
        Radius of the beam.

    Returns
    -------
    float
        Speed > 0, rad/s.
    """
    level = max(abs(cos(secondary_rad)), _LEAST_LEVEL)
    rate = min(level * mount.primary.rate_rad_s, mount.secondary.rate_rad_s)
    acceleration = min(
        level * mount.primary.acceleration_rad_s2, mount.secondary.acceleration_rad_s2
    )
    return 0.5 * min(rate, sqrt(acceleration * 0.5 * beam_rad))


def _ellipse(covariance: Array) -> tuple[float, float, Array]:
    """Return minor and major standard deviation of a covariance, and the major axis."""
    matrix = np.asarray(covariance, dtype=float)
    if matrix.shape != (2, 2) or not np.isfinite(matrix).all():
        raise InputError(f"a search needs a finite covariance (2, 2), got {matrix.tolist()}")
    values, vectors = np.linalg.eigh(0.5 * (matrix + matrix.T))
    if values[0] < -1e-9 * max(values[1], 0.0) or not np.allclose(matrix, matrix.T, rtol=1e-6):
        raise InputError(f"a search needs a symmetric, positive covariance, got {matrix.tolist()}")
    minor, major = np.sqrt(np.maximum(values, 0.0))
    return float(minor), float(major), vectors[:, 1]


def _spiral(half: float, radius: float, pitch: float, fine: float) -> Array:
    """Return a path (2, M) around the segment ±half that covers all points within radius of it."""
    # The beam covers half a pitch on both sides, by which the outermost circuit can be smaller.
    outermost = max(radius - 0.5 * pitch, 0.0)
    if half + radius <= 0.5 * pitch:
        return np.zeros((2, 1))
    if outermost == 0.0:
        # A line suffices. At its end the beam covers the rest of the ellipse, up to ±radius aside.
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
    # each point: foot on the segment, direction of its normal, and distance along the normal
    foot = np.interp(phase, shares, [half, -half, -half, half, half])
    normal = np.interp(phase, shares, [0.5 * pi, 0.5 * pi, 1.5 * pi, 1.5 * pi, 2.5 * pi])
    distance = np.minimum(pitch * turn, outermost)  # the last circuit closes at the outermost
    winding = np.array([foot + distance * np.cos(normal), distance * np.sin(normal)])
    out = np.linspace(0.0, half, ceil(half / fine) + 1)[:-1] if half > 0.0 else np.zeros(0)
    return np.concatenate([np.vstack([out, np.zeros(out.size)]), winding], axis=1)
