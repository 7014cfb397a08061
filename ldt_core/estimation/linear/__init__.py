"""Linear system identification from experiments: the part that stands alone.

>>> from ldt_core.estimation.linear import identify
>>> model = identify(experiments)            # doctest: +SKIP
>>> model.poles, model.dc_gain               # doctest: +SKIP
"""

from ldt_core.estimation.linear.identification import Identified, identify
from ldt_core.estimation.linear.state_space import StateSpace

__all__ = ["Identified", "StateSpace", "identify"]
