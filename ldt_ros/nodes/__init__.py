"""The nodes: convert, call the core, publish."""
