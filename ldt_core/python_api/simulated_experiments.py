"""Experiments of a simulated machine: `simulate`."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from typing import Any

from ldt_core.base.errors import ArgumentTypeError, OptionError, described
from ldt_core.base.experiment import Experiment
from ldt_core.base.settings import FROM_FILE, resolve
from ldt_core.effects import parse_effect
from ldt_core.machine import Plant
from ldt_core.machine.machine_file import Machine
from ldt_core.machine.plant import EffectUse
from ldt_core.physics.effect import Effect
from ldt_core.python_api.recorded_experiments import MachineLike

Effects = Mapping[str | Effect, Mapping[str, float]] | Iterable[str | Effect]


def simulate(
    machine: MachineLike,
    experiments: int = 200,
    effects: Effects = (),
    seed: int = 0,
    noise: float = FROM_FILE,
    **settings: Any,
) -> list[Experiment]:
    """Simulate a machine, with effects that its file does not contain.

    The numbers are those of `ldt simulate` with the same seed. The first experiment starts at time
    0 unless `start_time` says otherwise; nothing wears unless `degradation` says so.

    Args:
        machine: its name or file, or a `Machine`.
        experiments: how many.
        effects: effect → its parameters in SI units, as in `{"unbalance": {"e": 0.005}}`; or
            effects alone, which then have their typical values. An effect is a name or an `Effect`.
        seed: of all random numbers.
        noise: standard deviation on the measured speed [rad/s]; -1 uses the machine file.
        settings: further options of `ldt simulate` (`voltage="chirp"`, `measure_current=True`).

    Returns:
        One `Experiment` each, with `voltage` (L,) [V] and `speed` (L,) [rad/s].

    Raises:
        BadInput: an argument that cannot be used.
        LdtError: the simulation diverges.
    """
    known = Machine(machine)
    given = {"start_time": 0.0, "degradation": "none", **settings}
    given |= {"experiments": experiments, "seed": seed, "noise": noise}
    resolved = resolve(given, "plant", "run")
    plant = Plant.from_settings(known, resolved, effect_uses(effects, known.law))
    return [plant.experiment(number) for number in range(1, resolved["experiments"] + 1)]


def effect_uses(effects: Effects, law: Callable[[str], Effect]) -> list[EffectUse]:
    """Each effect with all its values; `law` finds one by its name.

    Raises:
        OptionError: an unknown effect or parameter, or a value outside its bounds.
        ArgumentTypeError: something that is no effect.
    """
    if isinstance(effects, str | Effect):
        return [_use(effects, None, law)]
    if isinstance(effects, Mapping):
        return [_use(effect, values, law) for effect, values in effects.items()]
    if isinstance(effects, Iterable):
        return [_use(effect, None, law) for effect in effects]
    expected = 'effects with their parameters, {"unbalance": {"e": 0.005}}'
    raise ArgumentTypeError("effects", expected, described(effects))


def _use(given: object, values: object, law: Callable[[str], Effect]) -> EffectUse:
    if not isinstance(given, str | Effect):
        raise ArgumentTypeError("effects", "names or ldt.Effect objects", described(given))
    if isinstance(given, str) and values is None:
        return parse_effect(given, law)
    effect = law(given) if isinstance(given, str) else given
    if values is None:
        return effect, effect.check(effect.typical)
    where = f"effect {effect.name}"
    if not isinstance(values, Mapping):
        expected = f"values of {', '.join(p.name for p in effect.parameters)} by name"
        raise ArgumentTypeError(where, expected, described(values))
    for name, value in values.items():
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise OptionError(f"{where}, {name}", "a number", described(value))
    return effect.used(values or effect.typical)
