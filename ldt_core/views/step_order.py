"""The steps of a run in the order in which they are shown, also where its counter began anew."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

from ldt_core.views.step_view import StepView

ANEW = "The experiment counter restarted; the numbers here continue, from {}."


@dataclass
class _Pass:
    """Steps of a counter that counts up, by their numbers; it is shown as so much more."""

    shift: int
    steps: dict[int, StepView] = field(default_factory=dict)
    starts: dict[int, float] = field(default_factory=dict)  # [s since the epoch]


class StepOrder:
    """Steps by their numbers. A counter that began anew counts on behind all that came before.

    It began anew where a number comes again at another start. What comes again at the same start
    stands in place of what came first.
    """

    def __init__(self) -> None:
        self._passes = [_Pass(0)]

    @property
    def turn(self) -> int:
        """How often the counter has begun anew."""
        return len(self._passes) - 1

    @property
    def notes(self) -> list[str]:
        """What a person should know of the numbers."""
        firsts = [str(p.shift + min(p.steps)) for p in self._passes[1:]]
        return [ANEW.format(" and ".join(firsts))] if firsts else []

    def put(self, step: StepView) -> None:
        """Take in a step that is whole, which still has its experiment."""
        assert step.experiment is not None
        number, start = step.number, step.experiment.start
        for one in reversed(self._passes):
            if one.starts.get(number) == start:
                one.steps[number] = step
                return
        now = self._passes[-1]
        if number in now.steps:
            now = _Pass(now.shift + max(now.steps))
            self._passes.append(now)
        now.steps[number], now.starts[number] = step, start

    def shown(self, number: int, turn: int) -> int:
        """As what a number is shown that was said when the counter had begun anew so often."""
        upto = self._passes[: turn + 1]
        known = (one.shift for one in reversed(upto) if number in one.steps)
        return number + next(known, upto[-1].shift)

    def steps(self) -> list[StepView]:
        """All of them, with the numbers under which they are shown; to be asked once."""
        for one in self._passes[1:]:
            for step in one.steps.values():
                step.number += one.shift
                if step.signal is not None:
                    step.signal = replace(step.signal, experiment=step.number)
        return [one.steps[n] for one in self._passes for n in sorted(one.steps)]
