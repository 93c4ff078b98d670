"""The stage that a campaign repeats: sent to the workers as Specs, and built there once."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

from hillsphere.base.errors import InputError
from hillsphere.base.problems import did_you_mean, format_key
from hillsphere.cases.isolation import BlockOutcome, compute
from hillsphere.cases.stored_blocks import BlockFiles, FileReceipt
from hillsphere.interfaces.cases import CaseBatch
from hillsphere.interfaces.quantities import Parameter
from hillsphere.interfaces.stages import CaseStage
from hillsphere.interfaces.tasks import StoredTask, Task
from hillsphere.mission.faults import faults_of
from hillsphere.mission.links import links_of
from hillsphere.mission.load import Mission
from hillsphere.runs.assembly import Assembly
from hillsphere.spec.base import Spec

__all__ = ["Repeated", "RepeatedWork"]


@dataclass(frozen=True)
class Repeated:
    """A stage of a mission with the products that it needs.

    Parameters
    ----------
    mission : Mission
        The mission.
    stage : str
        Name of the stage.
    inputs : mapping
        Products of the stage's needs, by field.
    by : str
        Name of the stage that repeats it.
    nominal : object, optional
        What the stage itself has yielded; workers are not given it.
    """

    mission: Mission
    stage: str
    inputs: Mapping[str, Any] = field(default_factory=dict, repr=False)
    by: str = ""
    nominal: Any = field(default=None, repr=False)

    def warnings(self) -> tuple[str, ...]:
        """Return the warnings of the stage's own run that hold for campaigns too."""
        if self.nominal is None:
            return ()
        warn = getattr(self.build(), "case_warnings", None)
        return () if warn is None else tuple(warn(self.nominal))

    def build(self) -> CaseStage:
        """Make the stage.

        Raises
        ------
        InputError
            If it is none that can be repeated.
        """
        stage = Assembly(self.mission).get("stage", self.stage)
        if not isinstance(stage, CaseStage):
            type_ = self.mission.components["stage"][self.stage].component.type
            raise InputError(
                f"stage {self.stage!r} ({type_}) cannot be repeated: it has no run_cases"
            )
        return stage

    def case_inputs(self) -> tuple[Parameter, ...]:
        """Return what may differ from case to case, see `CaseStage`."""
        return self.build().case_inputs()

    def paths(self, table: str) -> tuple[str, ...]:
        """Return how the stage's Spec leads to a table: to "gravity.phobos" by "plant.gravity.".

        Returns
        -------
        tuple of str
            A prefix of names of `case_inputs` for every way there; ``""`` for the stage's own
            table, by its name or as ``"stage"``; none if it does not lead there.
        """
        if table in ("stage", f"stage.{self.stage}"):
            return ("",)
        found: list[str] = []
        waiting: list[tuple[Spec, str]] = [(self.mission.specs["stage"][self.stage], "")]
        while waiting:
            spec, prefix = waiting.pop(0)
            for where, kind, ref in spec.references():
                if kind == "stage":
                    continue
                path = prefix + ".".join(map(str, where)) + "."
                if f"{kind}.{ref.name}" == table:
                    found.append(path)
                waiting.append((self.mission.specs[kind][ref.name], path))
        return tuple(found)

    def changed(self, changes: Mapping[str, Any]) -> Repeated:
        """Return the stage of a mission in which some keys have other values.

        Parameters
        ----------
        changes : mapping
            ``"stage.descent.period_s"`` → value, as a mission would write it.

        Returns
        -------
        Repeated
            With the same products.

        Raises
        ------
        InputError
            If there is no such key, a value does not fit, or the products depend on it.
        """
        mission = self.mission
        for address, value in changes.items():
            kind, _, rest = address.partition(".")
            name, _, key = rest.partition(".")
            if name not in mission.specs.get(kind, {}) or not key:
                tables = [f"{k}.{n}" for k, group in mission.specs.items() for n in group]
                hint = did_you_mean(f"{kind}.{name}", tables, otherwise="tables")
                raise InputError(f"{address}: no such key in this mission{hint}")
            self._refuse_stale((kind, name), address)
            spec = mission.specs[kind][name]
            made = _with_key(spec, key.split("."), value, address)
            for _, other, ref in made.references():
                if ref.name not in (names := mission.specs.get(other, {})):
                    hint = did_you_mean(ref.name, names, otherwise="there are")
                    raise InputError(
                        f"{address} = {value!r}: no {other.replace('_', ' ')} table is named "
                        f"{ref.name[:60]!r}{hint}"
                    )
            specs = {k: dict(group) for k, group in mission.specs.items()}
            specs[kind][name] = made
            mission = replace(mission, specs=specs)
        return replace(self, mission=mission)

    def _refuse_stale(self, table: tuple[str, str], address: str) -> None:
        """Raise if a product that the stage needs depends on what is changed."""
        waiting = [
            ref.name
            for _, kind, ref in self.mission.specs["stage"][self.stage].references()
            if kind == "stage"
        ]
        seen: set[tuple[str, str]] = set()
        nodes = [("stage", name) for name in waiting]
        while nodes:
            node = nodes.pop()
            if node == table:
                raise InputError(
                    f"{address}: cannot be changed from case to case, because the products that "
                    f"stage {self.stage!r} needs depend on it"
                )
            if node not in seen:
                seen.add(node)
                nodes += list(links_of(self.mission.specs[node[0]][node[1]]))


def _with_key(spec: Spec, path: Sequence[str], value: Any, address: str) -> Spec:
    keys = spec.model_dump(mode="json", exclude_none=True)
    place: dict[str, Any] = keys
    part: Any = spec
    for step in path[:-1]:
        place, part = place.setdefault(step, {}), getattr(part, step, None)
        if not isinstance(place, dict):
            raise InputError(f"{address}: {step} is no table")
    for unit_keys in type(part).units_by_field().values() if isinstance(part, Spec) else ():
        if path[-1] in unit_keys:
            for other in unit_keys:
                place.pop(other, None)
    place[path[-1]] = value
    made, faults = faults_of(type(spec), keys)
    if made is None:
        told = "; ".join(
            f"{format_key(f.key)}: {f.message}" if f.key else f.message for f in faults
        )
        raise InputError(f"{address} = {value!r}: {told}")
    return made


@dataclass(frozen=True)
class RepeatedWork:
    """The blocks of a campaign as `hillsphere.interfaces.tasks.Work`.

    Parameters
    ----------
    variants : tuple of Repeated
        What `Task.variant` counts; built when first needed, in each worker.
    bands : tuple of str
        Names or patterns of quantities whose histories are kept.
    files : BlockFiles or None
        Where `StoredTask` is written, of a large campaign.
    """

    variants: tuple[Repeated, ...]
    bands: tuple[str, ...] = ()
    files: BlockFiles | None = None

    def prepare(self) -> Callable[[Task | StoredTask], Sequence[BlockOutcome | FileReceipt]]:
        """Return the function that computes a task."""
        return _Computing(self)


class _Computing:
    """Computes tasks with the stage of their variant; one at a time is kept.

    The blocks of a variant follow each other, and compiled stages of a large sweep would fill the
    memory.
    """

    def __init__(self, work: RepeatedWork) -> None:
        self._variants, self._bands, self._files = work.variants, work.bands, work.files
        self._built: tuple[int, CaseStage] | None = None

    def ready(self, task: Task | StoredTask) -> None:
        """Build the task's stage and have it compile, which does not count against a limit."""
        stage = self._stage(task.variant)
        prepare = getattr(stage, "prepare_cases", None)
        if prepare is not None:
            blocks = task.blocks if isinstance(task, Task) else [self._block(task.files[0], 0)]
            for names in dict.fromkeys(block.names for block in blocks):
                prepare(names, **self._variants[task.variant].inputs)

    def __call__(self, task: Task | StoredTask) -> tuple[BlockOutcome | FileReceipt, ...]:
        stage, inputs = self._stage(task.variant), self._variants[task.variant].inputs
        if isinstance(task, StoredTask):
            return tuple(
                one for file in task.files for one in self._compute_file(stage, inputs, file)
            )
        return tuple(
            compute(stage, block, inputs, task.history, self._bands) for block in task.blocks
        )

    def _compute_file(
        self, stage: CaseStage, inputs: Mapping[str, Any], file: int
    ) -> Sequence[BlockOutcome | FileReceipt]:
        """Compute a file; its blocks themselves are returned if it cannot be written here."""
        assert self._files is not None
        blocks = self._files.blocks(file)
        outcomes = [compute(stage, self._block(file, i), inputs) for i in range(len(blocks))]
        try:
            return [self._files.write(file, outcomes)]
        except OSError:  # the directory is not on this machine, or full: the run tells of that
            return outcomes

    def _block(self, file: int, place: int) -> CaseBatch:
        assert self._files is not None
        return self._files.plan.block(self._files.blocks(file)[place])[0]

    def _stage(self, variant: int) -> CaseStage:
        if self._built is None or self._built[0] != variant:
            self._built = None  # gone before the next one takes its memory
            self._built = variant, self._variants[variant].build()
        return self._built[1]
