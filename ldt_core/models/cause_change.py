"""What has become of a grey box's causes since an earlier version, in words."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

from ldt_core.base.sentences import listed, spoken
from ldt_core.effects.change_description import apart, change_of, doubt_of

if TYPE_CHECKING:
    from ldt_core.models.grey_box import GreyBoxModel
    from ldt_core.physics.effect import Effect


def is_named(model: GreyBoxModel | None, effect: Effect) -> bool:
    """Whether it acts there, by an amount that is known well enough to be told."""
    if model is None or effect.name not in model.given:
        return False
    return not doubt_of(effect, model.intervals(effect.name))


def has_moved(model: GreyBoxModel, before: GreyBoxModel | None, effect: Effect) -> bool:
    """Whether an effect's amounts are other ones than in an earlier version, beyond chance."""
    if before is None or not is_named(before, effect):
        return True
    was, now = before.intervals(effect.name), model.intervals(effect.name)
    return was.keys() != now.keys() or any(apart(was[n], now[n]) for n in now)


def change_of_causes(
    model: GreyBoxModel, before: GreyBoxModel | None, doubts: Mapping[str, str]
) -> str:
    """What has changed; "" where nothing has, beyond chance.

    Args:
        model: as the machine is now.
        before: as it was; None where that is not known by causes.
        doubts: names of effects that are not known to act, and why.
    """
    old = {} if before is None else before.given
    said, unknown, alike = [], [], model.parameters["alike"]
    for effect in model.effects:
        name = effect.name
        if not has_moved(model, before, effect):
            continue
        if doubt := doubts.get(name) or doubt_of(effect, model.intervals(name)):
            unknown.append(doubt)
        else:
            was = {**effect.neutral, **old.get(name, {})}
            said.append(change_of(effect, was, model.given[name], model.intervals(name)))
            if alike and effect is model.effects[-1]:
                others = listed([spoken(n) for n in alike], "or")
                said[-1] += f" (or {others}: not told apart)"
    if unknown:
        what = "what else has changed" if said else "what has changed"
        said.append(f"{what} is not known: {listed(unknown)}")
    of_file = [effect.name for effect, _ in model.machine.effects]
    for effect in () if before is None else before.effects:
        name = effect.name
        if is_named(before, effect) and name not in model.given and name not in alike:
            back = "is the file's again" if name in of_file else "has gone"
            said.append(f"{spoken(name)} {back}")
    return "; ".join(said)
