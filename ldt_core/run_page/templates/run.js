"use strict";
// The plots of a run's page. Reads the element `data` (ldt_core/run_page/data.py), draws by uPlot.
// Text goes into the page as text, never as markup.
(() => {
const RUN = JSON.parse(document.getElementById("data").textContent);
const WORDS = { "-1": "negative", 0: "warning", 1: "positive" };
const HEIGHTS = { error: 260, statistic: 200, versions: 165, speed: 320, residual: 170, voltage: 140 };
const PRINTED = 660; // pixels, the width of A4 between its margins
const WHOLE = [1, 2, 5, 10, 20, 50, 100, 200, 500, 1000, 2000, 5000, 10000, 20000, 50000];
const at = (id) => document.getElementById(id);
const color = (name) => getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim();
const four = (v) => v == null || !isFinite(v) ? "–" : v === 0 ? "0"
  : Math.abs(v) >= 1e6 || Math.abs(v) < 1e-4 ? v.toExponential(2) : String(+v.toPrecision(4));
const make = (tag, text, more) => Object.assign(document.createElement(tag), { textContent: text || "" }, more);

let chosen = RUN.worst[0], printing = false;

// On a linear axis a limit far below the peaks cannot be told from 0.
const known = (row) => row.filter((v) => v != null && v > 0);
const FAR = 8; // peaks over the lowest limit
const logarithmic = { error: false, statistic: Math.max(...known(RUN.statistic.value)) > FAR * Math.min(...known(RUN.statistic.drift)) };

function decades(u, axis, low, high) { // ticks of a logarithmic axis: 1, or 1, 2 and 5, of each decade
  const first = Math.floor(Math.log10(low)), last = Math.ceil(Math.log10(high)), ticks = [];
  for (let e = first; e <= last; e++) for (const m of last - first > 3 ? [1] : [1, 2, 5]) {
    const tick = +`${m}e${e}`;
    if (tick >= low && tick <= high) ticks.push(tick);
  }
  return ticks;
}

// ---- what is drawn -----------------------------------------------------------------------------
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
    rows.error.push(["original model", RUN.original, { color: "orange", shape: "dot", dash: "none" }]);
  if (s.warning.some((v) => v != null))
    rows.statistic.push(["warns above", s.warning, { color: "purple", dash: "dashed", width: 1.6 }]);
  if (s.drift.some((v) => v != null))
    rows.statistic.push(["positive above", s.drift, { color: "vermilion", dash: "mixed", width: 1.8 }]);
  return rows;
}

function samplesOf(index) {
  const packed = RUN.samples[index];
  if (!packed) return null;
  const bytes = Uint8Array.from(atob(packed.data), (c) => c.charCodeAt(0));
  const codes = new Uint16Array(bytes.buffer), count = codes.length / packed.channels.length;
  const rows = {};
  packed.channels.forEach(([name, low, step], i) => {
    rows[name] = Float64Array.from(codes.subarray(i * count, (i + 1) * count), (c) => low + c * step);
  });
  return rows;
}

function experimentRows(samples) {
  const speed = [["measured", samples.measured, { color: "ink", width: 1.1 }]];
  if (samples.original)
    speed.push(["original model", samples.original, { color: "orange", dash: "dotted", width: 2 }]);
  speed.push(["predicted", samples.predicted, { color: "blue", width: 2 }]);
  if (samples.deviation) {
    const edge = (sign) => samples.predicted.map((v, i) => v + sign * 2 * samples.deviation[i]);
    speed.push(["band from −2 σ", edge(-1), { color: "sky", width: 0.8, dash: "dashed", band: true }]);
    speed.push(["to +2 σ", edge(1), { color: "sky", width: 0.8, dash: "dashed" }]);
  }
  const residual = samples.measured.map((v, i) => v - samples.predicted[i]);
  return {
    speed,
    residual: [["measured − predicted", residual, { color: "vermilion", width: 1.2 }]],
    voltage: [["voltage", samples.voltage, { color: "green", width: 1.5, step: true }]],
  };
}

// ---- marks beside the curves -------------------------------------------------------------------
function shape(ctx, kind, x, y, r) {
  ctx.beginPath();
  if (kind === "square") ctx.rect(x - r, y - r, 2 * r, 2 * r);
  else if (kind === "triangle") { ctx.moveTo(x, y - r * 1.2); ctx.lineTo(x + r * 1.1, y + r); ctx.lineTo(x - r * 1.1, y + r); ctx.closePath(); }
  else ctx.arc(x, y, r, 0, 2 * Math.PI);
}

function visible(u, i) {
  const { min, max } = u.scales.x, x = u.data[0][i];
  return x >= min && x <= max;
}

function verticals(u) { // behind the curves: new models, and the experiment chosen
  const { ctx, bbox } = u, ratio = uPlot.pxRatio;
  ctx.save();
  RUN.number.forEach((number, i) => {
    if (!visible(u, i)) return;
    const x = Math.round(u.valToPos(number, "x", true));
    if (i === chosen) {
      ctx.globalAlpha = 0.22; ctx.fillStyle = color("sky");
      ctx.fillRect(x - 5 * ratio, bbox.top, 10 * ratio, bbox.height);
      ctx.globalAlpha = 1;
    }
    if (RUN.action[i] !== "adapted") return;
    ctx.strokeStyle = color("green"); ctx.lineWidth = 1.2 * ratio;
    ctx.setLineDash([4 * ratio, 4 * ratio]);
    ctx.beginPath(); ctx.moveTo(x, bbox.top); ctx.lineTo(x, bbox.top + bbox.height); ctx.stroke();
  });
  ctx.restore();
}

function levels(u) { // in front: a shape for each signal that is not negative
  const { ctx } = u, ratio = uPlot.pxRatio;
  ctx.save();
  RUN.level.forEach((level, i) => {
    const value = u.data[1][i];
    if (level < 0 || value == null || !visible(u, i) || (u.scales.y.distr === 3 && value <= 0)) return;
    const x = u.valToPos(u.data[0][i], "x", true), y = u.valToPos(value, "y", true);
    shape(ctx, level > 0 ? "square" : "triangle", x, y, (level > 0 ? 3.6 : 4.6) * ratio);
    ctx.fillStyle = color(level > 0 ? "vermilion" : "paper"); ctx.fill();
    ctx.lineWidth = 1.6 * ratio; ctx.strokeStyle = color(level > 0 ? "vermilion" : "ink"); ctx.stroke();
  });
  ctx.restore();
}

function learned(u) { // a dot where a version learned from an experiment
  const { ctx } = u, ratio = uPlot.pxRatio, { min, max } = u.scales.x;
  ctx.save();
  ctx.fillStyle = color("paper"); ctx.strokeStyle = color("green"); ctx.lineWidth = 1.8 * ratio;
  Object.keys(RUN.models).forEach((version) => RUN.models[version].learned.forEach((number) => {
    if (number < min || number > max) return;
    shape(ctx, "dot", u.valToPos(number, "x", true), u.valToPos(+version, "y", true), 3.4 * ratio);
    ctx.fill(); ctx.stroke();
  }));
  ctx.restore();
}

const MARKS = {
  error: [["square", "vermilion", "positive"], ["triangle", "ink", "warning"], ["line", "green", "new model"]],
  statistic: [],
  versions: [["ring", "green", "learned from"]],
};

// ---- one plot ----------------------------------------------------------------------------------
function plot(group, name, x, rows) {
  const place = document.querySelector(`[data-plot="${name}"]`), course = group.name === "course";
  const log = Boolean(logarithmic[name]);
  const series = [{}], bands = [];
  rows.forEach(([label, , look], i) => {
    const dotted = look.shape === "dot";
    series.push({
      label, stroke: color(look.color), width: dotted ? 0 : look.width, spanGaps: false, show: !group.hidden.has(name + label),
      dash: look.dash && look.dash !== "none" ? DASHES[look.dash] : [],
      paths: dotted ? () => null : look.step ? uPlot.paths.stepped({ align: 1 }) : undefined,
      points: { show: dotted || (course && i === 0 && name !== "versions"), size: dotted ? 5 : 4, width: 1,
                stroke: color(look.color), fill: color(dotted ? "paper" : look.color) },
    });
    if (look.band) bands.push({ series: [i + 2, i + 1], fill: color("sky") + "38" });
  });
  const ticks = { stroke: color("ink"), grid: { stroke: color("faint"), width: 1 }, ticks: { stroke: color("faint"), width: 1 },
                  font: "12px system-ui, sans-serif" };
  const values = (u, splits) => splits.map((v) => v == null ? "" : four(v));
  const u = new uPlot({
    width: printing ? PRINTED : place.clientWidth,
    height: HEIGHTS[name] * (place.clientWidth < 500 ? 0.85 : 1),
    series, bands, legend: { show: false },
    padding: [10, 12, 0, 0],
    cursor: { y: false, sync: { key: group.name, setSeries: false }, drag: { x: true, y: false },
              points: { size: 9 } },
    scales: { x: { time: false, range: (_, low, high) => low === high ? [low - 1, high + 1] : [low, high] },
              y: log ? { distr: 3, range: (_, low, high) => [Math.max(low, high * 1e-6) / 1.2, high * 1.2] } : name === "error" ? { range: (_, low, high) => [0, high * 1.06 || 1] } : name === "versions" ? { range: (_, low, high) => [Math.min(0, low), Math.max(high, 1) + 0.5] } : {} },
    axes: [
      { ...ticks, values: course ? values : (u, s) => values(u, s).map((v) => v && `${v} s`), incrs: course ? WHOLE : undefined, space: 60, size: 32,
        ...(name === "versions" ? { label: "number of the experiment", labelSize: 18, labelFont: "12px system-ui, sans-serif" } : {}) },
      { ...ticks, values, size: 58, ...(log ? { splits: decades, filter: (u, ticks) => ticks } : {}), incrs: name === "versions" ? WHOLE : undefined, space: name === "versions" || name === "voltage" ? 26 : 34 },
    ],
    hooks: {
      drawAxes: course ? [verticals] : [],
      draw: name === "versions" ? [learned] : course ? [levels] : [],
      setScale: [(self, key) => { if (key === "x") group.zoomed(self); }],
      setCursor: [(self) => group.hovered(self, name, rows)],
    },
  }, [x, ...rows.map((row) => row[1])], place);
  u.over.addEventListener("click", () => { if (!group.dragged) group.clicked(u.cursor.idx); });
  return u;
}

function swatch(kind, name, dash) {
  const svg = document.createElementNS("http://www.w3.org/2000/svg", "svg");
  const put = (tag, more) => {
    const e = document.createElementNS("http://www.w3.org/2000/svg", tag);
    Object.entries(more).forEach(([k, v]) => e.setAttribute(k, v));
    svg.append(e);
  };
  svg.setAttribute("viewBox", "0 0 26 12"); svg.setAttribute("aria-hidden", "true");
  const paint = `var(--${name})`;
  if (kind === "square") put("rect", { x: 9, y: 2, width: 8, height: 8, fill: paint });
  else if (kind === "triangle") put("path", { d: "M13 1l5.4 9.6H7.6z", fill: "var(--paper)", stroke: paint, "stroke-width": 1.6 });
  else if (kind === "ring") put("circle", { cx: 13, cy: 6, r: 4, fill: "var(--paper)", stroke: paint, "stroke-width": 1.8 });
  else put("path", { d: "M0 6h26", stroke: paint, "stroke-width": 2.4, "stroke-dasharray": (kind === "line" ? [4, 4] : DASHES[dash || "solid"]).join(" ") || "none" });
  return svg;
}

// ---- plots that share their x ------------------------------------------------------------------
function Group(name, click, sentence) {
  const group = { name, plots: {}, x: [], hidden: new Set(), busy: false, dragged: false, range: null, clicked: click };

  group.draw = (x, rowsByPlot) => {
    Object.values(group.plots).forEach((u) => u.destroy());
    group.plots = {}; group.x = x; group.rows = rowsByPlot;
    group.busy = true;
    Object.entries(rowsByPlot).forEach(([plotName, rows]) => {
      group.plots[plotName] = plot(group, plotName, x, rows);
      key(plotName, rows);
    });
    queueMicrotask(() => { group.busy = false; if (group.range) group.zoom(...group.range); });
  };

  function key(plotName, rows) {
    const list = document.querySelector(`[data-key="${plotName}"]`);
    list.replaceChildren(...rows.map(([label, , look], i) => {
      const item = make("li"), words = make("label"), box = make("input", "", { type: "checkbox" });
      box.checked = !group.hidden.has(plotName + label);
      box.addEventListener("change", () => {
        group.hidden[box.checked ? "delete" : "add"](plotName + label);
        group.plots[plotName].setSeries(i + 1, { show: box.checked });
      });
      words.append(box, swatch(look.shape === "dot" ? "ring" : "curve", look.color, look.dash), make("span", label), make("output", ""));
      item.append(words);
      return item;
    }), ...(MARKS[plotName] || []).map(([kind, paint, label]) => {
      const item = make("li"), words = make("span", "", { className: "plain" });
      words.append(swatch(kind, paint), make("span", label));
      item.append(words);
      return item;
    }), ...(plotName in logarithmic ? [axisSwitch(plotName)] : []));
  }

  function axisSwitch(plotName) {
    const item = make("li", "", { className: "axis" }), words = make("label"), box = make("input", "", { type: "checkbox", checked: logarithmic[plotName] });
    box.addEventListener("change", () => {
      logarithmic[plotName] = box.checked;
      group.draw(group.x, group.rows);
      document.querySelector(`[data-key="${plotName}"] li:last-child input`).focus();
    });
    words.append(box, make("span", "logarithmic axis"));
    item.append(words);
    return item;
  }

  group.zoom = (low, high) => {
    const first = group.x[0], last = group.x[group.x.length - 1];
    const width = Math.min(high - low, last - first), begin = Math.min(Math.max(low, first), last - width);
    group.range = width < last - first ? [begin, begin + width] : null;
    group.busy = true;
    Object.values(group.plots).forEach((u) => u.setScale("x", { min: begin, max: begin + width }));
    group.busy = false;
  };
  group.zoomed = (u) => { // by mouse, in one of the plots
    if (group.busy) return;
    group.dragged = true; setTimeout(() => { group.dragged = false; }, 50);
    group.zoom(u.scales.x.min, u.scales.x.max);
  };
  group.scale = (factor) => {
    const u = Object.values(group.plots)[0];
    if (!u) return;
    const { min, max } = u.scales.x, idx = u.cursor.idx;
    const middle = idx != null && group.x[idx] >= min && group.x[idx] <= max ? group.x[idx] : (min + max) / 2;
    const least = (group.x[group.x.length - 1] - group.x[0]) / 2000;
    const width = Math.max((max - min) * factor, least), share = (middle - min) / (max - min);
    group.zoom(middle - share * width, middle + (1 - share) * width);
  };
  group.pan = (share) => {
    const u = Object.values(group.plots)[0];
    if (u) { const { min, max } = u.scales.x, by = share * (max - min); group.zoom(min + by, max + by); }
  };
  group.all = () => { if (group.x.length) group.zoom(group.x[0], group.x[group.x.length - 1]); };
  group.hovered = (u, plotName, rows) => {
    const outputs = document.querySelectorAll(`[data-key="${plotName}"] output`), idx = u.cursor.idx;
    const away = idx == null || u.cursor.left < 0;
    rows.forEach((row, i) => { if (outputs[i]) outputs[i].textContent = away ? "" : four(row[1][idx]); });
    if (!away && !group.moving) group.index = idx;
  };
  group.move = (by) => {
    const u = Object.values(group.plots)[0];
    if (!u) return;
    const { min, max } = u.scales.x;
    if (group.index == null) group.index = (by > 0 ? group.x.findIndex((v) => v >= min) : group.x.length) - by * (by > 0);
    const idx = group.index = Math.min(Math.max(group.index + by, 0), group.x.length - 1), x = group.x[idx];
    if (x < min || x > max) group.zoom(x - (max - min) / 2, x + (max - min) / 2);
    group.moving = true; // the cursor lands on the nearest sample, which of equals may be another
    queueMicrotask(() => { // after the zoom has taken effect
      Object.values(group.plots).forEach((p) => p.setCursor({ left: p.valToPos(x, "x"), top: 10 }, true, false));
      group.moving = false;
    });
    at("read").textContent = sentence(idx, group.rows);
  };

  const bar = document.querySelector(`[data-bar="${name}"]`);
  [["Zoom in", () => group.scale(0.5)], ["Zoom out", () => group.scale(2)], ["◀", () => group.pan(-0.4), "Earlier"],
   ["▶", () => group.pan(0.4), "Later"], ["All", () => group.all()]].forEach(([text, act, spoken]) => {
    const button = make("button", text, { type: "button", onclick: act });
    if (spoken) button.setAttribute("aria-label", spoken);
    bar.append(button);
  });
  const element = at(`${name}-plots`);
  element.addEventListener("keydown", (event) => {
    if (event.target !== element || event.ctrlKey || event.metaKey || event.altKey) return;
    const far = Math.max(10, Math.round(group.x.length / 50));
    const acts = {
      ArrowLeft: () => group.move(event.shiftKey ? -far : -1), ArrowRight: () => group.move(event.shiftKey ? far : 1),
      "+": () => group.scale(0.5), "=": () => group.scale(0.5), "-": () => group.scale(2), 0: () => group.all(),
      Enter: () => { if (group.index != null) group.clicked(group.index); },
    };
    if (acts[event.key]) { acts[event.key](); event.preventDefault(); }
  });
  return group;
}

// ---- the experiment chosen ---------------------------------------------------------------------
const rank = RUN.worst.reduce((ranks, index, i) => { ranks[index] = i; return ranks; }, []);
const short = (i) => `experiment ${RUN.number[i]}: error ${four(RUN.error[i])} rad/s`
  + (RUN.original[i] == null ? "" : `, original model ${four(RUN.original[i])} rad/s`) + `, ${WORDS[RUN.level[i]]}`;
const course = Group("course", (i) => { if (i != null) choose(i); }, (i) =>
  `${short(i)}; ${RUN.statistic.label} ${four(RUN.statistic.value[i])}; model version ${RUN.version[i]}`);
const experiment = Group("experiment", () => {}, (i, rows) => `${four(experiment.x[i])} s: `
  + [].concat(...Object.values(rows)).map(([label, values]) => `${label} ${four(values[i])}`).join(", "));

function tell() {
  const model = RUN.models[RUN.version[chosen]] || { kind: "", learned: [] };
  const numbers = model.learned.length > 12 ? `${model.learned.length} experiments, ${model.learned[0]} the first` : model.learned.join(", ");
  const from = model.learned.length ? `learned from ${model.learned.length > 1 && model.learned.length <= 12 ? "experiments " : model.learned.length > 1 ? "" : "experiment "}${numbers}` : "untrained";
  const lines = [`${short(chosen)[0].toUpperCase()}${short(chosen).slice(1)} (number ${rank[chosen] + 1} of ${RUN.worst.length}, worst first).`,
    `Predicted by version ${RUN.version[chosen]}${model.kind && ` (${model.kind}, ${from})`}.`];
  if (RUN.action[chosen]) lines.push(`Adaptor: ${RUN.action[chosen]}; ${RUN.reason[chosen]}.`);
  const diagnosis = RUN.diagnoses[RUN.number[chosen]];
  if (diagnosis) lines.push(`Diagnosis: ${diagnosis}`);
  at("told").replaceChildren(...lines.map((line) => make("p", line)));
}

function drawExperiment() {
  const samples = samplesOf(chosen);
  if (samples) experiment.draw(samples.time, experimentRows(samples));
  else experiment.draw([0, 1], { speed: [], residual: [], voltage: [] });
}

function choose(index) {
  chosen = index;
  at("choice").value = String(index);
  at("number").value = String(RUN.number[index]);
  at("worse").disabled = rank[index] === 0;
  at("better").disabled = rank[index] === RUN.worst.length - 1;
  experiment.range = experiment.index = null;
  tell();
  drawExperiment();
  Object.values(course.plots).forEach((u) => u.redraw(false));
}

function drawAll() {
  course.draw(RUN.number, courseRows());
  drawExperiment();
}

at("choice").append(...RUN.worst.map((i) => make("option",
  `${RUN.number[i]}: ${four(RUN.error[i])} rad/s, ${WORDS[RUN.level[i]]}${RUN.action[i] === "adapted" ? ", new model" : ""}`, { value: String(i) })));
at("choice").addEventListener("change", (event) => choose(+event.target.value));
at("worse").addEventListener("click", () => choose(RUN.worst[rank[chosen] - 1]));
at("better").addEventListener("click", () => choose(RUN.worst[rank[chosen] + 1]));
at("number").addEventListener("change", (event) => {
  const wanted = +event.target.value;
  const nearest = RUN.number.reduce((best, n, i) => Math.abs(n - wanted) < Math.abs(RUN.number[best] - wanted) ? i : best, 0);
  choose(nearest);
});
function follow() { // a link from the table, or from another page
  const found = /^#experiment-(\d+)$/.exec(location.hash);
  const index = found ? RUN.number.indexOf(+found[1]) : -1;
  if (index >= 0) { choose(index); at("experiment").scrollIntoView(); }
}
addEventListener("hashchange", follow);
let waiting = 0, width = innerWidth; // a phone's bars come and go, which changes the height alone
addEventListener("resize", () => {
  clearTimeout(waiting);
  waiting = setTimeout(() => { if (!printing && innerWidth !== width) { width = innerWidth; drawAll(); } }, 120);
});
matchMedia("(prefers-color-scheme: dark)").addEventListener("change", drawAll);
const print = (begins) => { printing = begins; document.documentElement.classList.toggle("light", begins); drawAll(); };
addEventListener("beforeprint", () => print(true));
addEventListener("afterprint", () => print(false));
drawAll();
choose(chosen);
follow();
})();
