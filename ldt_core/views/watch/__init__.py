"""The twin live in a browser: the state of the page, the server, and a recording played back.

```
source (graph or recording) ── records ──▶ Fleet ── figures ──▶ server ── events ──▶ browsers
```

`watched_machine.WatchedMachine` and `fleet.Fleet` are what a page shows: plain figures and words in
bounded memory, without web and without ROS. `server.serve` sends them; `browser_files.assets` is
what a browser gets, with the plots of `ldt_core.views.report`. The records come from a
`record_source.RecordSource`: its `Playback`, or the running graph by the entry points
of the group `ldt.watch`.

The server is aiohttp with server-sent events: of the three that were tried with the same task it
draws soonest and loads least (README, "Live in the browser"), and its page is ours to escape, to
secure, and to use without a mouse.
"""
