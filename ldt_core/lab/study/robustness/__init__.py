"""How good the twin is on streams of every kind, beside those that know the truth."""
