// Plots that share their x: zoom, hover, keyboard, and a key whose boxes hide curves.
function Group(name, click, sentence) {
  const group = {
    name,
    plots: {},
    x: [],
    hidden: new Set(),
    busy: false,
    dragged: false,
    range: null,
    clicked: click,
  };

  group.draw = (x, rowsByPlot) => {
    Object.values(group.plots).forEach((u) => u.destroy());
    group.plots = {};
    group.x = x;
    group.rows = rowsByPlot;
    group.busy = true;
    Object.entries(rowsByPlot).forEach(([plotName, rows]) => {
      group.plots[plotName] = plot(group, plotName, x, rows);
      key(plotName, rows);
    });
    queueMicrotask(() => {
      group.busy = false;
      if (group.range) group.zoom(...group.range);
    });
  };

  group.update = (x, rowsByPlot) => {
    // new values of the same curves: zoom, cursor, and the key's boxes stay as they are
    const names = (rows) => (rows ? JSON.stringify(rows.map(([label, , look]) => [label, look])) : "");
    const all = Object.entries(rowsByPlot);
    if (!all.every(([plotName, rows]) => group.rows && names(rows) === names(group.rows[plotName])))
      return group.draw(x, rowsByPlot);
    group.x = x;
    group.busy = true;
    all.forEach(([plotName, rows]) => {
      rows.forEach(([, values], i) => (group.rows[plotName][i][1] = values));
      group.plots[plotName].setData([x, ...rows.map((row) => row[1])], !group.range);
    });
    queueMicrotask(() => {
      group.busy = false;
      if (group.range) group.zoom(...group.range);
    });
  };

  function key(plotName, rows) {
    const list = document.querySelector(`[data-key="${plotName}"]`);
    list.replaceChildren(
      ...rows.map(([label, , look], i) => {
        const item = make("li"),
          words = make("label"),
          box = make("input", "", { type: "checkbox" });
        box.checked = !group.hidden.has(plotName + label);
        box.addEventListener("change", () => {
          group.hidden[box.checked ? "delete" : "add"](plotName + label);
          group.plots[plotName].setSeries(i + 1, { show: box.checked });
        });
        words.append(
          box,
          swatch(look.shape === "dot" ? "ring" : "curve", look.color, look.dash),
          make("span", label),
          make("output", ""),
        );
        item.append(words);
        return item;
      }),
      ...(MARKS[plotName] || []).map(([kind, paint, label]) => {
        const item = make("li"),
          words = make("span", "", { className: "plain" });
        words.append(swatch(kind, paint), make("span", label));
        item.append(words);
        return item;
      }),
      ...(plotName in logarithmic ? [axisSwitch(plotName)] : []),
    );
  }

  function axisSwitch(plotName) {
    const item = make("li", "", { className: "axis" }),
      words = make("label"),
      box = make("input", "", { type: "checkbox", checked: logarithmic[plotName] });
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
    const first = group.x[0],
      last = group.x[group.x.length - 1];
    const width = Math.min(high - low, last - first),
      begin = Math.min(Math.max(low, first), last - width);
    group.range = width < last - first ? [begin, begin + width] : null;
    group.busy = true;
    Object.values(group.plots).forEach((u) => u.setScale("x", { min: begin, max: begin + width }));
    group.busy = false;
  };
  group.zoomed = (u) => {
    // by mouse, in one of the plots
    if (group.busy) return;
    group.dragged = true;
    setTimeout(() => {
      group.dragged = false;
    }, 50);
    group.zoom(u.scales.x.min, u.scales.x.max);
  };
  group.scale = (factor) => {
    const u = Object.values(group.plots)[0];
    if (!u) return;
    const { min, max } = u.scales.x,
      idx = u.cursor.idx;
    const middle =
      idx != null && group.x[idx] >= min && group.x[idx] <= max ? group.x[idx] : (min + max) / 2;
    const least = (group.x[group.x.length - 1] - group.x[0]) / 2000;
    const width = Math.max((max - min) * factor, least),
      share = (middle - min) / (max - min);
    group.zoom(middle - share * width, middle + (1 - share) * width);
  };
  group.pan = (share) => {
    const u = Object.values(group.plots)[0];
    if (u) {
      const { min, max } = u.scales.x,
        by = share * (max - min);
      group.zoom(min + by, max + by);
    }
  };
  group.all = () => {
    if (group.x.length) group.zoom(group.x[0], group.x[group.x.length - 1]);
  };
  group.hovered = (u, plotName, rows) => {
    const outputs = document.querySelectorAll(`[data-key="${plotName}"] output`),
      idx = u.cursor.idx;
    const away = idx == null || u.cursor.left < 0;
    rows.forEach((row, i) => {
      if (outputs[i]) outputs[i].textContent = away ? "" : four(row[1][idx]);
    });
    if (!away && !group.moving) group.index = idx;
  };
  group.move = (by) => {
    const u = Object.values(group.plots)[0];
    if (!u) return;
    const { min, max } = u.scales.x;
    if (group.index == null)
      group.index = (by > 0 ? group.x.findIndex((v) => v >= min) : group.x.length) - by * (by > 0);
    const idx = (group.index = Math.min(Math.max(group.index + by, 0), group.x.length - 1)),
      x = group.x[idx];
    if (x < min || x > max) group.zoom(x - (max - min) / 2, x + (max - min) / 2);
    group.moving = true; // the cursor lands on the nearest sample, which of equals may be another
    queueMicrotask(() => {
      // after the zoom has taken effect
      Object.values(group.plots).forEach((p) =>
        p.setCursor({ left: p.valToPos(x, "x"), top: 10 }, true, false),
      );
      group.moving = false;
    });
    at("read").textContent = sentence(idx, group.rows);
  };

  const bar = document.querySelector(`[data-bar="${name}"]`);
  [
    ["Zoom in", () => group.scale(0.5)],
    ["Zoom out", () => group.scale(2)],
    ["◀", () => group.pan(-0.4), "Earlier"],
    ["▶", () => group.pan(0.4), "Later"],
    ["All", () => group.all()],
  ].forEach(([text, act, spoken]) => {
    const button = make("button", text, { type: "button", onclick: act });
    if (spoken) button.setAttribute("aria-label", spoken);
    bar.append(button);
  });
  const element = at(`${name}-plots`);
  element.addEventListener("keydown", (event) => {
    if (event.target !== element || event.ctrlKey || event.metaKey || event.altKey) return;
    const far = Math.max(10, Math.round(group.x.length / 50));
    const acts = {
      ArrowLeft: () => group.move(event.shiftKey ? -far : -1),
      ArrowRight: () => group.move(event.shiftKey ? far : 1),
      "+": () => group.scale(0.5),
      "=": () => group.scale(0.5),
      "-": () => group.scale(2),
      0: () => group.all(),
      Enter: () => {
        if (group.index != null) group.clicked(group.index);
      },
    };
    if (acts[event.key]) {
      acts[event.key]();
      event.preventDefault();
    }
  });
  return group;
}
