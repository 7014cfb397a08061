"""Many runs of the loop on streams whose truth is known: the paper's study, and beyond it."""

#: The parts of a study, each of which can be had alone, and what a run is there for; one run may
#: serve several of them.
GROUPS = {
    "paper": "the paper's table: linear and hybrid under each of its detectors, to the letter",
    "variants": "the same with choices that the paper does not print, or does not make",
    "sweep": "the paper's figure of thresholds: each model and detector over a range of them",
    "baseline": "alarms by the calendar and at random, as many as a run of paper or better had",
    "better": "the learners and detectors that go beyond the paper, on the same streams",
    "control": "many streams on which nothing drifts: how often an alarm is false",
    "kinds": "drifts of other kinds than the paper's staircase, and an unknown start angle",
    "robustness": "the default and the paper's two on streams of every kind (hours; only if named)",
    "trials": "what might explain that the paper's hybrid leaves less than ours (only if named)",
    "alarms": "the default detector's false alarms and delays, and the theory (only if named)",
}
#: Groups that are run only where they are named: beyond the paper, and the first takes hours.
NAMED_ONLY = ("robustness", "trials", "alarms")
