"""What every page is built of: blocks, templates, and the style of figures."""
