"""Recordings in the formats of other tools: tables, Rerun, and MCAP with sample messages.

Each format is its file: `sample_table` (CSV, Parquet), `rerun_file`, `sample_messages` (what stock
ROS tools draw curves of, also for `ldt serve`), `mcap_with_samples`, and `foxglove_relay`.
"""
