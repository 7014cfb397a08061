"""The fit of one physical effect, by free runs of the whole machine.

- `cause.py` runs machine and effect from a start state that is partly unknown.
- `global_search.py` looks where the parameters may lie, and descends from there.
- `joint_fit.py` is the least squares of several experiments and their start states together.
- `start_angle.py` weighs whether the machine always starts at the same angle.
- `learn_effect.py` puts these together for the diagnosed model, with what remains uncertain.
"""
