"""Checks for detectors, effects and physics of users."""
