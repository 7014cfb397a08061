"""What is wrong with this machine, or with a recording, and how to mend it.

`check.examine` runs probes side by side, each bounded in time; `machine.PROBES` are those of the
core, others come by entry point, group `ldt.check`; `recording.findings` judges a recording.
"""
