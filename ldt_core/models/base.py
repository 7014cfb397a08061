"""What every model of the twin is: immutable, versioned, and plain JSON on the wire."""

from __future__ import annotations

import abc
import functools
import json
import math
from collections.abc import Mapping, Sequence
from typing import Any, ClassVar, Self

from ldt_core.base.errors import ModelError, reason_of
from ldt_core.base.experiment import DiagnosisRecord, Experiment, ModelRecord, Prediction
from ldt_core.base.sentences import counted
from ldt_core.machine.machine_file import Machine


class Model(abc.ABC):
    """A digital model that predicts the speed of an experiment in free run.

    A model never changes. `fit` returns a new one with the next version, so that a comparison, a
    refusal and a way back cost nothing. All that makes a model is in `parameters`; a model built
    from the record of another predicts bit-equally.

    Args:
        machine: the machine as it is known beforehand.
        parameters: all that makes the model, in JSON types; None for the untrained model.
        version: 0 when untrained.
        trained_on: numbers of the experiments it learned from.

    Raises:
        ModelError: parameters that cannot be this model's.
    """

    kind: ClassVar[str]
    #: Whether `fit` can be called; a model that never learns is the baseline "original".
    adaptive: ClassVar[bool] = True

    @property
    def asks_for_diagnosis(self) -> bool:
        """Whether it wants to be `informed` of what a diagnosis at a positive finds."""
        return False

    def __init__(
        self,
        machine: Machine,
        parameters: Mapping[str, Any] | None = None,
        version: int = 0,
        trained_on: Sequence[int] = (),
        **options: Any,
    ) -> None:
        self.machine = machine
        self.version = version
        self.trained_on = tuple(trained_on)
        self.options = dict(options)
        self.parameters = dict(parameters) if parameters is not None else self.untrained()
        self.build()

    @abc.abstractmethod
    def untrained(self) -> dict[str, Any]:
        """Parameters of the model that has learned nothing: the machine file's physics."""

    @abc.abstractmethod
    def build(self) -> None:
        """Turn `parameters` into whatever makes `predict` fast; check them on the way."""

    @abc.abstractmethod
    def predict(self, experiment: Experiment) -> Prediction:
        """Free run over the experiment's voltage from its first measured sample.

        Reads the voltage, the first speed and the first current, and no other measurement.
        """

    @abc.abstractmethod
    def fit(self, experiments: Sequence[Experiment]) -> Self:
        """A new model, version + 1, learned from these experiments alone.

        Raises:
            LdtError: the experiments do not determine a model; the sentence says why.
        """

    def fit_without(self, experiments: Sequence[Experiment], held: Sequence[slice]) -> Self:
        """As `fit`, without the samples `held` of each experiment.

        Here each experiment is cut in two and both parts are learned from. A model whose hidden
        states make the start of the second part unknown does better to run through the block and
        not to look at it.
        """
        parts = []
        for e, block in zip(experiments, held, strict=True):
            ends = ((0, block.start), (block.stop, len(e)))
            parts += [e.part(begin, stop) for begin, stop in ends if stop > begin]
        return self.fit(parts)

    def shaped_like(self, other: Self) -> Self:
        """A model that, when it learns, takes over what `other` had to choose (an order, say)."""
        return self

    def informed(self, diagnosis: DiagnosisRecord) -> Self:
        """The model that is to learn in this one's place after a verdict, of the same version."""
        return self

    def change(self, before: Model) -> str:
        """What has happened to the machine since an earlier model, in words; empty if unknown."""
        return ""

    def successor(self, parameters: Mapping[str, Any], experiments: Sequence[Experiment]) -> Self:
        """The next version with these parameters; JSON round trip included, see the class."""
        plain = json.loads(json.dumps(parameters, allow_nan=False))
        numbers = tuple(e.number for e in experiments)
        return type(self)(self.machine, plain, self.version + 1, numbers, **self.options)

    def again(self, version: int) -> Self:
        """This model as a later version, for a return to it."""
        return type(self)(self.machine, self.parameters, version, self.trained_on, **self.options)

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickled and copied by what makes it: what `build` adds may hold compiled code."""
        made = self.machine, self.parameters, self.version, self.trained_on
        return functools.partial(type(self), **self.options), made

    def __repr__(self) -> str:
        learned = counted(len(self.trained_on), "experiment")
        return f"{type(self).__name__}({self.machine.name!r}, version {self.version}, {learned})"

    def record(self) -> ModelRecord:
        """The model as it is sent and stored."""
        return ModelRecord(self.version, self.kind, self.trained_on, self.parameters)

    @classmethod
    def from_record(cls, record: ModelRecord, machine: Machine, **options: Any) -> Self:
        """The model that a record describes.

        Raises:
            ModelError: a record of another kind, or parameters that cannot be this model's.
        """
        if record.kind != cls.kind:
            where = f"model version {record.version}"
            raise ModelError(where, f"kind {cls.kind!r}", repr(record.kind))
        try:
            _refuse_non_finite(record.parameters)
            return cls(machine, record.parameters, record.version, record.trained_on, **options)
        except ModelError:
            raise
        except Exception as error:  # what comes from outside can break `build` in any way
            where, expected = f"model version {record.version}", f"parameters of a {cls.kind} model"
            raise ModelError(where, expected, reason_of(error)) from error


def _refuse_non_finite(value: Any) -> None:
    if isinstance(value, Mapping):
        for item in value.values():
            _refuse_non_finite(item)
    elif isinstance(value, list | tuple):
        for item in value:
            _refuse_non_finite(item)
    elif isinstance(value, float) and not math.isfinite(value):
        raise ValueError(f"{value} among the parameters")
