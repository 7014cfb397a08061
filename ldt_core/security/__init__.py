"""Keystores for DDS-Security, in the layout of SROS 2: who may publish and hear what."""
