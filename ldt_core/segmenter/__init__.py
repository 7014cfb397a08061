"""A machine that streams samples, cut into experiments while it runs."""

from ldt_core.segmenter.cut_rules import RULES, Rule, build_rule
from ldt_core.segmenter.segmenter import CHANNELS, Segmenter

__all__ = ["CHANNELS", "RULES", "Rule", "Segmenter", "build_rule"]
