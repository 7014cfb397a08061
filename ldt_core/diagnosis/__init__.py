"""Why a machine departs from its file: which effects explain the gap, and how sure that is.

`diagnose.diagnose` runs it from end to end. `effect_set_search` fits sets of effects to the
`free_run_residuals`; `verdict` decides between none, effect, ambiguous and unknown by the limits in
`thresholds`; `holdout` measures how far that closes the gap; `gap_location` says where it lies.
What comes out is a `diagnosis.Diagnosis`, which `diagnosis.read_effects` reads back.
"""
