"""Answers to sealed cases that nobody had to compute."""

from __future__ import annotations

from ldt_core.lab.challenge.score.answer import CaseAnswer, Further
from ldt_core.lab.challenge.score.judge import Judged, judge
from ldt_core.lab.challenge.score.key import Truth

NOISE, SAMPLES = 0.1, 1000


def diagnosis(kind, acting=(), parameters=None, where=(), closed=None):
    """Keys of a diagnosis.json, as many as a score reads."""
    return {
        "verdict": {
            "kind": kind,
            "effects": [n for group in acting for n in group],
            "acting": [list(group) for group in acting],
        },
        "gap": {"noise_std": NOISE, "closed_fraction": closed},
        "where": list(where),
        "candidates": [{"effect": e, "parameters": p} for e, p in (parameters or {}).items()],
    }


def further(same, another, gap=1.0):
    """Four and three experiments on which so much of the gap [rad/s] was closed."""
    floor = NOISE**2
    return tuple(
        Further(n, SAMPLES, SAMPLES * (gap**2 + floor), SAMPLES * ((1 - c) * gap**2 + floor))
        for n, c in enumerate([same] * 4 + [another] * 3, start=11)
    )


def answer(kind, *acting, who="diagnosis", seconds=5.0, more=(), ranges=None, **found):
    """An answer of a kind, with the groups of names that act."""
    seen = {"physics": "dc_motor", "current": False, "range": ranges or {}}
    return CaseAnswer(who, diagnosis(kind, acting, **found), more, seconds, seen)


def truth(kind, *effects, case="case_0001", snr=5.0, **more):
    """A key's entry."""
    return Truth(case, kind, tuple(effects), noise=NOISE, signal_to_noise=snr, **more)


def judged(about: Truth, given: CaseAnswer) -> Judged:
    """The one against the other."""
    return judge(about, given)
