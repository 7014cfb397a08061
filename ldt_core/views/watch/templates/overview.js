// All machines, worst first. Cards keep their place while somebody points at them or tabs through.
const cards = new Map();
let latest = { machines: [], state: "", left: 0 },
  heard = performance.now();

function spark() {
  const svg = drawn("svg", {
    viewBox: "0 0 100 34",
    class: "spark",
    preserveAspectRatio: "none",
    "aria-hidden": "true",
  });
  svg.set = (course) => {
    const top = Math.max(...course.map(([error]) => error || 0), 1e-12);
    const at = ([error], i) => [
      (2 + (96 * i) / Math.max(1, course.length - 1)).toFixed(1),
      (31 - (28 * (error || 0)) / top).toFixed(1),
    ];
    const points = course.map(at);
    const line = points.length > 1 ? `M${points.map((p) => p.join(" ")).join("L")}` : "";
    const marks = points.filter((_, i) => course[i][1] > 0).map(([x, y]) => `M${x} ${y}v3`);
    svg.replaceChildren(
      drawn("path", { d: line }),
      drawn("path", { d: marks.join(""), class: "bad" }),
    );
  };
  return svg;
}

function card() {
  const item = make("li"),
    link = make("a");
  const parts = { light: light() };
  const said = make("span", "", { className: "said" });
  ["name", "word", "error", "more", "trouble", "diagnosis"].forEach((name) => {
    parts[name] = make("span", "", { className: name });
  });
  parts.spark = spark();
  said.append(parts.word, parts.error);
  link.append(parts.light, parts.name, said, parts.more, parts.trouble, parts.spark, parts.diagnosis);
  item.append(link);
  return { item, link, parts };
}

const age = (c) => (c.age == null ? null : c.age + (performance.now() - heard) / 1000);

function fill({ link, parts }, c) {
  link.href = `#machine=${encodeURIComponent(c.key)}`;
  link.className = c.tone;
  parts.light.set(c.tone);
  write(parts.name, c.title);
  write(parts.word, c.words);
  write(parts.error, c.error == null ? "" : `, error ${four(c.error)} rad/s`);
  const more = judgedOf(c);
  if (c.experiment != null) more.push(`experiment ${c.experiment}`);
  if (c.version != null) more.push(`model version ${c.version}`);
  if (c.age != null) more.push(ago(age(c)));
  write(parts.more, more.join(", "));
  write(parts.trouble, c.trouble);
  write(parts.diagnosis, c.diagnosis);
  parts.spark.set(c.course);
}

function showOverview() {
  const list = at("cards");
  const keys = latest.machines.map((c) => c.key);
  latest.machines.forEach((c) => {
    if (!cards.has(c.key)) {
      cards.set(c.key, card());
      list.append(cards.get(c.key).item);
    }
    fill(cards.get(c.key), c);
  });
  [...cards.keys()].forEach((key) => {
    if (!keys.includes(key)) {
      cards.get(key).item.remove();
      cards.delete(key);
    }
  });
  const wanted = keys.map((key) => cards.get(key).item);
  const moved = wanted.some((item, i) => list.children[i] !== item);
  const busy = list.matches(":hover") || list.contains(document.activeElement);
  if (moved && !busy) list.append(...wanted);
  write(at("held"), moved && busy ? "The order is held while you are in the list." : "");
  at("none").hidden = keys.length > 0;
  if (latest.left) {
    at("none").hidden = false;
    write(at("none"), `${latest.left} more machines are not shown: there are too many.`);
  }
}
