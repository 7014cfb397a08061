"""The page of a diagnosis (`ldt diagnose`), which `diagnosis_page` builds."""
