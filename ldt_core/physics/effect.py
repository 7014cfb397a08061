"""What an effect is: bounded parameters and one function on one stage of the machine.

A user's own effect is a file with such an object, named by entry point (group `ldt.effect`) or as
`path/to/file.py:NAME`:

    def torque(t, theta, omega, current, voltage, p):
        return -p[0] * omega**3

    CUBIC_DRAG = Effect(
        name="cubic_drag",
        description="drag that grows with the cube of the speed",
        equation="torque = -c omega^3",
        parameters=(
            Parameter("c", "N m s^3", 0.0, default=0.0, description="coefficient", scale=1e-6),
        ),
        typical={"c": 1e-6},
        torque=torque,
    )

`ldt effects path/to/file.py:CUBIC_DRAG` checks it (`ldt_core/checks/effect_checks.py`).
"""

from __future__ import annotations

import dis
import functools
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Protocol

import numpy as np

from ldt_core.base.arrays import Array
from ldt_core.base.errors import (
    LdtError,
    OptionError,
    described,
    did_you_mean,
    reason_of,
)
from ldt_core.base.sentences import listed
from ldt_core.physics.parameter import LARGEST, SMALLEST, Parameter, Values, own_name
from ldt_core.physics.term_helpers import code_of
from ldt_core.physics.terms import ARGUMENTS, Terms, compile_term


class HasParameters(Protocol):
    """What an effect asks of a physics: its name, and its parameters with their bounds."""

    @property
    def name(self) -> str:
        """In the registry."""

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """In their order."""


READ = ARGUMENTS[:-1]  # of what torque and terminal take, what changes over a run
STAGES = ("on_parameters", "on_voltage", "torque", "terminal", "on_measurement")


@dataclass(frozen=True, eq=False)
class Effect:
    """Something that a real machine has and its file may not know.

    Args:
        name: in the registry, in `--effect` and in a diagnosis.
        description: one line for people.
        equation: what it changes, as a formula.
        parameters: with unit and physical bounds, signs included. Defaults together are neutral: an
            effect with its default values changes nothing. One without a scale has that of its
            typical value. Library scales are the worked case's, others those of the user's machine.
        typical: values of an effect that is plainly there; what the bare name means on a command
            line. Parameters that are left out have their default.
        on_parameters: (values, **p) -> values: other parameters of the machine.
        on_voltage: (times, volts, **p) -> (times, volts): what reaches the terminals. Each level
            holds from its time to the next; the first time is -inf, for what held before.
        torque: (t, theta, omega, current, voltage, p) -> torque on the shaft [N m]; see
            `physics/terms.py`. Compiled, so of plain arithmetic and `math` only.
        terminal: the same, -> voltage that adds to the supply's at the terminals [V]. What acts on
            both sides of the motor, without states of its own, has both functions.
        on_measurement: (speed (L,) [rad/s], period [s], **p) -> (L,) speed as it is measured.
        states: names of states of its own; only with torque or terminal, whose function then takes
            (…, p, state, rate) and writes rate[:]. Such an effect may have `on_parameters` too, for
            what moves from the machine's equations into its states.
        initial: (machine's first state, **p) -> its own first states; None means 0.
        needs: parameters of the machine without which the effect makes no sense; torque and
            terminal find their values in p, after the effect's own.
        fastest: (values, voltage, **p) -> fastest rate of change that the effect brings with it
            [1/s], from the machine's parameters and its largest voltage; bounds the step.
        reference: where the formula is from.
        family: of effects that are alike but for details of their laws. As no law is exactly a
            machine's, a diagnosis names a second one of a family only on stronger evidence.
        most_factor: times its value that a parameter may have become, for a diagnosis; with more,
            it takes the machine for another one. An amount may be so much smaller, too.
        search: values of parameters that a diagnosis begins with, every combination; for those
            that are not named it takes values about their scale.
        blows: whether parts of it meet; fits then take slopes over longer differences.
        detailed: the same law in more detail, an effect of the same name with further parameters.
            It acts where one is given; a diagnosis tries it where the plain law falls short. It may
            have a finer one in turn, which is not named: a twin that predicts by it claims less.

    Raises:
        OptionError: not one function, nor torque and terminal; a parameter without default.
    """

    name: str
    description: str
    equation: str
    parameters: tuple[Parameter, ...]
    typical: Values = field(default_factory=dict)
    on_parameters: Callable[..., Values] | None = None
    on_voltage: Callable[..., tuple[Array, Array]] | None = None
    torque: Callable[..., float] | None = None
    terminal: Callable[..., float] | None = None
    on_measurement: Callable[..., Array] | None = None
    states: tuple[str, ...] = ()
    initial: Callable[..., tuple[float, ...]] | None = None
    needs: tuple[str, ...] = ()
    fastest: Callable[..., float] | None = None
    reference: str = ""
    family: str = ""
    most_factor: float = 20.0
    search: Mapping[str, tuple[float, ...]] = field(default_factory=dict)
    blows: bool = False
    detailed: Effect | None = None

    def __post_init__(self) -> None:
        where = f"effect {self.name}"
        if not isinstance(self.name, str) or not self.name.isidentifier():
            expected = "letters, digits and _, as in cubic_drag"  # ":", "." and "," end a name
            raise OptionError("effect, name", expected, repr(self.name))
        given = self.parameters if isinstance(self.parameters, list | tuple) else (None,)
        if not all(isinstance(p, Parameter) for p in given):
            expected = "a tuple of Parameter objects, as in (Parameter(...),)"
            raise OptionError(f"{where}, parameters", expected, described(self.parameters))
        names = [p.name for p in self.parameters]
        if len({*names}) < len(names):
            raise OptionError(f"{where}, parameters", "a name each", listed(names))
        stages = [s for s in STAGES if getattr(self, s) is not None]
        one = [s for s in stages if not (self.states and s == "on_parameters")]
        both = one == ["torque", "terminal"] and not self.states
        if not both and (len(one) != 1 or (self.states and one[0] not in ("torque", "terminal"))):
            expected = f"one function among {', '.join(STAGES)}, or torque and terminal"
            raise OptionError(where, expected, stages or "none")
        for parameter in self.parameters:
            if parameter.default is None or not parameter.accepts(parameter.default):
                raise OptionError(f"{where}, {parameter.name}", "a default", parameter.default)
        self.check(self.typical)
        object.__setattr__(self, "parameters", tuple(map(self._scaled, self.parameters)))

    def _scaled(self, parameter: Parameter) -> Parameter:
        """With a scale: a search that began at 1 would miss a drag of 1e-9, and say nothing."""
        far = abs(self.typical.get(parameter.name, 0.0) - (parameter.default or 0.0))
        if parameter.scale is not None or parameter.name not in self.typical or far == 0:
            return parameter
        return replace(parameter, scale=far)

    @property
    def neutral(self) -> dict[str, float]:
        """The values that change nothing."""
        return {p.name: float(p.default) for p in self.parameters if p.default is not None}

    def used(self, given: Mapping[str, Any]) -> tuple[Effect, dict[str, float]]:
        """The effect in the detail that the values given ask for, and all its values.

        Raises:
            OptionError: as `check`.
        """
        effect = self.in_detail(given)
        return effect, effect.check(given)

    def in_detail(self, given: Collection[str]) -> Effect:
        """The plainest law that has all parameters of these names, else the finest."""
        own = {p.name for p in self.parameters}
        if self.detailed is None or own.issuperset(given):
            return self
        return self.detailed.in_detail(given)

    @property
    def finest(self) -> Effect:
        """The law in all detail."""
        return self if self.detailed is None else self.detailed.finest

    @property
    def all_parameters(self) -> tuple[Parameter, ...]:
        """Those of the law in all detail."""
        return self.finest.parameters

    def check(self, given: Mapping[str, Any]) -> dict[str, float]:
        """All parameters: those given, checked, and the defaults of the others.

        Raises:
            OptionError: an unknown parameter or a value outside its bounds.
        """
        known = {p.name: p for p in self.parameters}
        values = self.neutral
        for name, value in given.items():
            if name not in known:
                raise OptionError(f"effect {self.name}", did_you_mean(name, known), repr(name))
            if not known[name].accepts(value):
                raise OptionError(f"effect {self.name}, {name}", known[name].range, f"{value:g}")
            least = 0.0 if known[name].accepts(0.0) else SMALLEST
            if not least <= abs(value) <= LARGEST:
                expected = f"a size from {least:g} to {LARGEST:g}"
                raise OptionError(f"effect {self.name}, {name}", expected, f"{value:g}")
            values[name] = float(value)
        return values

    @property
    def is_folded(self) -> bool:
        """Whether all that it does is to change parameters, which then say it all."""
        return self.on_parameters is not None and not self.states

    def require(self, physics: HasParameters) -> None:
        """Refuse (OptionError) a machine without a parameter that the effect needs."""
        if not self.needs:
            return
        known = [p.name for p in physics.parameters]
        missing = [name for name in self.needs if name not in known]
        if missing:
            expected = f"a machine with parameter {' and '.join(missing)}"
            raise OptionError(f"effect {self.name}", expected, f"physics {physics.name!r}")

    def change_parameters(self, physics: HasParameters, values: Values, given: Values) -> Values:
        """The machine's parameters with this effect.

        Where the machine is known to have this effect, the values given take the known one's place.

        Raises:
            OptionError: a machine that cannot have this effect, or parameters that no machine has.
        """
        self.require(physics)
        if not self._own_names.isdisjoint(values):
            values = {n: v for n, v in values.items() if n not in self._own_names}
        if self.on_parameters is None:
            return values
        # A copy: a function that writes into it would change the machine, a bit more at each run.
        changed = self._asked(self.on_parameters, {**values}, **given)
        for parameter in physics.parameters:
            if parameter.name not in values:
                continue
            if not isinstance(changed, Mapping) or parameter.name not in changed:
                where = f"effect {self.name}, on_parameters"
                expected = f"all of the machine's parameters, {parameter.name} among them"
                raise OptionError(where, expected, described(changed))
            value = changed[parameter.name]
            if value is not values[parameter.name] and not parameter.accepts(value):
                where = f"effect {self.name}, {parameter.name} of the machine"
                raise OptionError(where, parameter.range, f"{value:g}")
        return changed

    def rate(self, values: Values, voltage: float, given: Values) -> float:
        """Fastest rate of change that the effect brings with it [1/s]."""
        if self.fastest is None:
            return 0.0
        return float(self._asked(self.fastest, values, voltage, **given))

    def switched(self, times: Array, levels: Array, given: Values) -> tuple[Array, Array]:
        """What `on_voltage` makes of (S,) times [s] and (S,) levels [V].

        Raises:
            LdtError: it fails, or gives no such rows.
        """
        assert self.on_voltage is not None
        at, volts = self._asked(self.on_voltage, times, levels, **given)
        if np.ndim(at) != 1 or np.shape(at) != np.shape(volts) or not (np.diff(at) >= 0).all():
            expected = "times in order and as many levels"
            raise OptionError(f"effect {self.name}, on_voltage", expected, described(at))
        return at, volts

    def shown(self, speed: Array, period: float, given: Values) -> Array:
        """What `on_measurement` makes of a speed (L,) [rad/s]; raises as `switched`."""
        assert self.on_measurement is not None
        seen: Array = self._asked(self.on_measurement, speed, period, **given)
        if np.shape(seen) != speed.shape:
            expected, got = f"{speed.size} measured speeds", described(seen)
            raise OptionError(f"effect {self.name}, on_measurement", expected, got)
        return seen

    def _asked(self, function: Callable[..., Any], *arguments: Any, **given: float) -> Any:
        """What a function says, which may be the user's own and fail."""
        try:
            return function(*arguments, **given)
        except (LdtError, KeyboardInterrupt):
            raise
        except BaseException as error:
            raise LdtError(f"effect {self.name}: {reason_of(error)}") from error

    def first_states(self, state: Array, given: Values) -> tuple[float, ...]:
        """The effect's own states at the first sample, from the machine's (n,)."""
        return (0.0,) * len(self.states) if self.initial is None else self.initial(state, **given)

    @functools.cached_property
    def terms(self) -> tuple[Effect, ...]:
        """It by its torque and by its voltage: one effect, or one for each."""
        if self.torque is None or self.terminal is None:
            return (self,) if self.torque or self.terminal else ()
        return replace(self, terminal=None), replace(self, torque=None)

    @functools.cached_property
    def _own_names(self) -> frozenset[str]:
        return frozenset(own_name(self.name, p.name) for p in self.parameters)

    @functools.cached_property
    def reads(self) -> frozenset[str]:
        """Which of t, theta, omega, current, voltage its torque or terminal function may read.

        As its bytecode says; of what is no plain Python function, all.
        """
        function = self.torque or self.terminal
        code = code_of(function) if function else None
        if code is None or code.co_argcount < len(READ):
            return frozenset(READ)
        given = code.co_varnames[: len(READ)]
        named = {x for i in dis.get_instructions(code) for x in _named(i.argval)}
        return frozenset(a for a, name in zip(READ, given, strict=True) if name in named)

    @functools.cached_property
    def compiled(self) -> Any:
        """The torque or terminal function as machine code, an OptionError where numba fails."""
        function = self.torque or self.terminal
        assert function is not None
        return compile_term(f"effect {self.name}", function, bool(self.states))

    @functools.cached_property
    def compiled_for_lanes(self) -> Any:
        """The same for eight runs at once, None where it must be called for one at a time."""
        from ldt_core.physics.lane_terms import compile_for_lanes

        function = self.torque or self.terminal
        assert function is not None
        return compile_for_lanes(function, bool(self.states))

    def about(self, known: Values) -> Effect:
        """The same effect as a change from what is known of it: these values are neutral.

        Its typical values are as far from them as they are from the defaults, by the same factor
        where a parameter multiplies one of the machine's.
        """
        parameters, typical = [], dict(known)
        for p in self.parameters:
            parameters.append(replace(p, default=known[p.name], idle=p.default))
            if p.name in self.typical and p.default is not None:
                far = self.typical[p.name]
                moved = far * known[p.name] if p.default == 1 else far + known[p.name] - p.default
                typical[p.name] = moved if p.accepts(moved) else far
        return replace(self, parameters=tuple(parameters), typical=typical, detailed=None)

    def describe(self, given: Values) -> str:
        """The effect as one would write it after `--effect`."""
        changed = [f"{n}={v:g}" for n, v in given.items() if v != self.neutral[n]]
        return self.name + (":" + ",".join(changed) if changed else "")


def _named(argument: Any) -> tuple[Any, ...]:
    """Names in an instruction's argument: one or, of two instructions in one, two."""
    return argument if isinstance(argument, tuple) else (argument,)


def gather(
    terms: Sequence[tuple[Effect, Mapping[str, float]]],
    values: Mapping[str, float],
    watched: Sequence[bool] = (),
    quiet: tuple[float, float] = (0.0, 0.0),
) -> Terms:
    """The terms of these effects, for a machine with these parameters.

    `watched` says of each term whether it asks for shorter steps than the machine (none if empty),
    `quiet` which change of a torque [N m] and of a voltage [V] needs no shorter ones.
    """
    parameters, first_parameter, first_state = term_parameters(terms, values)
    return Terms(
        np.array([effect.compiled.address for effect, _ in terms], dtype=np.int64),
        np.array([effect.terminal is not None for effect, _ in terms], dtype=np.bool_),
        np.array([len(effect.states) > 0 for effect, _ in terms], dtype=np.bool_),
        np.array(first_parameter, dtype=np.int64),
        np.array(first_state, dtype=np.int64),
        np.array(parameters),
        np.array(watched, dtype=np.bool_),
        np.zeros(len(terms)),
        np.zeros(len(terms)),
        np.array([quiet[effect.terminal is not None] for effect, _ in terms], dtype=np.float64),
    )


def term_parameters(
    terms: Sequence[tuple[Effect, Mapping[str, float]]], values: Mapping[str, float]
) -> tuple[list[float], list[int], list[int]]:
    """The terms' parameters behind each other, where each one's begin, where its states do."""
    parameters: list[float] = []
    first_parameter, first_state, states = [], [], 0
    for effect, given in terms:
        first_parameter.append(len(parameters))
        first_state.append(states)
        parameters += [given[p.name] for p in effect.parameters]
        parameters += [values[name] for name in effect.needs]
        states += len(effect.states)
    return [*parameters, 0.0], first_parameter, first_state
