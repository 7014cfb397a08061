"""Gaussian-process regression for functions that are seen only through a dynamic system.

The order of work: `observer` turns experiments into whitened linear observations of the unknown
function, `sparse` finds the kernel on a bounded set of cells and conditions on all the data,
`speed_run` makes mean and deviation fast enough for a roll-out, `learn` puts these together.
"""
