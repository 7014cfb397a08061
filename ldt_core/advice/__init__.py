"""What the twin advises the people at the machine: never a command, and nobody has to follow.

bands.py              voltages at which the rotor may be captured by its foundation (Sommerfeld)
run_up.py             how to come to a speed past such a band
experiment_design.py  the experiment that would add most information (D-optimal design)
machine_estimate.py   the machine as a model or a diagnosis knows it, which all of it goes by
advise.py             all of it together, in sentences
"""
