"""Linear system identification from experiments: the part that stands alone.

>>> from ldt_core.identification import identify
>>> model = identify(experiments)            # doctest: +SKIP
>>> model.poles, model.dc_gain               # doctest: +SKIP
"""

from ldt_core.identification.estimate import Identified, identify
from ldt_core.identification.state_space import StateSpace

__all__ = ["Identified", "StateSpace", "identify"]
