"""Parameters from measured experiments, by least squares in free run.

- `least_squares.py`: bounded nonlinear least squares, for every fit.
- `variable_projection.py`: unknown start states, taken out of a least squares.
- `noise.py`: white noise of a signal, correlation time of a residual.
- `linear/`: identification of a linear state-space model.
- `effect/`: the fit of one physical effect, for the diagnosed model.
"""
