"""What the twin advises the people at the machine: never a command, and nobody has to follow.

bands.py     voltages at which the rotor may be captured by its foundation (Sommerfeld effect)
margins.py   what is left to the machine's limits
reach.py     how to come to a speed past such a band
teach.py     the experiment that would teach most
belief.py    the machine as a model or a diagnosis has it, which all of it goes by
figure.py    the steady states with their folds, and such a way beside a heedless one
live.py      the advice of a running machine, at most one in so many experiments
"""
