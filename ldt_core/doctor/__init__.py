"""What is wrong with this machine, or with a recording, and how to mend it.

`check.examine` runs probes side by side, each bounded in time; `computer_checks.probes` are those
of the core, others come by entry point, group `ldt.check`; `recording_checks.findings` judges a
recording.
"""
