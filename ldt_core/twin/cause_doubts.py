"""Which causes of a version may not be told to people as what has changed, and why.

A prediction may use what a sentence may not claim.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import replace

from ldt_core.base.arrays import Array
from ldt_core.base.experiment import Experiment, rms
from ldt_core.base.pausable import finished
from ldt_core.base.sentences import listed, spoken
from ldt_core.base.threads import one_thread
from ldt_core.diagnosis.thresholds import THRESHOLDS
from ldt_core.effects.change_description import apart
from ldt_core.estimation.fitted_structure import FittedStructure
from ldt_core.estimation.grey_box import GreyBox
from ldt_core.models.base import Model
from ldt_core.models.causes import Causes
from ldt_core.models.grey_box import GreyBoxModel
from ldt_core.physics.effect import Effect
from ldt_core.physics.machine_sizes import is_amount, is_limit
from ldt_core.twin.candidates import UNLEARNABLE
from ldt_core.twin.version_errors import errs_less

#: Turns, between rise and fall, from which on an amount is another one each time: a machine that is
#: repaired has one.
TURNS = 2


def doubts(
    model: Model, before: Model, earlier: Sequence[Model], experiments: Sequence[Experiment]
) -> tuple[dict[str, str], dict[str, str]]:
    """Names of effects that are not known to act, and why; and of those that one of the machine's
    own parameters far from the file's would explain as well, and which.

    Not known is one that the experiments are explained without as well, by the machine's own
    parameters within their tolerances: that it acts would rest on these not having changed. One
    that contradicts itself from version to version, beyond chance. And any, where the current was
    measured and comes out worse than before: a load that is twice as heavy, friction and all, looks
    in the speed like twice the resistance. Nor is it known that one has gone which may as well act
    as before: few experiments do not show all that acts.

    Args:
        model: that comes into force.
        before: that was in force.
        earlier: that were in force before, `before` the last.
        experiments: the newest, or the last ones of few samples.
    """
    if not isinstance(model, GreyBoxModel):
        return {}, {}
    known, causes = before.causes if isinstance(before, GreyBoxModel) else Causes(), model.causes
    found, strained = {}, {}
    against = _current_speaks_against(model, [before, *earlier], experiments)
    for effect in model.effects:
        if not (causes.name(effect) and causes.moved(known, effect)):
            continue
        name = spoken(effect.name)
        if _contradicts(effect, [*earlier, model]):
            found[effect.name] = f"the {name} that explains it is another one each time"
            if effect.states:
                states = listed(map(spoken, effect.states))
                found[effect.name] += f" (nobody measures its {states} at the start)"
        elif against:
            found[effect.name] = f"the measured current speaks against {name}"
        elif without := explained_without(model, effect, experiments):
            own, far = without
            if far > THRESHOLDS.prior_deviations:
                strained[effect.name] = f"{own} {far:.1f} tolerances from the file's"
            else:
                found[effect.name] = f"the machine's own parameters explain it without {name}, too"
    for effect in known.effects:
        gone = effect.name not in (*causes.given, *causes.alike) and known.name(effect)
        if gone and _may_stay(model, effect, known.given[effect.name], experiments):
            found[effect.name] = f"{spoken(effect.name)} may act as before"
    return found, strained


def _current_speaks_against(
    model: GreyBoxModel, versions: Sequence[Model], experiments: Sequence[Experiment]
) -> bool:
    """Whether, at the measured speed, one of the versions before has the current more nearly."""

    def left(version: GreyBoxModel) -> list[Array]:
        told = ((e, e.current) for e in experiments if e.current is not None)
        return [measured - version.box.current_at_speed(version.q, e) for e, measured in told]

    error = sum(rms(row) ** 2 for row in left(model))
    grey = [m for m in versions if isinstance(m, GreyBoxModel)]
    return error > 0 and any(errs_less(left(version), error) for version in grey)


def explained_without(
    model: GreyBoxModel, effect: Effect, experiments: Sequence[Experiment]
) -> tuple[str, float] | None:
    """The machine's own parameter that is then farthest from the file's, and by how many
    tolerances, where these and the other effects explain experiments as well.
    """
    rest = tuple(e for e in model.effects if e is not effect)
    with suppress(*UNLEARNABLE):
        found = _refined(model, rest, model.given, experiments)
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
) -> FittedStructure:
    """These effects, fitted next to their values and to the model's own parameters.

    Raises:
        LdtError: too few samples.
    """
    acting = {e.name: dict(given[e.name]) for e in effects}
    own = model.q[: len(model.box.uncertain)]
    near = GreyBox(model.machine, effects, model.machine.tolerances).coordinates(acting, own)
    begin = replace(model.present, effects=effects, given=acting)
    with one_thread():
        return finished(model.search_on(experiments).refined(begin, near))


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
