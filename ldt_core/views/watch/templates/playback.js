// A recording that is played: pause, seek, and samples that come as time goes on.
let playing = null, // what the server told of it
  heldSince = 0, // when, and how far the present experiment was then [s]
  heldAt = 0,
  seeking = false;

function showPlayback() {
  const now = latest.playback;
  at("playback").hidden = !now;
  if (!now) return;
  const other = !playing || playing.position !== now.position || playing.paused !== now.paused;
  // What came a moment ago is late by as much: our own time goes on unless it is far off.
  if (other || now.paused || Math.abs(now.elapsed - elapsed()) > 1.5 * now.rate) {
    heldAt = now.elapsed || 0;
    heldSince = performance.now();
  }
  playing = now;
  const alone = now.ended && now.position < 2; // there is nothing to go back to
  write(at("pause"), alone ? "All played: one experiment" : now.ended ? "Play again" : now.paused ? "Play" : "Pause");
  at("pause").disabled = alone;
  const seek = at("seek");
  seek.parentElement.hidden = !now.total;
  if (now.total) {
    seek.max = String(now.total);
    if (!seeking) seek.value = String(now.position);
    write(at("position"), `${seeking ? seek.value : now.position} of ${now.total}`);
  }
}

function elapsed() {
  // recorded time since the present experiment began [s]
  if (!playing || playing.rate == null) return Infinity;
  return playing.paused ? heldAt : heldAt + ((performance.now() - heldSince) / 1000) * playing.rate;
}

async function control(query) {
  try {
    await fetch(`/playback?${query}`, { method: "POST" });
  } catch {
    // the server is gone; the stream says so
  }
}

function sofar(time, rowsByPlot, open) {
  // of an experiment that goes on: its samples up to now
  const limit = elapsed();
  if (!open || limit >= time[time.length - 1] - time[0]) return rowsByPlot;
  const cut = (values) => Array.from(values, (v, i) => (time[i] - time[0] <= limit ? v : null));
  return Object.fromEntries(
    Object.entries(rowsByPlot).map(([name, rows]) => [
      name,
      rows.map(([label, values, look]) => [label, cut(values), look]),
    ]),
  );
}

at("pause").addEventListener("click", () => {
  if (playing && playing.ended) control("to=1");
  else control(`pause=${playing && playing.paused ? 0 : 1}`);
});
at("seek").addEventListener("input", () => {
  seeking = true;
  showPlayback();
});
at("seek").addEventListener("change", () => {
  seeking = false;
  following = at("follow").checked = true;
  control(`to=${at("seek").value}`);
});
