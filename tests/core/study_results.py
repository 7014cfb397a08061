"""Results made by hand, for tests of what a study concludes."""

from __future__ import annotations

from ldt_core.lab.study.study_case import RunResult, StudyCase


def made_up(
    truth,
    positives=(),
    *,
    model="hybrid",
    detector="threshold",
    seed=0,
    max_error=1.0,
    original=2.0,
    region=1.0,
    region_original=2.0,
    adapted=None,
    alarms=None,
    **settings,
):
    """A run in which each positive led to a new model, unless `adapted` says which ones did.

    Rows are given as one value for all experiments or as one each.
    """
    count = len(truth)
    adapted = positives if adapted is None else adapted
    numbers = list(range(1, count + 1))

    def row(value):
        return list(value) if isinstance(value, list | tuple) else [value] * count

    def action(n):
        return "adapted" if n in adapted else "refused" if n in positives else "kept"

    return RunResult(
        case=StudyCase(model, detector, seed, count, settings=settings, alarms=alarms),
        number=numbers,
        truth=list(truth),
        max_error=row(max_error),
        original=row(original),
        level=[1 if n in positives else -1 for n in numbers],
        action=[action(n) for n in numbers],
        region_rmse=row(region),
        region_rmse_original=row(region_original),
        kept={},
        seconds=0.0,
    )
