// The state of machine and model as a traffic light: place, shape and colour say the same, and a word stands beside it.
const SVG = "http://www.w3.org/2000/svg";
const LAMPS = [
  ["bad", "M5 4h16v16H5z", "M9 8l8 8m0-8l-8 8"],
  ["vague", "M13 25l9.5 16.5h-19z", "M13 30.5v5m0 2.2v.6"],
  ["found", "M13 46l9.5 9.5-9.5 9.5-9.5-9.5z", "M9 55.5h8"],
  ["good", "M13 70a8.5 8.5 0 1 1-.01 0z", "M9.2 78.6l2.8 2.8 5-5.4"],
];

function drawn(tag, more) {
  const e = document.createElementNS(SVG, tag);
  Object.entries(more).forEach(([k, v]) => e.setAttribute(k, v));
  return e;
}

function light() {
  const svg = drawn("svg", { viewBox: "0 0 26 92", class: "light", "aria-hidden": "true" });
  svg.append(drawn("rect", { x: 1, y: 1, width: 24, height: 90, rx: 5, class: "case" }));
  LAMPS.forEach(([tone, lamp, sign]) =>
    svg.append(
      drawn("path", { d: lamp, class: `lamp ${tone}` }),
      drawn("path", { d: sign, class: `sign ${tone}` }),
    ),
  );
  svg.set = (tone) =>
    LAMPS.forEach(([own]) => {
      svg.querySelector(`.lamp.${own}`).classList.toggle("lit", own === tone);
      svg.querySelector(`.sign.${own}`).classList.toggle("shown", own === tone);
    });
  return svg;
}

// Text is written only where it has changed: a screen reader and a selection stay where they are.
function write(element, text) {
  if (element.textContent !== text) element.textContent = text;
}

const ago = (seconds) =>
  seconds == null
    ? ""
    : seconds < 90
      ? `${Math.round(seconds)} s ago`
      : seconds < 5400
        ? `${Math.round(seconds / 60)} min ago`
        : `${Math.round(seconds / 3600)} h ago`;
const judgedOf = (c) =>
  c.level == null
    ? []
    : [c.noise && `error ${c.noise}`, `detector: ${RUN.levels[c.level]}`].filter(Boolean);
