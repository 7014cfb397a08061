"""Going on where a run ended."""
