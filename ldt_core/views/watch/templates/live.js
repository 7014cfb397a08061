// The stream from the server, and which machine is shown.
const AGAIN = 2000; // ms until a refused stream is tried again
let stream = null,
  shown = null; // key of the machine, "" for the overview

function listen() {
  if (stream) stream.close();
  const query = shown ? `?machine=${encodeURIComponent(shown)}` : "";
  const own = (stream = new EventSource(`/events${query}`));
  own.onopen = () => write(at("lost"), "");
  own.onerror = () => {
    write(at("lost"), "Connection lost; trying again.");
    if (own.readyState === EventSource.CLOSED)
      setTimeout(() => {
        if (own === stream) listen();
      }, AGAIN);
  };
  own.addEventListener("fleet", (event) => {
    latest = JSON.parse(event.data);
    heard = performance.now();
    write(at("state"), latest.state);
    showPlayback();
    if (!shown) route();
    at("back").hidden = latest.machines.length < 2 && location.hash === "";
    if (!shown) showOverview();
  });
  own.addEventListener("machine", (event) => {
    if (own !== stream) return;
    heard = performance.now();
    learnedOf(JSON.parse(event.data));
  });
  own.addEventListener("missing", () =>
    write(at("sentence"), "There is no such machine, or nothing has come of it yet."),
  );
}

function route() {
  const found = /^#machine=(.+)$/.exec(location.hash);
  let key = "";
  if (found) {
    try {
      key = decodeURIComponent(found[1]);
    } catch {
      key = found[1];
    }
  } else if (latest.machines.length === 1) key = latest.machines[0].key;
  show(key);
}

function show(key) {
  if (key === shown) return;
  shown = key;
  seen = null;
  at("overview").hidden = Boolean(key);
  at("one").hidden = !key;
  forget();
  if (key) {
    write(at("one-title"), key);
    lamp.set(null);
    at("columns").hidden = true;
    at("status").className = "answer open";
    ["word", "aside", "sentence", "trouble"].forEach((id) => write(at(id), ""));
    write(at("diagnosis"), "None yet.");
  } else {
    document.title = "LDT live";
    showOverview();
  }
  listen();
  scrollTo(0, 0);
}

addEventListener("hashchange", () => {
  shown = null;
  route();
});
at("cards").addEventListener("pointerleave", () => showOverview());
setInterval(() => {
  if (shown && seen && seen.card) showStatus();
  else if (shown === "") showOverview();
}, 1000);

const FRAME = 100; // ms between two pictures of an experiment that goes on
setInterval(() => {
  const step = seen && seen.steps.get(number);
  if (playing && !playing.paused && playing.rate != null && step && step.error == null) redraw();
}, FRAME);

function drawAnew() {
  if (!seen || at("one").hidden) return;
  if (RUN.number.length) course.draw(RUN.number, courseRows());
  const held = samples.get(number);
  if (held) experiment.draw(held.rows.time, experimentRows(held.rows));
}
let resizing = 0,
  width = innerWidth; // a phone's bars come and go, which changes the height alone
addEventListener("resize", () => {
  clearTimeout(resizing);
  resizing = setTimeout(() => {
    if (innerWidth !== width) {
      width = innerWidth;
      drawAnew();
    }
  }, 120);
});
matchMedia("(prefers-color-scheme: dark)").addEventListener("change", drawAnew);
listen();
