"""The paper's claims and our aims, each examined on the runs of a study."""

from __future__ import annotations

from ldt_core.lab.study.claims.aims import AIMS
from ldt_core.lab.study.claims.claim import Claim, ClaimVerdict, Statement, percent
from ldt_core.lab.study.claims.detector_claims import DETECTOR_CLAIMS
from ldt_core.lab.study.claims.model_claims import MODEL_CLAIMS
from ldt_core.lab.study.claims.threshold_claims import THRESHOLD_CLAIMS
from ldt_core.lab.study.study import Evidence

__all__ = ["Claim", "ClaimVerdict", "aims", "claims", "percent"]

CLAIMS = (*MODEL_CLAIMS, *DETECTOR_CLAIMS, *THRESHOLD_CLAIMS)


def claims(evidence: Evidence) -> list[Claim]:
    """Every claim of the paper with its verdict, in the order of the paper.

    A claim for which the study has no runs is "not examined".
    """
    return [claim.examined(evidence) for claim in CLAIMS]


def aims(evidence: Evidence) -> list[Claim]:
    """Every aim beyond the paper with its verdict, for one learner of the group "better"."""
    return [a.examined(evidence) if isinstance(a, Statement) else a(evidence) for a in AIMS]
