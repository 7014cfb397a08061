"""Fitting a physical cause: one effect's parameters by free runs of the whole machine.

`free_run.py` runs machine and effect, `search.py` finds the parameters, `angle.py` weighs whether
the machine always starts at the same angle, `members.py` spreads what is not known for sure over a
few free runs.
"""
