"""Sealed cases: machines whose gap is known to a key alone, to try a diagnosis on.

The machines here are simulated by equations and an integrator of their own, and by laws that the
library of effects does not have: LuGre's bristles for its smoothed sign, an eddy brake that
saturates for its viscous friction, and so on. No candidate of a diagnosis is thus exactly right, as
on a real machine. Nothing in the maker imports the twin's physics or its effects.
"""
