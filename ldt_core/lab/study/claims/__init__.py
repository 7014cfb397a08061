"""The paper's claims and our aims, each examined on the runs of a study."""

from __future__ import annotations

from ldt_core.lab.study.claims import detectors, models, thresholds
from ldt_core.lab.study.claims.aims import AIMS, DETECTOR, MODEL
from ldt_core.lab.study.claims.claim import Claim, Verdict
from ldt_core.lab.study.claims.evidence import Evidence
from ldt_core.lab.study.study import Study

__all__ = ["Claim", "Evidence", "Verdict", "aims", "claims"]


def claims(study: Study) -> list[Claim]:
    """Every claim of the paper with its verdict, in the order of the paper.

    A claim for which the study has no runs is "not examined".
    """
    evidence = Evidence(study)
    every = (*models.CLAIMS, *detectors.CLAIMS, *thresholds.CLAIMS)
    return [examine(evidence) for examine in every]


def aims(study: Study, model: str = MODEL, detector: str = DETECTOR) -> list[Claim]:
    """Every aim beyond the paper with its verdict, for one learner of the group "better"."""
    evidence = Evidence(study)
    return [examine(evidence, model, detector) for examine in AIMS]
