"""One number of the machine file that is another one, and those that explain it as well."""

from __future__ import annotations

from types import SimpleNamespace

import ldt_core as ldt
from ldt_core.base.pausable import finished
from ldt_core.models.grey_box import GreyBoxModel
from ldt_core.twin import candidates


class Tied(GreyBoxModel):
    """Each number explains what happened exactly as well."""

    def search_on(self, experiments):
        def beside(present, effect):
            yield 1
            said = {"names": (effect.name,), "explains": True, "fit": SimpleNamespace(q="near")}
            return SimpleNamespace(**said, box=self.box, score_beside=lambda given, price: 1.0)

        return SimpleNamespace(beside=beside)

    def adopt(self, found, experiments, alike=()):
        return found.names[-1], *alike


def test_of_numbers_that_explain_exactly_as_well_none_is_forgotten(monkeypatch):
    """The last of them was, and the others were not said to be like it."""
    monkeypatch.setattr(candidates, "far", lambda box, q: {"J", "R"} if q == "far" else set())
    one = ldt.simulate("rotor", experiments=1)
    told = candidates.Candidates({}).moved(
        Tied(ldt.Machine("rotor")), SimpleNamespace(q="far"), one
    )
    assert set(finished(told)) == {"armature_resistance", "inertia", "source_resistance"}
