"""The twin live in a browser: the state of the page, the server, and a recording played back.

```
source (graph or recording) ── records ──▶ Fleet ── figures ──▶ server ── events ──▶ browsers
```

`watched_machine.WatchedMachine` and `fleet.Fleet` are what a page shows, in bounded memory.
`server.serve` sends it; `browser_files.assets` is what a browser gets. The records come from a
`record_source.RecordSource`: its `Playback`, or the running graph by the entry point `ldt.watch`.
"""
