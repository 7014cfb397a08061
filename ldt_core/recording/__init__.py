"""Recordings: rosbag2 folders with MCAP files, read and written without ROS.

Records ↔ messages: `codec`, with `experiment_messages`, `status_messages`,
`model_json`; `messages`.
Reading: `bag` (a machine's records), `storage` (files), one damaged or whole file in
`mcap_reader` by `mcap_records`, `metadata`, `step_search` (one step without reading the rest).
Writing: `writer` (as it happens), `mcap_writer` (one file), `append` (after a crash),
`mcap_completion` (a file's missing index), `repair`, `lock`, `duplicate_filter`.
About recordings: `health`, `node_status`, `run_settings`, `experiment_numbers`, `pace`.
Imports: `importers` of CSV files (`csv_table`, `units`) and foreign recordings (`message_fields`);
speeds of `positions`, experiments by `import_cuts`.
"""
