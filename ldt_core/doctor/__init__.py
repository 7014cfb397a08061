"""What is wrong with this machine, or with a recording, and how to mend it.

`check.run_probes` runs probes side by side, each bounded in time; `computer_checks.probes` are the
core's, others come by entry point, group `ldt.check`; `recording_checks.findings` judges a
recording.
"""
