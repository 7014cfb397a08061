"""Parameters from measured experiments, by least squares in free run."""
