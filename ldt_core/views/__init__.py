"""What people look at: pages, the live page, figures.

`report` is the page of `ldt report`, `diagnosis_page` that of `ldt diagnose`, `watch` that of
`ldt watch`, `figures` the pictures of other commands. All are built of `page` (blocks, templates,
the style of figures), and show a step of the loop by `step_view`.
"""
