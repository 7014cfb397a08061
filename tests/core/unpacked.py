"""Packed samples as the page's script reads them."""

from __future__ import annotations

import base64

import numpy as np

from ldt_core.base.experiment import Samples
from ldt_core.views.packed_samples import PackedSamples


def unpack(packed: PackedSamples) -> dict[str, Samples]:
    """Rows by name."""
    codes = np.frombuffer(base64.b64decode(packed.data), "<u2").reshape(len(packed.channels), -1)
    return {c.name: c.low + row * c.step for c, row in zip(packed.channels, codes, strict=True)}
