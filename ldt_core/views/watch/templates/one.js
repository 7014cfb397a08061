// One machine: what the server told of it, and what is drawn of that.
const SAMPLES = 12; // experiments whose samples are kept in the browser
let seen = null, // all that was told of the machine shown
  number = null, // of the experiment chosen
  following = true,
  fetching = false,
  told = "";
const samples = new Map();

const course = Group(
  "course",
  (i) => {
    if (i != null) take(RUN.number[i]);
  },
  (i) => `${short(i)}; ${RUN.statistic.label} ${four(RUN.statistic.value[i])}`,
);
const experiment = Group(
  "experiment",
  () => {},
  (i, rows) => samplesAt(experiment.x, rows, i),
);

function forget() {
  seen = { steps: new Map(), events: [], models: {} };
  samples.clear();
  number = null;
  following = at("follow").checked = true;
  experiment.range = experiment.index = course.range = course.index = null;
  showStream([]);
  at("choice").replaceChildren();
  at("events").replaceChildren();
  courseChanged = true;
  logarithmic.statistic = logarithmic.statistic && axisChosen;
}

function learnedOf(message) {
  // takes in what has changed
  if (!seen || message.whole) forget();
  message.steps.forEach((step) => seen.steps.set(step.number, step));
  const there = new Set(message.numbers);
  [...seen.steps.keys()].forEach((n) => there.has(n) || seen.steps.delete(n));
  Object.assign(seen.models, message.models);
  seen.card = message.card;
  if ("diagnosis" in message) seen.diagnosis = message.diagnosis;
  at("columns").hidden = false;
  columns(message);
  axis();
  follow();
  fetchChosen();
  showEvents(message.events);
  showNodes(message);
  showStatus();
  if (message.stream) showStream(message.stream);
  courseChanged ||= message.steps.length > 0 || message.whole;
  redraw();
}

function columns(message) {
  const steps = message.numbers.map((n) => seen.steps.get(n)).filter(Boolean);
  const column = (name) => steps.map((step) => step[name]);
  Object.assign(RUN, {
    number: column("number"),
    error: column("error"),
    original: column("original"),
    level: column("level"),
    state: column("state"),
    noise: column("noise"),
    version: column("version"),
    action: column("action"),
    reason: column("reason"),
    models: seen.models,
  });
  Object.assign(RUN.statistic, {
    label: message.label || RUN.statistic.label,
    value: column("value"),
    warning: column("warning"),
    drift: column("drift"),
  });
}

// Limits may be far above what is usual; once somebody has chosen an axis, it stays.
let axisChosen = false;
at("course-plots").addEventListener("change", (event) => {
  axisChosen ||= Boolean(event.target.closest(".axis"));
});
function axis() {
  const { value, warning, drift } = RUN.statistic,
    limits = known(drift);
  const far = Math.max(...known(value), ...known(warning), ...limits) > FAR * Math.min(...limits);
  if (axisChosen || !far || logarithmic.statistic) return;
  logarithmic.statistic = true;
  if (course.plots.statistic) course.draw(RUN.number, courseRows());
}

function follow() {
  if (following || number == null) {
    const measured = RUN.number.filter((n) => seen.steps.get(n).drawn);
    number = measured.length ? measured[measured.length - 1] : null;
  }
  chosen = RUN.number.indexOf(number);
}

function take(n) {
  // a person chose an experiment
  number = n;
  following = at("follow").checked = false;
  experiment.range = experiment.index = null;
  follow();
  redraw();
}

let waiting = false,
  courseChanged = true,
  courseChosen = null;
function redraw() {
  if (waiting) return;
  waiting = true;
  requestAnimationFrame(() => {
    waiting = false;
    if (!seen || at("one").hidden) return;
    showExperiment();
    if (!courseChanged && number === courseChosen) return;
    courseChanged = false;
    courseChosen = number;
    showChoice();
    if (RUN.number.length) course.update(RUN.number, courseRows());
  });
}

function fetchChosen() {
  const step = seen.steps.get(number),
    held = samples.get(number);
  if (step && step.drawn && (!held || held.drawn < step.drawn)) load(number);
}

function showExperiment() {
  const held = samples.get(number);
  fetchChosen();
  if (held) {
    const step = seen.steps.get(number);
    const open = playing && playing.rate != null && step && step.error == null;
    experiment.update(held.rows.time, sofar(held.rows.time, experimentRows(held.rows), open));
    document.body.dataset.drawn = `${number}:${held.drawn}`;
    write(
      at("thinned"),
      held.kept < held.of
        ? `${held.kept} of ${held.of} samples are drawn; the extremes are among them.`
        : `All ${held.of} samples are drawn.`,
    );
  }
  write(at("experiment-title"), number == null ? "Experiment" : `Experiment ${number}`);
}

async function load(wanted) {
  if (fetching) return;
  fetching = true;
  const key = shown;
  try {
    const answer = await fetch(`/experiment?machine=${encodeURIComponent(key)}&number=${wanted}`);
    if (answer.ok && key === shown) {
      const { drawn, data, channels, of, kept } = await answer.json();
      samples.delete(wanted);
      samples.set(wanted, { drawn, of, kept, rows: unpacked({ data, channels }) });
      if (samples.size > SAMPLES) samples.delete(samples.keys().next().value);
    } else if (seen) {
      const step = seen.steps.get(wanted);
      if (step) step.drawn = 0; // it has left the server
    }
  } catch {
    // the server is gone; the stream says so, and comes back by itself
    await new Promise((done) => setTimeout(done, 500));
  }
  fetching = false;
  redraw();
}

function showChoice() {
  const choice = at("choice"),
    numbers = [...RUN.number].reverse();
  const text = (n) => {
    const { error, state, action } = seen.steps.get(n);
    const words = error == null ? "not judged yet" : `${four(error)} rad/s, ${brief(state)}`;
    return `${n}: ${words}${action === "adapted" ? ", new model" : ""}`;
  };
  if (document.activeElement !== choice || choice.options.length === 0) {
    const options = choice.options;
    while (options.length > numbers.length) options.remove(options.length - 1);
    numbers.forEach((n, i) => {
      if (!options[i]) choice.append(make("option"));
      if (options[i].value !== String(n)) options[i].value = String(n);
      write(options[i], text(n));
    });
    choice.value = String(number);
  }
  at("older").disabled = chosen <= 0;
  at("newer").disabled = chosen < 0 || chosen === RUN.number.length - 1;
  const lines = [];
  if (chosen >= 0) {
    const s = short(chosen),
      version = RUN.version[chosen],
      model = seen.models[version];
    lines.push(`${s[0].toUpperCase()}${s.slice(1)}.`);
    if (version != null) lines.push(`Predicted by version ${version}${about(model)}.`);
    if (RUN.action[chosen]) lines.push(adaptorOf(chosen));
  } else if (number != null) lines.push(`Experiment ${number} is too long ago to be shown.`);
  at("told").setAttribute("aria-live", following ? "off" : "polite");
  if (told !== lines.join("\n")) {
    told = lines.join("\n");
    at("told").replaceChildren(...lines.map((line) => make("p", line)));
  }
}

function sinceWhen() {
  // the first experiment of those in which the last state has been without a break
  let first = null;
  for (let i = RUN.number.length - 1; i >= 0; i--) {
    if (RUN.error[i] == null) continue;
    if (RUN.state[i] !== seen.card.state) break;
    first = RUN.number[i];
  }
  return first;
}

let spoken = "",
  spokenAt = -Infinity;
function showStatus() {
  const c = seen.card;
  write(at("one-title"), c.title + (c.machine && c.machine !== c.title ? ` (${c.machine})` : ""));
  at("status").className = `answer ${c.tone}`;
  lamp.set(c.tone);
  write(at("word"), c.words);
  const aside = judgedOf(c);
  const since = sinceWhen();
  if (since != null && since !== c.experiment) aside.unshift(`since experiment ${since}`);
  if (c.experiment != null) aside.push(`experiment ${c.experiment}`);
  if (c.age != null) aside.push(ago(age(c)));
  write(at("aside"), aside.join(", "));
  const words = [];
  if (c.error != null) words.push(`Largest error ${four(c.error)} rad/s`);
  if (c.version != null) words.push(`model version ${c.version} stays in use`);
  if (c.action) words.push(RUN.actions[c.action] || c.action);
  write(at("sentence"), words.length ? `${words.join("; ")}.` : "Waiting for an experiment.");
  write(at("trouble"), c.trouble);
  const d = seen.diagnosis;
  write(
    at("diagnosis"),
    d
      ? `${d.sentence} (after experiment ${d.experiment})`
      : "None yet. A graph that was started with --diagnose makes one at an alarm.",
  );
  at("diagnosis").className = d ? "" : "missing";
  document.title = `${c.words}: ${c.title} – LDT live`;
  const now = performance.now();
  if (`${c.title}: ${c.words}` !== spoken && now - spokenAt > 3000) {
    spoken = `${c.title}: ${c.words}`;
    spokenAt = now;
    write(at("announce"), spoken);
  }
}
const lamp = light();
at("light").append(lamp);

const KINDS = { model: "new model", begun: "restarted" };
function showEvents(events) {
  const list = at("events");
  events.forEach(([, moment, n, kind, words]) => {
    const item = make("li"),
      when = [];
    if (n != null) when.push(`experiment ${n}`);
    if (moment != null) when.push(new Date(1000 * moment).toLocaleTimeString());
    item.append(make("span", when.join(", "), { className: "when" }));
    item.append(make("b", KINDS[kind] || kind, { className: kind }), `: ${words}`);
    list.prepend(item);
  });
  while (list.children.length > 200) list.lastElementChild.remove();
  at("uneventful").hidden = list.children.length > 0;
}

function showNodes(message) {
  const list = at("nodes");
  message.nodes.forEach((node, i) => {
    if (!list.children[i]) {
      const item = make("li");
      item.append(
        make("b"),
        ": ",
        make("span"),
        make("span", "", { className: "why" }),
      );
      list.append(item);
    }
    const [name, state, why] = [...list.children[i].children];
    write(name, node.role);
    state.className = node.warns ? "warns" : "";
    const silent = node.silent == null ? "" : `silent for ${node.silent} s; last: `;
    write(state, `${node.warns ? "⚠ " : ""}${silent}${node.message}`);
    write(why, node.rejected ? `rejected ${node.rejected}${node.why && ` (${node.why})`}` : "");
  });
  while (list.children.length > message.nodes.length) list.lastElementChild.remove();
  at("nodeless").hidden = message.nodes.length > 0;
  write(
    at("unreadable"),
    message.unreadable
      ? `${message.unreadable} messages could not be read here; the last: ${message.last_unreadable}`
      : "",
  );
}

at("follow").addEventListener("change", (event) => {
  following = event.target.checked;
  if (following) experiment.index = null;
  follow();
  redraw();
});
at("choice").addEventListener("change", (event) => take(+event.target.value));
at("older").addEventListener("click", () => take(RUN.number[Math.max(0, chosen - 1)]));
at("newer").addEventListener("click", () =>
  take(RUN.number[Math.min(RUN.number.length - 1, chosen + 1)]),
);
