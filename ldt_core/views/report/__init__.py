"""The page of a run (`ldt report`), which `report_page` builds."""
