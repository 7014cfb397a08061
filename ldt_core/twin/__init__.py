"""The loop: predict, detect, adapt."""
