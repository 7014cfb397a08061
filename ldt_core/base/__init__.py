"""What everything else stands on: records, errors, settings, names."""
