"""Which causes of a version may not be told to people as what has changed, and why.

A prediction may use what a sentence may not claim.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from contextlib import suppress

import numpy as np

from ldt_core.base.arrays import Array
from ldt_core.base.errors import OptionError
from ldt_core.base.experiment import Experiment, rms
from ldt_core.base.pausable import finished
from ldt_core.base.sentences import listed, spoken
from ldt_core.base.threads import one_thread
from ldt_core.diagnosis.thresholds import THRESHOLDS
from ldt_core.effects.change_description import apart
from ldt_core.estimation.fitted_structure import FittedStructure
from ldt_core.estimation.grey_box import GreyBox, Prior
from ldt_core.estimation.structure_screening import Present
from ldt_core.estimation.structure_search import StructureSearch
from ldt_core.machine.machine_file import Machine
from ldt_core.models.base import Model
from ldt_core.models.causes import SURE, Causes, Doubts
from ldt_core.models.grey_box import ALIKE, GreyBoxModel
from ldt_core.physics.effect import Effect
from ldt_core.physics.machine_sizes import is_amount, is_limit
from ldt_core.twin.candidates import UNLEARNABLE, numbers_of_file
from ldt_core.twin.version_errors import errs_less, far

#: Families between which a scale of all torques decides.
SCALED = {"inertia", "resistance"}
#: What torques that are larger than the file says look like, at least.
DRAG = "viscous_friction"
#: Turns, between rise and fall, from which on an amount is another one each time: a machine that is
#: repaired has one.
TURNS = 2


def doubts(
    model: Model,
    before: Model,
    earlier: Sequence[Model],
    experiments: Sequence[Experiment],
    hardly: bool = False,
    lasting: bool = False,
) -> Doubts:
    """What is not known of the change from one version to the next.

    An effect is not known to act that the experiments are explained without as well, by the
    machine's own parameters within their tolerances: that it acts would rest on these not having
    changed. One that contradicts itself from version to version, beyond chance. One that takes the
    place of a like one, where the machine has hardly changed: its law is the same. And one that the
    measured current contradicts: a load that is twice as heavy, friction and all, looks in the
    speed like twice the resistance. Nor is it known that one has gone, or changed, which may as
    well act as before: few experiments do not show all that acts.

    Args:
        model: that comes into force.
        before: that was in force.
        earlier: that were in force before, `before` the last.
        experiments: the newest, or the last ones of few samples.
        hardly: whether the version before errs hardly more in these than in others.
        lasting: whether the machine is as it was, and only known better.
    """
    if not isinstance(model, GreyBoxModel):
        return SURE
    known, causes = before.causes if isinstance(before, GreyBoxModel) else Causes(), model.causes
    found: dict[str, str] = {}
    strained: dict[str, list[str]] = {}
    stays, moves = set(), set()
    own = "" if hardly or lasting else _own_moves(model, before)
    for effect in model.effects:
        acted = known.name(effect)
        # What several amounts do together may be apart where none of them is.
        alike = acted and known.interval(effect).keys() == causes.interval(effect).keys()
        together = alike and len(effect.parameters) > 1 and not (own or hardly or lasting)
        if not causes.name(effect) or not (together or causes.moved(known, effect)):
            continue
        name = spoken(effect.name)
        # Whatever moves the file's own numbers far moves what acts along.
        if acted and (
            far(model.box, model.q) or _as_likely_as_before(model, before, effect, experiments)
        ):
            stays.add(effect.name)
            continue
        moves.add(effect.name)
        if hardly and (place := _place_taken(causes, known, effect)):
            found[effect.name] = f"{name} explains it in the place of {spoken(place)}"
        elif _contradicts(effect, [*earlier, model]):
            found[effect.name] = f"the {name} that explains it is another one each time"
            if effect.states:
                states = listed(map(spoken, effect.states))
                found[effect.name] += f" (nobody measures its {states} at the start)"
        elif _current_speaks_against(model, effect, experiments):
            found[effect.name] = f"the measured current speaks against {name}"
        elif without := explained_without(model, effect, experiments):
            number, tolerances = without
            if tolerances > THRESHOLDS.prior_deviations:
                strained[effect.name] = [f"{number} {tolerances:.1f} tolerances from the file's"]
            else:
                found[effect.name] = f"the machine's own parameters explain it without {name}, too"
        if effect.name not in found and (others := _other_numbers(model, effect, experiments)):
            strained[effect.name] = [*others, *strained.get(effect.name, [])]
    for effect in known.effects:
        gone = effect.name not in (*causes.given, *causes.alike) and known.name(effect)
        if gone and hardly:
            stays.add(effect.name)
            continue
        if gone and _may_stay(model, effect, known.given[effect.name], experiments):
            found[effect.name] = f"{spoken(effect.name)} may act as before"
    return Doubts(found, strained, stays, moves, own)


def _own_moves(model: GreyBoxModel, before: Model) -> str:
    """By how much the machine's own parameters are other ones than before, as far as that is more
    than a tolerance; "" for nothing.
    """
    if not isinstance(before, GreyBoxModel):
        return ""
    box, said = model.box, []
    for i, name in enumerate(box.uncertain):
        by = float(model.q[i] - before.q[i])
        if abs(by) > 1:
            percent = 100 * abs(math.expm1(box.tolerance[i] * by))
            said.append(f"{name} {percent:.0f} % {'higher' if by > 0 else 'lower'}")
    return f"{listed(said)} would explain it" if said else ""


def _place_taken(causes: Causes, known: Causes, effect: Effect) -> str:
    """The name of a like effect that acts no more where this one begins to; "" where none is."""
    if effect.name in known.given:
        return ""
    for gone in known.effects:
        named = known.name(gone) and gone.name not in causes.given
        tied = gone.name in causes.alike or effect.name in known.alike
        if named and (tied or (gone.family and gone.family == effect.family)):
            return gone.name
    return ""


def _other_numbers(
    model: GreyBoxModel, effect: Effect, experiments: Sequence[Experiment]
) -> list[str]:
    """What other number of the machine file explains as much in the place of one that has changed,
    beside what `Causes.alike` says.

    In the speed, twice the inertia is twice the resistance with half of all torques. Few files know
    these, so a drag may come along.
    """
    library = numbers_of_file(model.machine)
    if all(e.name != effect.name for e in library):
        return []
    rest = {n: dict(v) for n, v in model.given.items() if n != effect.name}
    acting = tuple(e for e in model.effects if e.name in rest)
    starts = [Present(acting, rest, model.present.prior)]
    with suppress(OptionError):
        drag = model.machine.effect(DRAG)
        drag.require(model.machine.model)
        if DRAG not in rest:
            with_drag = {**rest, DRAG: drag.neutral}
            starts.append(Present((*acting, drag), with_drag, starts[0].prior))
    said = {*model.given, *(model.causes.alike if effect is model.effects[-1] else ())}
    rivals = [e for e in library if e.name not in said]
    found: list[Effect] = []
    with suppress(*UNLEARNABLE), one_thread():
        search = model.search_on(experiments)
        most = _refined(model, model.effects, model.given, experiments).score + ALIKE
        tried = rivals
        for begin in starts:
            for other in finished(search.leading(begin, tried)):
                fitted = finished(search.beside(begin, other))
                if fitted.explains and fitted.score < most:
                    found.append(other)
            tried = [e for e in rivals if e not in found and {effect.family, e.family} == SCALED]
    return [spoken(e.name) for e in library if e in found]


def _current_speaks_against(
    model: GreyBoxModel, effect: Effect, experiments: Sequence[Experiment]
) -> bool:
    """Whether, at the measured speed, the current is more nearly that without an effect.

    The machine's own parameters are the same in both: a fit to the speed moves them within their
    tolerances, and what that does to the current tells nothing of an effect.
    """
    told = [(e, e.current) for e in experiments if e.current is not None]
    rest = tuple(e for e in model.effects if e is not effect)
    without = GreyBox(model.machine, rest, model.machine.tolerances)
    q = without.coordinates(model.given, model.q[: len(without.uncertain)])

    def left(box: GreyBox, q: Array) -> list[Array]:
        return [measured - box.current_at_speed(q, e) for e, measured in told]

    error = sum(rms(row) ** 2 for row in left(model.box, model.q))
    return error > 0 and errs_less(left(without, q), error)


def _as_likely_as_before(
    model: GreyBoxModel, before: Model, effect: Effect, experiments: Sequence[Experiment]
) -> bool:
    """Whether experiments are as likely, by what was known, where an effect acts as before.

    The machine's own parameters, and all other effects, may then have changed more. An amount
    that has changed costs the price of a parameter (see `FittedStructure.score`), and the odds
    that it has are to be strong.
    """
    assert isinstance(before, GreyBoxModel)
    held = [(effect, before.given[effect.name])]
    rest = tuple(e for e in model.effects if e is not effect)
    with suppress(*UNLEARNABLE):
        own = before.prior
        free = _refined(model, model.effects, model.given, experiments, prior=own)
        machine = model.machine.with_effects(held)
        stays = _refined(model, rest, model.given, experiments, machine, own)
        return stays.explains and stays.score < free.score + ALIKE
    return False


def explained_without(
    model: GreyBoxModel, effect: Effect, experiments: Sequence[Experiment]
) -> tuple[str, float] | None:
    """The machine's own parameter that is then farthest from the file's, and by how many
    tolerances, where these and the other effects explain experiments as well. An effect that the
    file knows acts as there.
    """
    rest = tuple(e for e in model.effects if e is not effect)
    with suppress(*UNLEARNABLE):
        known = [(e, values) for e, values in model.machine.effects if e.name == effect.name]
        machine = model.machine.with_effects(known) if known else None
        found = _refined(model, rest, model.given, experiments, machine)
        if found.explains:
            return found.box.farthest(found.fit.q)
    return None


def _may_stay(
    model: GreyBoxModel,
    effect: Effect,
    values: Mapping[str, float],
    experiments: Sequence[Experiment],
) -> bool:
    """Whether an effect is likelier to act by these values than not at all, beside the causes."""
    given = {**model.given, effect.name: values}
    with suppress(*UNLEARNABLE):
        found = _refined(model, (*model.effects, effect), given, experiments)
        return found.explains and found.keeps(effect, {effect.name: values})
    return False


def _refined(
    model: GreyBoxModel,
    effects: tuple[Effect, ...],
    given: Mapping[str, Mapping[str, float]],
    experiments: Sequence[Experiment],
    machine: Machine | None = None,
    prior: Prior | None = None,
) -> FittedStructure:
    """These effects, fitted next to their values and to the model's own parameters.

    Args:
        machine: with effects that are known to act; None for the model's.
        prior: of the model's machine coordinates; None for what the file says.

    Raises:
        LdtError: too few samples.
    """
    acting = {e.name: dict(given[e.name]) for e in effects}
    search = model.search_on(experiments)
    machine = machine or model.machine
    box, names = GreyBox(machine, effects, machine.tolerances), model.box.uncertain
    # What the file knows of an effect is no coordinate where its values are given as exact.
    own = dict(zip(names, model.q[: len(names)].tolist(), strict=True))
    near = box.coordinates(acting, np.array([own.get(n, 0.0) for n in box.uncertain]))
    known = (prior or model.present.prior).among(names, box.uncertain)
    begin = Present(effects, acting, known)
    about = machine.tolerances, search.experiments, search.noise, search.workers
    with one_thread():
        return finished(StructureSearch(machine, *about).refined(begin, near))


def _contradicts(effect: Effect, versions: Sequence[Model]) -> bool:
    """Whether versions that name an effect cannot all be right about it.

    What says how much of it there is may grow, fall when the machine is repaired, and begin anew
    when it had gone; all else is the machine's for good, but for the angle at the start.
    """
    causes = [m.causes for m in versions if isinstance(m, GreyBoxModel)]
    naming = [c for c in causes if c.name(effect)]
    gone = max((i for i, c in enumerate(causes) if effect.name not in c.given), default=-1)
    row = [c for c in causes[gone + 1 :] if c in naming]
    for p in effect.parameters:
        amount = is_amount(p) or is_limit(p)
        known = [c.interval(effect).get(p.name) for c in (row if amount else naming)]
        ways = _ways(known)
        turns = sum(one != other for one, other in itertools.pairwise(ways))
        if turns >= TURNS or (ways and not amount and not p.cyclic):
            return True
    return False


def _ways(intervals: Sequence[tuple[float, float] | None]) -> list[int]:
    """Its changes beyond chance: 1 where it rises, -1 where it falls."""
    ways, last = [], None
    for here in intervals:
        way = apart(last, here)
        if way:
            ways.append(way)
        if way or last is None:
            last = here
    return ways
