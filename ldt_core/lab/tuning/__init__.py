"""Which detector, and with which threshold: chosen from a recording for a stated budget."""
