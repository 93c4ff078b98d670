"""Specs of laws that follow from a design: keys of their tables ``[compensator.NAME]``."""

from __future__ import annotations

from typing import Any, Literal, Self

from pydantic import model_validator

from hillsphere.spec import DataPath, Ref, Spec, data_path, option, quantity, reference, rule
from hillsphere_controllers.specs import Matrix, check_system

__all__ = ["LqgSpec", "LqrSpec", "LtiSpec", "LyapunovSpec", "PointSpec"]

# x, y, z, vx, vy, vz in free space
_AXES = {
    "a": [[0, 0, 0, 1, 0, 0], [0, 0, 0, 0, 1, 0], [0, 0, 0, 0, 0, 1], [0] * 6, [0] * 6, [0] * 6],
    "b": [[0] * 3, [0] * 3, [0] * 3, [1, 0, 0], [0, 1, 0], [0, 0, 1]],
}
_POINT = {"plant": "hill", "point": {"position_km": [0, 300, 0]}}
_SIZES = {"state_sizes": [10, 10, 10, 0.1, 0.1, 0.1], "control_sizes": [1e-4, 1e-4, 1e-4]}


class LtiSpec(Spec):
    """Linear controller u = K e, from a synthesis, a file or matrices, of either time.

    At samples a controller in continuous time is brought to their period and u is held; with
    continuous states it runs with the plant, and the flight needs sub-steps that fit its poles.
    """

    examples = (
        {
            "period_s": 60,
            "a": [[-0.3, 0, 0], [0, -0.3, 0], [0, 0, -0.3]],
            "b": [[0.3, 0, 0, 90, 0, 0], [0, 0.3, 0, 0, 90, 0], [0, 0, 0.3, 0, 0, 90]],
            "c": [[2.5e-5, 0, 0], [0, 2.5e-5, 0], [0, 0, 2.5e-5]],
        },
        {
            "period_s": 60,
            "form": "discrete",
            "sees": "deviation",
            "d": [[-3e-4, 0, 0, -0.03, 0, 0], [0, -3e-4, 0, 0, -0.03, 0],
                  [0, 0, -3e-4, 0, 0, -0.03]],
        },
        {
            "period_s": 60,
            "sees": "deviation",
            "states": "continuous",
            "low_pass_hz": 0.05,
            "d": [[-3e-5, 0, 0, -0.01, 0, 0], [0, -3e-5, 0, 0, -0.01, 0],
                  [0, 0, -3e-5, 0, 0, -0.01]],
        },
    )  # fmt: skip

    period_s: float = quantity("time", "time between samples", gt=0)
    sees: Literal["error", "deviation"] = option(
        "what K was made for: 'error', reference − seen, as in a loop of negative feedback; "
        "'deviation', seen − reference, as measurements y of a generalised plant, closed without "
        "a change of sign",
        default="error",
    )
    measurements: tuple[str, ...] = option(
        "which inputs of the controller are what the law sees, by name, in the order in which it "
        "sees them; one name y stands for y[0], y[1] …; the others, commands that a flight does "
        "not give, stay zero; left out: all",
        default=(),
    )
    low_pass_hz: float | None = quantity(
        "frequency",
        "corner of a first-order low-pass filter before every input, for a controller in "
        "continuous time, but not with method = 'bilinear'; left out: none",
        default=None,
        gt=0,
    )
    states: Literal["sampled", "continuous"] = option(
        "'sampled': filter and controller are brought to the samples, and u is held; 'continuous': "
        "they run between samples, too, on the error that is held",
        default="sampled",
    )
    method: Literal["bilinear", "held", "mean"] = option(
        "how a controller in continuous time is discretised: 'bilinear' keeps the phase of K, the "
        "hold adds half a period of delay; 'held' is exact for held inputs, but a strictly proper "
        "K then acts on the previous sample; 'mean' is like 'held' with the mean of K's output "
        "over the period as u, which acts at once",
        default="bilinear",
    )
    file: DataPath | None = data_path(
        "file .mat with the controller, a struct of a, b, c, d, Ts; left out with the matrices: "
        "the controller comes from a synthesis (needs.controller of the flight)",
        default=None,
    )
    variable: str = option("with file: the controller's name in it", default="K", min_length=1)
    form: Literal["continuous", "discrete"] = option(
        "with matrices: whether A and B are those of ẋ = A x + B e, 1/s, or of one step",
        default="continuous",
    )
    a: Matrix = option("A, m × m, row by row; left out: no states", default=())
    b: Matrix = option("B, m × q", default=())
    c: Matrix = option("C, p × m", default=())
    d: Matrix = option("D, p × q; left out: zero", default=())

    @model_validator(mode="after")
    def _one_origin(self) -> Self:
        given = bool(self.a or self.b or self.c or self.d)
        if given and self.file is not None:
            raise rule("file", "matrices are given, too; keep one of the two")
        if given:
            check_system(self.a, self.b, self.c, self.d)
            if self.measurements:
                raise rule("measurements", "inputs of matrices have no names; leave out columns")
        return self

    @model_validator(mode="after")
    def _one_time(self) -> Self:
        discrete = self.form == "discrete"
        if self.states == "continuous" and discrete:
            raise rule("states", "continuous states need form = 'continuous'")
        if self.states == "continuous" and "method" in self.model_fields_set:
            raise rule("method", "continuous states are not brought to samples; leave it out")
        if self.low_pass_hz is not None and discrete:
            raise rule("low_pass_hz", "a filter of form = 'discrete' belongs into its matrices")
        if self.low_pass_hz is not None and self.states == "sampled" and self.method == "bilinear":
            raise rule(
                "low_pass_hz",
                "the bilinear map makes a filter that is fast beside the period ring from sample "
                "to sample; take states = 'continuous' or method = 'mean'",
            )
        return self


class PointSpec(Spec):
    """A state at which a plant's motion is linearised."""

    examples = ({"position_km": [0, 300, 0]},)

    position_m: tuple[float, ...] = quantity(
        "length", "positions in the plant's frame, in the order of its states", min_length=1
    )
    velocity_m_s: tuple[float, ...] = quantity(
        "speed",
        "velocities in the plant's frame, in the order of its states; left out: zero",
        default=(),
    )
    others: dict[str, float] = option(
        "values of states besides position and velocity, by name, SI; held constant", default={}
    )
    time_s: float = quantity("time", "time", default=0.0)


class _RegulatorSpec(Spec):
    """Motion and weights of an optimal regulator."""

    period_s: float = quantity("time", "time between samples", gt=0)
    plant: Ref | None = reference(
        "plant", "whose motion near a point is regulated; left out: a and b are given", default=None
    )
    point: PointSpec | None = option("with plant: the point", default=None)
    trim: bool = option(
        "with plant: add the command that balances it at the point, so that it is held without an "
        "error; not for a reference that comes with a command",
        default=False,
    )
    a: Matrix = option("A of ẋ = A x + B u, SI, n × n, row by row", default=())
    b: Matrix = option("B, n × m", default=())
    q: Matrix = option("Q of the cost ∫ xᵀ Q x + uᵀ R u dt, n × n", default=())
    r: Matrix = option("R, m × m", default=())
    state_sizes: tuple[float, ...] = option(
        "instead of q: the deviation of each state, SI, that weighs one (Q is diagonal, 1/size²)",
        default=(),
        gt=0,
    )
    control_sizes: tuple[float, ...] = option(
        "instead of r: the size of each control, SI, that weighs one", default=(), gt=0
    )

    @model_validator(mode="after")
    def _motion(self) -> Self:
        if (self.plant is None) == (not self.a):
            raise rule("plant", "give either a plant, with a point, or the matrices a and b")
        if (self.plant is None) != (self.point is None):
            raise rule("point", "plant and point belong together")
        if self.trim and self.plant is None:
            raise rule("trim", "it needs the plant")
        if bool(self.a) != bool(self.b):
            raise rule("b", "a and b belong together")
        return self

    @model_validator(mode="after")
    def _shapes(self) -> Self:
        n, m = len(self.a), len(self.b[0]) if self.b else 0
        wanted: dict[str, tuple[Any, int, int]] = {"a": (self.a, n, n), "b": (self.b, n, m)}
        for key, sizes, size in (("q", self.state_sizes, n), ("r", self.control_sizes, m)):
            matrix: Matrix = getattr(self, key)
            name = "state_sizes" if key == "q" else "control_sizes"
            if bool(matrix) == bool(sizes):
                raise rule(key, f"give one of {key} and {name}")
            count = size or len(matrix) or len(sizes)
            if sizes and len(sizes) != count:
                raise rule(name, f"must have {count} entries to fit the others, got {len(sizes)}")
            wanted[key] = (matrix, count, count)
        for key, (matrix, rows, columns) in wanted.items():
            if matrix and (len(matrix) != rows or any(len(row) != columns for row in matrix)):
                raise rule(key, f"must be {rows} × {columns} to fit the others")
        return self


class LqrSpec(_RegulatorSpec):
    """Linear-quadratic regulator on the states, optimal for samples and a hold."""

    examples = (
        {"period_s": 60, **_POINT, **_SIZES, "trim": True, "integral_sizes": [3e4, 3e4, 3e4]},
        {"period_s": 60, **_AXES, **_SIZES},
    )

    integral_sizes: tuple[float, ...] = option(
        "integral of each position's deviation, the first states, m s, that weighs one: removes "
        "what a steady push leaves; left out: no integral action",
        default=(),
        gt=0,
    )


class LqgSpec(_RegulatorSpec):
    """Linear-quadratic regulator on the estimate of a Kalman filter, for samples and a hold."""

    examples = (
        {
            "period_s": 60,
            **_POINT,
            **_SIZES,
            "control_noise": [1e-5, 1e-5, 1e-5],
            "measurement_sizes": [5, 5, 5, 0.01, 0.01, 0.01],
        },
        {
            "period_s": 60,
            **_AXES,
            **_SIZES,
            "c": [[1, 0, 0, 0, 0, 0], [0, 1, 0, 0, 0, 0], [0, 0, 1, 0, 0, 0],
                  [0, 0, 0, 1, 0, 0], [0, 0, 0, 0, 1, 0], [0, 0, 0, 0, 0, 1]],
            "w": [[0] * 6, [0] * 6, [0] * 6,
                  [0, 0, 0, 1e-10, 0, 0], [0, 0, 0, 0, 1e-10, 0], [0, 0, 0, 0, 0, 1e-10]],
            "measurement_sizes": [5, 5, 5, 0.01, 0.01, 0.01],
        },
    )  # fmt: skip

    c: Matrix = option(
        "C, what of the states is seen, p × n; left out: all, in their order",
        default=(),
    )
    w: Matrix = option("spectral density of the white noise on the states, SI, n × n", default=())
    control_noise: tuple[float, ...] = option(
        "instead of w: root of the spectral density of white noise that enters as each control "
        "does (for an acceleration m/s² √s)",
        default=(),
        gt=0,
    )
    measurement_sizes: tuple[float, ...] = option(
        "standard deviation of the error of each value seen, new at each sample, SI",
        min_length=1,
        gt=0,
    )

    @model_validator(mode="after")
    def _noises(self) -> Self:
        if bool(self.w) == bool(self.control_noise):
            raise rule("w", "give one of w and control_noise")
        if self.c and len(self.c) != len(self.measurement_sizes):
            raise rule("measurement_sizes", f"must have {len(self.c)} entries, one per row of c")
        return self


class LyapunovSpec(Spec):
    """Command that minimises a quadratic Lyapunov function of the deviation after each period."""

    examples = (
        {"period_s": 60, "time_constant_s": 300},
        {
            "period_s": 60,
            "time_constant_s": 300,
            "damping": 0.8,
            "plant": "hill",
            "cancel": "difference",
            "maximum_mm_s2": 5,
        },
        {"period_s": 60, "p": [[1, 300], [300, 2e5]]},
    )

    period_s: float = quantity("time", "time between samples", gt=0)
    time_constant_s: float | None = quantity(
        "time",
        "1/ω of the motion s² + 2 ζ ω s + ω² of each axis that gives the function; left out: p is "
        "given",
        default=None,
        gt=0,
    )
    damping: float = option("damping ratio ζ of the motion s² + 2 ζ ω s + ω²", default=1.0, gt=0)
    p: Matrix = option(
        "P of the function V = xᵀ P x, x the deviations of all positions, then all velocities, SI; "
        "2 × 2: of each axis",
        default=(),
    )
    plant: Ref | None = reference(
        "plant", "plant whose own acceleration is cancelled; left out: none", default=None
    )
    cancel: Literal["all", "difference"] = option(
        "with plant: 'all', its acceleration where it is seen, for a point that is held; "
        "'difference', what this differs from that at the reference, for a flight of the plant "
        "that is followed",
        default="all",
    )
    maximum_m_s2: float | None = quantity(
        "acceleration", "a larger command is cut to this, its direction kept", default=None, gt=0
    )

    @model_validator(mode="after")
    def _function(self) -> Self:
        if (self.time_constant_s is None) == (not self.p):
            raise rule("p", "give one of time_constant_s and p")
        n = len(self.p)
        if n % 2 or any(len(row) != n for row in self.p):
            raise rule("p", "must be square, its size twice the number of axes, or 2 × 2")
        return self
