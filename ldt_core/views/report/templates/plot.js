// One plot: its curves by uPlot, and the marks beside them.
function shape(ctx, kind, x, y, r) {
  ctx.beginPath();
  if (kind === "square") ctx.rect(x - r, y - r, 2 * r, 2 * r);
  else if (kind === "triangle") {
    ctx.moveTo(x, y - r * 1.2);
    ctx.lineTo(x + r * 1.1, y + r);
    ctx.lineTo(x - r * 1.1, y + r);
    ctx.closePath();
  } else ctx.arc(x, y, r, 0, 2 * Math.PI);
}

function visible(u, i) {
  const { min, max } = u.scales.x,
    x = u.data[0][i];
  return x >= min && x <= max;
}

function scale(u) {
  // of the marks: where experiments lie close, marks of full size would hide the curves
  const { min, max } = u.scales.x;
  return Math.min(1, Math.max(0.45, u.bbox.width / uPlot.pxRatio / (max - min + 1) / 7));
}

function verticals(u) {
  // behind the curves: new models, and the experiment chosen
  const { ctx, bbox } = u,
    ratio = uPlot.pxRatio;
  ctx.save();
  RUN.number.forEach((number, i) => {
    if (!visible(u, i)) return;
    const x = Math.round(u.valToPos(number, "x", true));
    if (i === chosen) {
      ctx.globalAlpha = 0.22;
      ctx.fillStyle = color("sky");
      ctx.fillRect(x - 5 * ratio, bbox.top, 10 * ratio, bbox.height);
      ctx.globalAlpha = 1;
    }
    if (RUN.action[i] !== "adapted") return;
    ctx.strokeStyle = color("green");
    ctx.lineWidth = 1.2 * ratio * scale(u);
    ctx.setLineDash([4 * ratio, 4 * ratio]);
    ctx.beginPath();
    ctx.moveTo(x, bbox.top);
    ctx.lineTo(x, bbox.top + bbox.height);
    ctx.stroke();
  });
  ctx.restore();
}

function levels(u) {
  // in front: a shape for each signal that is not negative
  const { ctx } = u,
    ratio = uPlot.pxRatio * scale(u);
  ctx.save();
  RUN.level.forEach((level, i) => {
    const value = u.data[1][i];
    if (level < 0 || value == null || !visible(u, i) || (u.scales.y.distr === 3 && value <= 0))
      return;
    const x = u.valToPos(u.data[0][i], "x", true),
      y = u.valToPos(value, "y", true);
    shape(ctx, level > 0 ? "square" : "triangle", x, y, (level > 0 ? 3.6 : 4.6) * ratio);
    ctx.fillStyle = color(level > 0 ? "vermilion" : "paper");
    ctx.fill();
    ctx.lineWidth = 1.6 * ratio;
    ctx.strokeStyle = color(level > 0 ? "vermilion" : "ink");
    ctx.stroke();
  });
  ctx.restore();
}

const STRIP = 12; // pixels
function states(u) {
  // above the curves: a cell an experiment
  const { ctx, bbox } = u,
    ratio = uPlot.pxRatio,
    right = bbox.left + bbox.width;
  ctx.save();
  RUN.number.forEach((number, i) => {
    if (RUN.level[i] == null) return;
    const edge = (x) => Math.round(Math.min(Math.max(u.valToPos(x, "x", true), bbox.left), right));
    const from = edge(number - 0.5),
      width = edge(number + 0.5) - from;
    if (width <= 0) return;
    const gap = width > 5 * ratio ? ratio : 0; // between cells, where there is room
    ctx.fillStyle = color(PAINTS[stateOf(i)[1]]);
    ctx.globalAlpha = RUN.state[i] ? 1 : 0.45;
    ctx.fillRect(from, bbox.top - (STRIP + 4) * ratio, width - gap, STRIP * ratio);
  });
  ctx.restore();
}

function counted() {
  // the key of the cells: each state that there is, and in how many experiments
  const list = at("states");
  if (!list) return;
  list.replaceChildren(
    ...Object.entries(RUN.states).flatMap(([name, [words, tone]]) => {
      const count = RUN.level.filter((l, i) => l != null && (RUN.state[i] || "") === name).length;
      if (!count) return [];
      const item = make("li");
      item.append(make("i", "", { className: `cell ${tone}` }), make("span", `${words}: ${count}`));
      return [item];
    }),
  );
}

function learned(u) {
  // a dot where a version learned from an experiment
  const { ctx } = u,
    ratio = uPlot.pxRatio * scale(u),
    { min, max } = u.scales.x;
  ctx.save();
  ctx.fillStyle = color("paper");
  ctx.strokeStyle = color("green");
  ctx.lineWidth = 1.8 * ratio;
  Object.keys(RUN.models).forEach((version) =>
    RUN.models[version].learned.forEach((number) => {
      if (number < min || number > max) return;
      shape(
        ctx,
        "dot",
        u.valToPos(number, "x", true),
        u.valToPos(+version, "y", true),
        3.4 * ratio,
      );
      ctx.fill();
      ctx.stroke();
    }),
  );
  ctx.restore();
}

function newest(u) {
  // the versions that learned from an experiment in sight: the last has not predicted yet
  const { min, max } = u.series[0]; // its scale is not set yet
  return Object.keys(RUN.models)
    .filter((version) => RUN.models[version].learned.some((n) => n >= min && n <= max))
    .map(Number);
}

const MARKS = {
  error: [
    ["square", "vermilion", "alarm"],
    ["triangle", "ink", "warning"],
    ["line", "green", "new model"],
  ],
  statistic: [],
  versions: [["ring", "green", "learned from"]],
};

function plot(group, name, x, rows) {
  const place = document.querySelector(`[data-plot="${name}"]`),
    course = group.name === "course";
  const log = Boolean(logarithmic[name]);
  const series = [{}],
    bands = [];
  rows.forEach(([label, , look], i) => {
    const dotted = look.shape === "dot";
    series.push({
      label,
      stroke: color(look.color),
      width: dotted ? 0 : look.width,
      spanGaps: false,
      show: !group.hidden.has(name + label),
      dash: look.dash && look.dash !== "none" ? DASHES[look.dash] : [],
      paths: dotted ? () => null : look.step ? uPlot.paths.stepped({ align: 1 }) : undefined,
      points: {
        show: dotted || (course && i === 0 && name !== "versions"),
        size: dotted ? Math.min(5, Math.max(3, place.clientWidth / x.length)) : 4,
        width: 1,
        stroke: color(look.color),
        fill: color(dotted ? "paper" : look.color),
      },
    });
    if (look.band) bands.push({ series: [i + 2, i + 1], fill: color("sky") + "38" });
  });
  const ticks = {
    stroke: color("ink"),
    grid: { stroke: color("faint"), width: 1 },
    ticks: { stroke: color("faint"), width: 1 },
    font: "12px system-ui, sans-serif",
  };
  const values = (u, splits) => splits.map((v) => (v == null ? "" : four(v)));
  const u = new uPlot(
    {
      width: printing ? PRINTED : place.clientWidth,
      height: HEIGHTS[name] * (place.clientWidth < 500 ? 0.85 : 1),
      series,
      bands,
      legend: { show: false },
      padding: [name === "error" ? STRIP + 8 : 10, 12, 0, 0],
      cursor: {
        y: false,
        sync: { key: group.name, setSeries: false },
        drag: { x: true, y: false },
        points: { size: 9 },
      },
      scales: {
        x: {
          time: false,
          range: (_, low, high) => (low === high ? [low - 1, high + 1] : [low, high]),
        },
        y: log
          ? { distr: 3, range: (_, low, high) => [Math.max(low, high * 1e-6) / 1.2, high * 1.2] }
          : name === "error"
            ? { range: (_, low, high) => [0, high * 1.06 || 1] }
            : name === "versions"
              ? { range: (u, low, high) => [Math.min(0, low), Math.max(high, 1, ...newest(u)) + 0.5] }
              : {},
      },
      axes: [
        {
          ...ticks,
          values: course ? values : (u, s) => values(u, s).map((v) => v && `${v} s`),
          incrs: course ? WHOLE : undefined,
          space: 60,
          size: 32,
          ...(name === "versions"
            ? {
                label: "number of the experiment",
                labelSize: 18,
                labelFont: "12px system-ui, sans-serif",
              }
            : {}),
        },
        {
          ...ticks,
          values,
          size: 58,
          ...(log ? { splits: decades, filter: (u, ticks) => ticks } : {}),
          incrs: name === "versions" ? WHOLE : undefined,
          space: name === "versions" || name === "voltage" ? 26 : 34,
        },
      ],
      hooks: {
        drawAxes: course ? [verticals] : [],
        draw:
          name === "versions"
            ? [learned]
            : name === "error"
              ? [levels, states, counted]
              : course
                ? [levels]
                : [],
        setScale: [
          (self, key) => {
            if (key === "x") group.zoomed(self);
          },
        ],
        setCursor: [(self) => group.hovered(self, name, rows)],
      },
    },
    [x, ...rows.map((row) => row[1])],
    place,
  );
  u.over.addEventListener("click", () => {
    if (!group.dragged) group.clicked(u.cursor.idx);
  });
  return u;
}

function swatch(kind, name, dash) {
  const svg = document.createElementNS("http://www.w3.org/2000/svg", "svg");
  const put = (tag, more) => {
    const e = document.createElementNS("http://www.w3.org/2000/svg", tag);
    Object.entries(more).forEach(([k, v]) => e.setAttribute(k, v));
    svg.append(e);
  };
  svg.setAttribute("viewBox", "0 0 26 12");
  svg.setAttribute("aria-hidden", "true");
  const paint = `var(--${name})`;
  if (kind === "square") put("rect", { x: 9, y: 2, width: 8, height: 8, fill: paint });
  else if (kind === "triangle")
    put("path", {
      d: "M13 1l5.4 9.6H7.6z",
      fill: "var(--paper)",
      stroke: paint,
      "stroke-width": 1.6,
    });
  else if (kind === "ring")
    put("circle", {
      cx: 13,
      cy: 6,
      r: 4,
      fill: "var(--paper)",
      stroke: paint,
      "stroke-width": 1.8,
    });
  else
    put("path", {
      d: "M0 6h26",
      stroke: paint,
      "stroke-width": 2.4,
      "stroke-dasharray": (kind === "line" ? [4, 4] : DASHES[dash || "solid"]).join(" ") || "none",
    });
  return svg;
}
