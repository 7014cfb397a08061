// What is drawn: the run's figures, and the samples of an experiment.
const RUN = JSON.parse(document.getElementById("data").textContent);
// State of machine and model: what people are told, and in which colour.
const stateOf = (i) => RUN.states[RUN.state[i]] || RUN.states[""];
const brief = (state) => RUN.states[state][0].split(":")[0];
const noiseOf = (i) => (RUN.noise[i] == null ? "" : `error ${+RUN.noise[i].toPrecision(2)} times the noise`);
const said = (i) =>
  [stateOf(i)[0], noiseOf(i), `detector: ${RUN.levels[RUN.level[i]]}`].filter(Boolean).join(", ");
const short = (i) => {
  const judged = RUN.error[i] != null;
  return (
    `experiment ${RUN.number[i]}: ` +
    (judged ? `error ${four(RUN.error[i])} rad/s` : "not judged yet") +
    (RUN.original[i] == null ? "" : `, original model ${four(RUN.original[i])} rad/s`) +
    (judged ? `; ${said(i)}` : "")
  );
};
const adaptorOf = (i) =>
  `Adaptor: ${RUN.actions[RUN.action[i]] || RUN.action[i]}; ${RUN.reason[i]}.`;
function about(model) {
  // what a model is, and what it has learned from
  if (!model) return "";
  const { kind, learned } = model,
    many = learned.length > 12;
  const named = many
    ? `${learned.length} experiments, ${learned[0]} the first`
    : `experiment${learned.length > 1 ? "s" : ""} ${learned.join(", ")}`;
  return ` (${kind}, ${learned.length ? `learned from ${named}` : "untrained"})`;
}
const samplesAt = (x, rows, i) =>
  `${four(x[i])} s: ` +
  Object.values(rows)
    .flat()
    .map(([label, values]) => `${label} ${four(values[i])}`)
    .join(", ");
const PAINTS = { good: "green", found: "sky", bad: "vermilion", vague: "orange", open: "grey" };
const HEIGHTS = {
  error: 260,
  statistic: 200,
  versions: 165,
  speed: 320,
  residual: 170,
  voltage: 140,
};
const PRINTED = 660; // pixels, the width of A4 between its margins
const WHOLE = [1, 2, 5, 10, 20, 50, 100, 200, 500, 1000, 2000, 5000, 10000, 20000, 50000];
const at = (id) => document.getElementById(id);
const color = (name) =>
  getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim();
const four = (v) =>
  v == null || !isFinite(v)
    ? "–"
    : v === 0
      ? "0"
      : Math.abs(v) >= 1e6 || Math.abs(v) < 1e-4
        ? v.toExponential(2)
        : String(+v.toPrecision(4));
const make = (tag, text, more) =>
  Object.assign(document.createElement(tag), { textContent: text || "" }, more);

let chosen = RUN.worst[0],
  printing = false;

// On a linear axis a limit far below the peaks cannot be told from 0.
const known = (row) => row.filter((v) => v != null && v > 0);
const FAR = 8; // peaks over the lowest limit
const logarithmic = {
  error: false,
  statistic:
    Math.max(...known(RUN.statistic.value)) > FAR * Math.min(...known(RUN.statistic.drift)),
};

function decades(u, axis, low, high) {
  // ticks of a logarithmic axis: 1, or 1, 2 and 5, of each decade
  const first = Math.floor(Math.log10(low)),
    last = Math.ceil(Math.log10(high)),
    ticks = [];
  for (let e = first; e <= last; e++)
    for (const m of last - first > 3 ? [1] : [1, 2, 5]) {
      const tick = +`${m}e${e}`;
      if (tick >= low && tick <= high) ticks.push(tick);
    }
  return ticks;
}

// A row: [label, values, {color, dash, width, shape, hidden, step, band}]
const DASHES = { solid: [], dotted: [2, 3], dashed: [9, 4], mixed: [9, 3, 2, 3] };

function courseRows() {
  const s = RUN.statistic;
  const rows = {
    error: [["learning twin", RUN.error, { color: "blue", width: 1 }]],
    statistic: [[s.label.replace(/ \[.*\]$/, ""), s.value, { color: "blue", width: 1 }]],
    versions: [["model version", RUN.version, { color: "blue", width: 2, step: true }]],
  };
  if (RUN.original.some((v) => v != null))
    rows.error.push([
      "original model",
      RUN.original,
      { color: "orange", shape: "dot", dash: "none" },
    ]);
  if (s.warning.some((v) => v != null))
    rows.statistic.push([
      "warns above",
      s.warning,
      { color: "purple", dash: "dashed", width: 1.6 },
    ]);
  if (s.drift.some((v) => v != null))
    rows.statistic.push([
      "alarm above",
      s.drift,
      { color: "vermilion", dash: "mixed", width: 1.8 },
    ]);
  return rows;
}

function samplesOf(index) {
  return unpacked(RUN.samples[index]);
}

function unpacked(packed) {
  if (!packed) return null;
  const bytes = Uint8Array.from(atob(packed.data), (c) => c.charCodeAt(0));
  const codes = new Uint16Array(bytes.buffer),
    count = codes.length / packed.channels.length;
  const rows = {};
  packed.channels.forEach(([name, low, step], i) => {
    rows[name] = Float64Array.from(
      codes.subarray(i * count, (i + 1) * count),
      (c) => low + c * step,
    );
  });
  return rows;
}

function experimentRows(samples) {
  // The measured lies on top of what predicts it: both show where the twin is right.
  const speed = [];
  if (samples.original)
    speed.push(["original model", samples.original, { color: "orange", dash: "dotted", width: 2 }]);
  if (samples.predicted)
    speed.push(["predicted", samples.predicted, { color: "sky", width: 4 }]);
  if (samples.deviation) {
    const edge = (sign) => samples.predicted.map((v, i) => v + sign * 2 * samples.deviation[i]);
    speed.push([
      "95 % band, lower edge",
      edge(-1),
      { color: "blue", width: 0.8, dash: "dashed", band: true },
    ]);
    speed.push(["upper edge", edge(1), { color: "blue", width: 0.8, dash: "dashed" }]);
  }
  speed.push(["measured", samples.measured, { color: "ink", width: 1.1 }]);
  const residual = samples.predicted && samples.measured.map((v, i) => v - samples.predicted[i]);
  return {
    speed,
    residual: residual
      ? [["measured − predicted", residual, { color: "vermilion", width: 1.2 }]]
      : [],
    voltage: [["voltage", samples.voltage, { color: "green", width: 1.5, step: true }]],
  };
}
