"""Gaussian-process regression for functions that are seen only through a dynamic system.

The order of work: `observer` turns experiments into whitened linear observations of the unknown
function, `hyperparameters` finds the kernel on a bounded set of cells, `sparse` conditions on all
the data, `speed_run` makes mean and deviation fast enough for a roll-out. None of it knows of a
model of the twin; all of it is used by `ldt_core.models.hybrid`.
"""
