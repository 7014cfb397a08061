"""Every effect of the library is recovered by its own fit, from the start that its search finds."""

from __future__ import annotations

import numpy as np
import pytest
from recorded_machines import NOISE, ROTOR, candidates, record

from ldt_core.diagnosis.attribution import amounts
from ldt_core.diagnosis.effect_fit import fit
from ldt_core.diagnosis.free_run_residuals import FreeRunResiduals
from ldt_core.diagnosis.responses import best_alone, simulate_all
from ldt_core.effects import EFFECTS, get_effect

WIDER = 3.0  # times its interval that a parameter may be off
NOISE_ALONE = (0.85, 1.15)  # a sample's power, of 1000 samples
FASTER = (6.0, 16.0)  # V: through the resonance of the foundation
UNBALANCED = ROTOR.with_parameters(e=0.006)  # what shows a foundation's changes
COASTING = np.repeat([12.0, 0.0, 8.0, 0.0, 15.0], 100)  # V: commands of 0 between others
#: Where steps of both signs are not what shows the effect.
SUITED = {
    "unbalance": (ROTOR, FASTER),
    "foundation_stiffness": (UNBALANCED, FASTER),
    "foundation_damping": (UNBALANCED, FASTER),
    "cogging_torque": (ROTOR, (2.0, 6.0)),
}


@pytest.fixture(scope="module")
def fitted():
    """Name of an effect to its candidate, residuals and best fit."""
    known = {}

    def of(name):
        if name not in known:
            machine, volts = SUITED.get(name, (ROTOR, (-16.0, 16.0)))
            levels = [COASTING, -COASTING] if name == "open_circuit" else None
            measured = record(machine, name, count=2, volts=volts, levels=levels)
            residuals = FreeRunResiduals(machine, measured, (NOISE, 1.0))
            members = candidates(machine, [name], 16.0)
            responses = simulate_all(residuals, members)
            fits = [fit(residuals, members, [z]) for z in best_alone(responses, 0)]
            known[name] = residuals, min(fits, key=lambda f: f.loss)
        return known[name]

    return of


@pytest.mark.slow
@pytest.mark.parametrize("name", EFFECTS.names())
def test_an_effect_of_typical_size_is_recovered(fitted, name):
    """What the amounts call determined is within three of its intervals of the truth."""
    _, found = fitted(name)
    truth = get_effect(name).check(get_effect(name).typical)
    known = amounts(found, 0.0, 0.0)[name]
    determined = {n: a for n, a in known.items() if a.ci95 is not None}
    assert determined
    for parameter, a in determined.items():
        half = (a.ci95[1] - a.ci95[0]) / 2
        assert abs(a.value - truth[parameter]) <= WIDER * half, parameter
        assert a.ci95[0] <= a.value <= a.ci95[1]


@pytest.mark.parametrize("name", EFFECTS.names())
def test_the_right_law_leaves_the_noise_alone(fitted, name):
    """Per sample, and far less than the gap was."""
    residuals, found = fitted(name)
    base = residuals.of()
    low, high = NOISE_ALONE
    assert low < found.loss / residuals.size < high
    assert float(base @ base) > 2 * found.loss
