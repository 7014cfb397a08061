"""The score of a challenge: every sealed case diagnosed first, the key opened only then.

Unlike the maker this may know everything of the twin: it calls its diagnosis.
"""
