"""Claims about the quick fits of a search: a race leaves the right set, and known numbers stay."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from recorded_machines import MOTOR, candidates, record

from ldt_core.diagnosis.effect_fit import fit
from ldt_core.diagnosis.effect_set_search import EffectSetSearch
from ldt_core.diagnosis.free_run_residuals import FreeRunResiduals
from ldt_core.diagnosis.library import library
from ldt_core.diagnosis.nominal_prior import nominal_prior
from ldt_core.diagnosis.quick_fits import prior_weight
from ldt_core.diagnosis.thresholds import THRESHOLDS

PAIR = (
    "asymmetric_friction:torque_forward=0.05,torque_backward=0.1",
    "armature_resistance:factor=1.4",
)


def search(names, *effects, **known):
    """A search, its machine file's numbers uncertain by `known`."""
    experiments = record(MOTOR, *effects, noise=0.01)
    machine = replace(MOTOR, deviations=known)
    residuals = FreeRunResiduals(machine, experiments, workers=1, tolerance=THRESHOLDS.law_error)
    return EffectSetSearch(
        residuals, candidates(machine, names), prior=nominal_prior(machine) if known else None
    )


def test_a_race_leaves_the_other_effect_of_a_pair():
    """Both names of a resistance are among the five sets."""
    names = [e.name for e in library(MOTOR)]
    found = search(names, *PAIR)
    found._alone()
    base = found.found.scouted[frozenset(["asymmetric_friction"])]
    left = found.quick.race(found.additions(base))
    beside = {name for tried in left for name in tried.names} - {"asymmetric_friction"}
    assert len(left) == 5
    assert beside >= {"source_resistance", "armature_resistance"}


@pytest.mark.parametrize("excess", [0.0, -5.0])
def test_without_a_gap_a_known_number_counts_as_it_is_known(excess):
    """No law can be off."""
    assert prior_weight(excess) == 1.0


def test_a_known_number_does_not_move_to_mend_a_law():
    """An inertia known to 2 % stays near it beside a friction that is not the machine's."""
    found = search(["coulomb_friction"], "quadratic_drag:c=0.0003", J=0.02 * MOTOR.parameters["J"])
    (friction,) = found.candidates
    members, z = [friction, *found.own], [np.array([1.0]), *(np.zeros(len(c)) for c in found.own)]
    light, heavy = (fit(found.residuals, members, z, own=1, weight=w) for w in (1.0, found.weight))
    assert found.weight > 1.0
    assert abs(heavy.z[-1][0]) < 0.5 * abs(light.z[-1][0])
