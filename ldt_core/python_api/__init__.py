"""What people use from Python: functions that take and give objects instead of files and options.

Each does what the command of the same name does, with the same numbers.
"""
